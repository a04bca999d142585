"""Shells: hollow bodies with connections along the edges of their triangles."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Cells, Material, Surface, System, connection_between, sides_of
from .joining import join
from .lattices import section_of
from .meshes import halved, merged, read_mesh, shared_normals

MOST_STRETCH = 0.5
"""Largest change of an edge's rest length by a tension, over its length."""


def shell(
    mesh: Any,
    *,
    material: Material | None = None,
    thickness: float | None = None,
    tension: float = 0.0,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    folding: float = 0.0,
) -> System:
    """Return a mesh as a thin shell or membrane: a particle at each point, a connection along each edge.

    Coincident points, such as those along the seam of a texture, are one particle. They have a common normal,
    unless the surface bends there by more than 30°.

    **Material.** A triangle of area A contributes E t A/l² to the stiffness of its edge of length l (Van Gelder,
    J. Graphics Tools 3 (1998) 21-41): exact where all edges stretch alike, and for equilateral triangles, which
    have a Poisson's ratio of 1/3. For another ratio each triangle is a cell of `Cells`, as in a `sheet`. Triangles
    of other shapes are only roughly of the material. The damping time is that of a sheet as long as the mesh.

    **Tension.** With a tension T the springs are stretched so that they pull as a membrane of this tension would.
    An edge has the force T l (cot α + cot β)/2, with the angles α and β opposite it, as linear finite elements of
    a membrane have (Pinkall and Polthier, Experimental Mathematics 2 (1993) 15-36). So a flat mesh of any
    triangles is in equilibrium, except at its rim, which must be held, and vibrates as a drum does. On a closed
    surface a pressure balances the tension, 2 T/R in a sphere.

    Parameters
    ----------
    mesh
        A PyVista surface, or a pair of points [m], shape [any, 3], and triangles, shape [any, 3].
    material, thickness
        A `Material` and the thickness t [m], which determine masses, springs and dampers.
    tension
        Force per length T [N/m] in all directions at the start.
    mass
        Mass of each particle [kg], shape [particle_count].
    total_mass
        Mass of the shell [kg], in place of `mass`: a third of each triangle's at each corner, by area. Without
        material and mass it is 1.
    stiffness, damping
        Constants of each connection along an edge [N/m], [N s/m]; by default 100 and 0.
    folding
        Stiffness of connections between the opposite corners of two triangles with a common edge [N/m]; 0 for
        none. They are at rest in the shape of the mesh and resist folding (Provot, Graphics Interface 1995), but
        give a flat mesh no flexural rigidity.

    Returns
    -------
    System
        Its surface has the mesh's triangles and texture coordinates. If the mesh has none, these are longitude and
        latitude about the middle.

    Raises
    ------
    ValueError
        If the mesh is invalid or has a triangle without area; or the tension is more than the springs bear.
    """
    points, uv, triangles = read_mesh(mesh)
    points, uv, triangles, particle = merged(points, uv, triangles)
    first = np.unique(particle, return_index=True)[1]
    corners = particle[triangles]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    checks.every("the area of a triangle", area, area > 0, "above 0")
    edges, across = edges_of(corners)
    uv_of = _longitude_and_latitude(points) if uv is None else uv
    normal_of = shared_normals(points, triangles) if len(first) < len(points) else None
    system = System(
        position=points[first],
        connections=edges,
        surface=Surface(particle=particle, uv=uv_of, triangles=triangles, normal_of=normal_of),
    )
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    section = section_of(material, constants, {"thickness": thickness})
    weight = np.bincount(corners.ravel(), np.repeat(area / 3, 3), minlength=len(first)).astype(np.float64)
    if material is None:
        fields = {
            "mass": _masses(mass, total_mass, weight),
            "stiffness": 100.0 if stiffness is None else stiffness,
        }
        system = system.replace(**fields, damping=0.0 if damping is None else damping)
    else:
        system = _of_material(system, material, section, corners, area)
        system = system.replace(mass=material.density * section * weight)
    if checks.non_negative("tension", tension):
        system = _stretched(system, tension, corners)
    if checks.non_negative("folding", folding) == 0.0 or not len(across):
        return system
    count = len(across)  # constants are stored for each connection, since digests of scenes depend on that
    return join(system, pairs=across, stiffness=np.full(count, folding), damping=np.zeros(count))


