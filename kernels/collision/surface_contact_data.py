"""Device data of contact between facets and obstacles, and sums of powers."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..colliders.signed_distance import solids

SIDES = 12
"""Intervals along each side of a facet."""
QUADRATURE_POINTS = (SIDES + 1) * (SIDES + 2) // 2
"""Sample points of a facet."""


def quadrature_weights() -> list[tuple[float, float, float]]:
    """Return the barycentric weights of a facet's sample points, shape [QUADRATURE_POINTS, 3]."""
    rows = [(i, j) for i in range(SIDES + 1) for j in range(SIDES + 1 - i)]
    return [((SIDES - i - j) / SIDES, i / SIDES, j / SIDES) for i, j in rows]


@functools.cache
def SurfaceContactData(scalar: type, moving: bool):
    """Compose the struct of facets, and of the obstacles that they may touch."""
    V, Solids, Turn = vector(3, scalar), solids(3, scalar), wp.types.matrix((3, 3), scalar)

    @wp.struct
    class FacetsAndObstacles:
        place: wp.array(dtype=V)  # barycentric weights of samples, shape [QUADRATURE_POINTS]
        # Vertices, weighted means of particles, as in `place_vertices`:
        x: wp.array(dtype=V)  # position [m], shape [vertex_count]
        v: wp.array(dtype=V)  # velocity [m/s]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        force: wp.array2d(dtype=wp.int64)  # on the vertex, in units, shape [vertex_count, 3]
        # Facets, of shape [facet_count] unless noted:
        corner: wp.array(dtype=wp.vec3i)  # its three vertices
        stiffness: wp.array(dtype=scalar)  # of each sample on it [N/m]
        whole: wp.array(dtype=scalar)  # of all samples around a vertex [N/m]
        slack: wp.array(dtype=scalar)  # smaller depths are rounding errors [m], less the radius of the shell
        tangential_displacement: wp.array2d(dtype=V)  # along contact_body [m], shape [HISTORY, facet_count]
        contact_body: wp.array2d(dtype=int)  # obstacle that the facet touches, −1: none
        side: wp.array2d(dtype=V)  # normal of the entry side if the facet is deep, else 0
        level: wp.array2d(dtype=scalar)  # offset of the entry side along `side`, in the obstacle's given pose [m]
        initial_overlap: wp.array(dtype=scalar)  # depth at the start that is still allowed [m]
        overlap_release_speed: scalar  # rate at which initial_overlap shrinks [m/s]
        power: wp.array(dtype=wp.float64)  # power of the obstacles on it [W]
        # Obstacles:
        solid: wp.array(dtype=int)  # indices of the obstacles that are not planes, shape [solid_count]
        solids: Solids  # shapes of all obstacles
        lower: wp.array(dtype=V)  # bounding boxes in the given pose [m], shape [obstacle_count]
        upper: wp.array(dtype=V)
        friction: wp.array(dtype=scalar)  # μ
        damping: wp.array(dtype=scalar)  # damping ratio, from its restitution
        thin: wp.array(dtype=scalar)  # beyond this depth the nearest side may not be the entry side [m]
        if moving:  # poses at the ends of substeps, see `collider_contact`
            turn: wp.array2d(dtype=Turn)
            shift: wp.array2d(dtype=V)
            turning: wp.array2d(dtype=Turn)
            speed: wp.array2d(dtype=V)

    return FacetsAndObstacles


@kernel
def add_energies(
    power: wp.array(dtype=wp.float64),  # [W], shape [any]
    seconds: wp.float64,  # [s]
    # In and out:
    done: wp.array(dtype=wp.float64),  # [J], shape [any]
):
    """Add each power times `seconds` to the work in `done` [J]."""
    i = wp.tid()
    done[i] = done[i] + seconds * power[i]
