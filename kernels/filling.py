"""Depths of points in a closed surface of triangles, and distances to its opposite side along rays."""

import warp as wp

from .basis import kernel


@kernel
def find_depths(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),  # in the units of the mesh, shape [point_count]
    reach: float,
    # Out:
    depth: wp.array(dtype=float),  # shape [point_count]
):
    """Find the depth of each point below the surface; −1 for points outside.

    The winding number (the solid angle of the surface seen from the point, divided by 4π) is 1 inside and 0
    outside (Jacobson, Kavan & Sorkine-Hornung 2013, "Robust inside-outside segmentation using generalized winding
    numbers"); all points are within `reach` of the surface.
    """
    i = wp.tid()
    found = wp.mesh_query_point_sign_winding_number(mesh, points[i], reach)
    depth[i] = -1.0
    if found.result and found.sign < 0.0:
        depth[i] = wp.length(points[i] - wp.mesh_eval_position(mesh, found.face, found.u, found.v))