def _masses(mass: ArrayLike | None, total: float | None, weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mass of each particle [kg]: as given, or its part of the total by weight."""
    if mass is not None and np.ndim(mass) == 0:  # before 0.3 a number was the total
        raise ValueError(
            f"mass is {checks.repr_short(mass)}; since 0.3 it must be the masses of {len(weight)} particles: the "
            "mass of a whole shell is total_mass"
        )
    if mass is not None and total is not None:
        raise ValueError(f"total_mass is {total!r}; with mass, that of each particle, it must be left out")
    if mass is not None:
        return checks.broadcast("mass", mass, weight.shape)
    return checks.positive("total_mass", 1.0 if total is None else total) * weight / weight.sum()


def _of_material(
    system: System, material: Material, thickness: float, corners: NDArray[np.integer], area: NDArray[np.float64]
) -> System:
    """Return a shell with the springs, dampers and cells of a material, given its triangles' corners and areas."""
    edge = connection_between(system, np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1))
    around = np.bincount(edge.ravel(), np.repeat(area, 3), minlength=system.connection_count)
    stiffness = material.cell_stiffness(2, 1.0, thickness, diagonals=False)[0] * around / system.rest_length**2
    time = material.damping_time(float(np.ptp(system.position, axis=0).max()), 2)
    modulus, cells = material.cell_modulus(2, thickness), None
    if modulus != 0.0:
        four = corners[:, [0, 1, 2, 2]]
        damping = time * material.damped_modulus(2, thickness)
        cells = Cells(corners=four, rest_volume=area, modulus=modulus, damping=damping)
    return system.replace(stiffness=stiffness, damping=time * stiffness, cells=cells)


def _stretched(system: System, tension: float, corners: NDArray[np.integer]) -> System:
    """Return a shell whose edges pull with a tension [N/m]; raise ValueError if they do not bear it."""
    force = np.zeros(system.connection_count)
    for k in range(3):
        tip, one, other = (system.position[corners[:, (k + n) % 3]] for n in range(3))
        u, v = one - tip, other - tip
        cotangent = np.einsum("td,td->t", u, v) / np.linalg.norm(np.cross(u, v), axis=1)
        edge = connection_between(system, corners[:, [(k + 1) % 3, (k + 2) % 3]])
        force += np.bincount(edge, cotangent, minlength=len(force))
    force *= tension / 2 * system.length
    borne = system.stiffness * system.length * MOST_STRETCH
    if (force > borne).any():
        most = tension * (borne[force > borne] / force[force > borne]).min()
        raise ValueError(f"tension is {tension:g} N/m; connections of this stiffness bear at most {most:.4g}")
    stretch = np.divide(force, system.stiffness, out=np.zeros_like(force), where=force != 0)
    return system.replace(rest_length=system.length - stretch)


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


def disc(radius: float = 0.5, rings: int = 8) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the points and triangles of a flat disc about the origin, facing up, as for a drum.

    Parameters
    ----------
    radius
        Radius [m].
    rings
        Number of rings of points around the one in the middle; ring k has 6 k points, the last ones are the rim.
    """
    radius, rings = checks.positive("radius", radius), checks.count("rings", rings, 1)
    checks.fits(f"rings is {rings}", f"{6.0 * rings**2:.3g} triangles", 600.0 * rings**2)
    k = np.repeat(np.arange(rings + 1), [1, *range(6, 6 * rings + 1, 6)])
    start = np.maximum(3 * np.arange(rings + 1) * np.arange(-1, rings) + 1, 0)  # first point of each ring
    start[0] = 0
    angle = 2 * np.pi * (np.arange(len(k)) - start[k]) / np.maximum(6 * k, 1)
    flat = radius * k / rings
    points = np.stack([flat * np.cos(angle), flat * np.sin(angle), np.zeros(len(k))], axis=1)
    triangles = []
    for ring in range(1, rings + 1):
        sector, along = np.divmod(np.arange(6 * ring), ring)
        a, b = (start[ring] + (np.arange(6 * ring) + n) % (6 * ring) for n in (0, 1))
        inner = max(6 * (ring - 1), 1)
        c, d = (start[ring - 1] + (sector * (ring - 1) + along + n) % inner for n in (0, 1))
        triangles += [np.stack([c, a, b], axis=1), np.stack([c, b, d], axis=1)[along < ring - 1]]
    return points, np.concatenate(triangles).astype(np.int32)


def _longitude_and_latitude(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return texture coordinates of points from their directions, as seen from the middle."""
    off = points - (points.min(axis=0) + points.max(axis=0)) / 2
    distance = np.maximum(np.linalg.norm(off, axis=1), 1e-300)
    longitude = np.arctan2(off[:, 1], off[:, 0]) / (2 * np.pi) + 0.5
    return np.stack([longitude, np.arccos(np.clip(off[:, 2] / distance, -1, 1)) / np.pi], axis=1)
