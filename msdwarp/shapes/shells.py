"""Shells: hollow bodies with connections along the edges of their triangles."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Surface, System, sides_of
from .joining import join
from .meshes import halved, merged, read_mesh, shared_normals


def shell(
    mesh: Any, *, mass: float = 1.0, stiffness: ArrayLike = 100.0, damping: ArrayLike = 0.0, bending: float = 0.0
) -> System:
    """Return a mesh as a thin shell: a particle at each point, a connection along each edge.

    Coincident points, such as those along the seam of a texture, are one particle. They have a common normal,
    unless the surface bends there by more than 30°.

    With `bending` the opposite corners of two triangles that share an edge are also connected; these springs
    resist folding (Provot, Graphics Interface 1995).

    Parameters
    ----------
    mesh
        A PyVista surface, or a pair of points [m], shape [any, 3], and triangles, shape [any, 3].
    mass
        Total mass [kg], distributed by area: a third of each triangle's mass at each corner.
    stiffness, damping
        Constants of each connection along an edge [N/m], [N s/m].
    bending
        Stiffness of the connections across edges [N/m]; 0 for none.

    Returns
    -------
    System
        Its surface has the mesh's triangles and texture coordinates. If the mesh has none, these are longitude and
        latitude about the middle.

    Raises
    ------
    ValueError
        If the mesh is invalid or has a triangle without area.
    """
    points, uv, triangles = read_mesh(mesh)
    points, uv, triangles, particle = merged(points, uv, triangles)
    first = np.unique(particle, return_index=True)[1]
    corners = particle[triangles]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    checks.every("the area of a triangle", area, area > 0, "above 0")
    weight = np.bincount(corners.ravel(), np.repeat(area / 3, 3), minlength=len(first))
    edges, across = edges_of(corners)
    uv_of = _longitude_and_latitude(points) if uv is None else uv
    normal_of = shared_normals(points, triangles) if len(first) < len(points) else None
    system = System(
        position=points[first],
        mass=checks.positive("mass", mass) * weight / weight.sum(),
        connections=edges,
        stiffness=stiffness,
        damping=damping,
        surface=Surface(particle=particle, uv=uv_of, triangles=triangles, normal_of=normal_of),
    )
    if checks.non_negative("bending", bending) == 0.0 or not len(across):
        return system
    count = len(across)  # constants are stored for each connection, since digests of scenes depend on that
    return join(system, pairs=across, stiffness=np.full(count, bending), damping=np.zeros(count))


def edges_of(triangles: NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return (edges of triangles, each once; opposite corners across shared edges), shape [any, 2] each."""
    edges, side, _ = sides_of(triangles)
    far, side = np.roll(triangles, 1, axis=1).T.ravel(), side.T.ravel()
    order = np.argsort(side, kind="stable")
    first = np.flatnonzero(np.diff(side[order], append=-1) == 0)
    across = np.stack([far[order][first], far[order][first + 1]], axis=1)
    return edges.astype(np.int32), np.sort(across, axis=1).astype(np.int32)


def icosphere(radius: float = 0.5, subdivisions: int = 3) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the points and triangles of a sphere about the origin: a subdivided icosahedron.

    Parameters
    ----------
    radius
        Radius [m].
    subdivisions
        Number of times each triangle is divided into four, 0 to 7.
    """
    radius = checks.positive("radius", radius)
    checks.one_of("subdivisions", subdivisions, range(8))
    tall = (1 + 5**0.5) / 2
    corners = [(-1, tall), (1, tall), (-1, -tall), (1, -tall)]
    points = np.array([np.roll((a, b, 0.0), k) for k in range(3) for a, b in corners])
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    near = np.isclose(apart, 2.0)  # neighbours along an edge of the icosahedron
    triangles = np.array([three for three in combinations(range(12), 3) if near[np.ix_(three, three)].sum() == 6])
    a, b, c = (points[triangles[:, k]] for k in range(3))
    outwards = np.einsum("td,td->t", np.cross(a, b), c)
    triangles[outwards < 0] = triangles[outwards < 0][:, ::-1]
    for _ in range(subdivisions):
        points, _, triangles = halved(points, None, triangles, 0.0)
        points /= np.linalg.norm(points, axis=1)[:, None]
    points *= radius / np.linalg.norm(points, axis=1)[:, None]
    return points, np.asarray(triangles, dtype=np.int32)


def _longitude_and_latitude(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return texture coordinates of points from their directions, as seen from the middle."""
    off = points - (points.min(axis=0) + points.max(axis=0)) / 2
    distance = np.maximum(np.linalg.norm(off, axis=1), 1e-300)
    longitude = np.arctan2(off[:, 1], off[:, 0]) / (2 * np.pi) + 0.5
    return np.stack([longitude, np.arccos(np.clip(off[:, 2] / distance, -1, 1)) / np.pi], axis=1)
