"""Dressing: the look of each part of a body, and the springs that are drawn although there is a surface.

Looks are numbered: 0 is the scene's, followed by those of groups in order. If several apply, the last one counts.
A triangle is in a group if all its corners are, as for loads.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Bare, Edges, Surface, System, laid_bare, mask_of, pieces
from ..world import Look, Scene

OBSTACLES = "obstacles"
"""Name that stands for all obstacles where bodies are chosen by name."""
DENSITY, SAMPLED = 1000.0, 200
"""Density of grains whose size nothing says [kg/m³]; about how many tell how far apart they are."""
PINNED_ALONE = 0.05
"""Radius of a single pinned particle in an empty scene [m]."""


def look_of_particles(scene: Scene) -> NDArray[np.int32]:
    """Return the number of each particle's look, shape [particle_count]."""
    look = np.zeros(scene.system.particle_count, dtype=np.int32)
    for k, name in enumerate(scene.looks, start=1):
        look[scene.system.groups[name]] = k
    return look


def look_of_triangles(scene: Scene, surface: Surface) -> NDArray[np.int32]:
    """Return the number of each triangle's look, shape [triangle_count]."""
    look, count = np.zeros(len(surface.triangles), dtype=np.int32), scene.system.particle_count
    for k, name in enumerate(scene.looks, start=1):
        look[surface.triangles_in(mask_of(scene.system.groups[name], count))] = k
    return look


def particles_of(system: System, bodies: Sequence[str]) -> NDArray[np.bool_]:
    """Return a mask of the particles in any of these groups, shape [particle_count]; of all, if none is named.

    Raise ValueError unless each name is that of a group, or OBSTACLES.
    """
    if not bodies:
        return np.ones(system.particle_count, dtype=bool)
    for name in bodies:
        checks.one_of("body", name, (*system.groups, OBSTACLES))
    chosen = [system.groups[name] for name in bodies if name in system.groups]
    return mask_of(np.concatenate([np.zeros(0, int), *chosen]), system.particle_count)


def part_of(surface: Surface, chosen: NDArray[np.bool_]) -> Surface:
    """Return the triangles of a surface in a mask, shape [triangle_count], with the vertices that they need."""
    if chosen.all():
        return surface
    needed = np.unique(surface.triangles[chosen])
    normal_of = surface.normal_of
    if normal_of is not None:
        needed = np.union1d(needed, normal_of[needed])
    number = np.zeros(len(surface.particle), dtype=np.int32)
    number[needed] = np.arange(len(needed))
    return Surface(
        particle=surface.particle[needed],
        weights=None if surface.weights is None else surface.weights[needed],
        uv=surface.uv[needed],
        triangles=number[surface.triangles[chosen]],
        normal_of=None if normal_of is None else number[normal_of[needed]],
    )


def torn(system: System) -> Bare | None:
    """Return the faces of a torn system: the faces of solids' cells, and the triangles of sheets.

    None if nothing is broken. What is embedded in a lattice stays whole.
    """
    if system.surface is None or not system.broken.any():
        return None
    bare, parted_at = laid_bare(system), Edges(system).parted_at(system.broken_at)
    return bare._replace(parted_at=np.where(np.isnan(bare.parted_at), parted_at, bare.parted_at))


def inside_of(triangles: NDArray[np.int32]) -> Surface:
    """Return triangles of particles, shape [triangle_count, 3], as a surface."""
    particle, corner = np.unique(triangles, return_inverse=True)
    return Surface(particle=particle, uv=np.zeros((len(particle), 2)), triangles=corner.reshape(-1, 3))


def inside_color(look: Look) -> NDArray[np.float64]:
    """Return the color of what is inside a body, 0 … 1, shape [3]: that of the look, or of the body's surface."""
    if look.inside is None and look.texture is not None:
        return np.asarray(look.texture).mean(axis=(0, 1)) / 255
    return np.array(checks.color("inside", look.inside or look.color))


def uncovered(system: System) -> NDArray[np.bool_]:
    """Return a mask of springs that no surface covers, shape [connection_count]: ropes, and ties between bodies.

    The springs of each entry of `System.directions` form a body, and so do those that join particles of no entry.
    A spring in no entry that joins two bodies, such as from a rope to a ball, belongs to neither.
    """
    connections, count, surface = system.connections, len(system.directions), system.surface
    bare, in_none = (np.ones(len(connections), dtype=bool) for _ in range(2))
    if surface is None:
        return bare
    carries = _carriers(system, surface)
    body_of = np.full(system.particle_count, -1)
    covered = np.zeros(count + system.particle_count, dtype=bool)
    for k, body in enumerate(system.directions):
        for part in body.values():
            body_of[connections[part]] = k
            covered[k] |= carries[connections[part]].any()
            in_none[part] = False
        for part in body.values():
            bare[part] = not covered[k]
    rest = connections[in_none]
    loose = body_of < 0
    own = pieces(system.particle_count, rest[loose[rest].all(axis=1)])
    body_of = np.where(loose, count + own, body_of)
    covered[body_of[carries & loose]] = True
    first, second = body_of[rest.T]
    bare[in_none] = ~covered[first] | (first != second)
    return bare


def single_particles(system: System) -> NDArray[np.bool_]:
    """Return a mask of particles without connections that carry no surface, shape [particle_count]."""
    alone = ~mask_of(system.connections.ravel(), system.particle_count)
    if system.surface is not None:
        alone &= ~_carriers(system, system.surface)
    return alone


def size_of_grains(system: System, alone: NDArray[np.bool_]) -> float:
    """Return a radius for single particles whose size nothing says [m]: so large that hardly any overlap.

    It is half of the median distance from the nearest other one, at most that of a ball of water of their mass.
    """
    mass, places = system.mass[alone], system.position[alone]
    mass = mass[np.isfinite(mass)]
    water = np.cbrt(np.median(mass) * 0.75 / np.pi / DENSITY) if len(mass) else np.inf
    asked = places[:: 1 + len(places) // SAMPLED]
    away = np.linalg.norm(asked[:, None] - places, axis=2)
    nearest = np.where(away > 0, away, np.inf).min(axis=1)
    size = min(float(water), 0.5 * float(np.median(nearest)))
    return size if np.isfinite(size) else PINNED_ALONE


def seams(system: System) -> NDArray[np.bool_]:
    """Return a mask of springs with both ends on surfaces, shape [connection_count]; of ties, these are seams."""
    if system.surface is None:
        return np.zeros(system.connection_count, dtype=bool)
    return np.asarray(_carriers(system, system.surface)[system.connections].all(axis=1))


def spacing_beside(system: System, ties: NDArray[np.integer]) -> float:
    """Return the median rest length [m] of the other springs of the particles that these connections join."""
    ends = mask_of(system.connections[ties], system.particle_count)
    beside = np.asarray(ends[system.connections].any(axis=1))
    beside[ties] = False
    return float(np.median(system.rest_length[beside if beside.any() else ties]))


def _carriers(system: System, surface: Surface) -> NDArray[np.bool_]:
    """Return a mask of the particles with which a surface moves, shape [particle_count]."""
    particle, weights = (each[np.unique(surface.triangles)] for each in surface.mixture)
    return mask_of(particle[weights != 0], system.particle_count)


def outermost_connections(system: System, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the springs on the outside of bodies, where those that are not `kept` are cut off.

    Both have the shape [connection_count]; the result is True for all springs if none is outside. If the vertices
    of the surface are particles, the springs join particles of the surface, or ends of springs that are cut off,
    or belong to bodies without surface. If the surface is missing, or embedded in a lattice, they join particles
    with fewer springs that are kept than the most that a particle has.
    """
    connections, surface = system.connections, system.surface
    if surface is not None and surface.weights is None:
        outside = mask_of(surface.particle, system.particle_count)
        outside[connections[uncovered(system) | ~kept]] = True
    else:
        neighbours = np.bincount(connections[kept].ravel(), minlength=system.particle_count)
        outside = neighbours < neighbours.max()
    chosen = np.asarray(outside[connections].all(axis=1))
    return chosen if chosen.any() else np.ones(len(connections), dtype=bool)


def atlas(images: Sequence[NDArray[np.uint8]]) -> tuple[NDArray[np.uint8], list[tuple[NDArray, NDArray]]]:
    """Stack several images into one, and return it with (c, s) for each: its uv becomes c + s uv.

    A frame around each image repeats its outermost pixels, so that interpolation at edges does not mix images.
    """
    framed = [np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge") for image in images]
    width, height = max(image.shape[1] for image in framed), sum(len(image) for image in framed)
    whole = np.zeros((height, width, 3), dtype=np.uint8)
    places, row = [], 0
    for image in framed:
        rows, columns, _ = image.shape
        whole[row : row + rows, :columns] = image
        corner = np.array([1 / width, 1 - (row + rows - 1) / height])
        places.append((corner, np.array([(columns - 2) / width, (rows - 2) / height])))
        row += rows
    return whole, places
