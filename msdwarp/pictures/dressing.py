"""Dressing: which look each part of a body has, and which connections are drawn although there is a surface.

Looks are numbered: 0 is the scene's, and those of groups follow in their order. Where several meet the later one
counts.
"""

import numpy as np
from numpy.typing import NDArray

from ..bodies import Surface, System, pieces
from ..world import Scene


def look_of_particles(scene: Scene) -> NDArray[np.int32]:
    """Return the number of each particle's look, shape [particle_count]."""
    look = np.zeros(scene.system.particle_count, dtype=np.int32)
    for k, name in enumerate(scene.looks, start=1):
        look[scene.system.groups[name]] = k
    return look


def look_of_triangles(surface: Surface, look_of: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the number of each triangle's look, shape [triangle_count], by those of particles."""
    own = look_of[surface.particle]
    if surface.weights is not None:
        own = np.where(surface.weights != 0, own, 0).max(axis=1)
    return own[surface.triangles].max(axis=1)


def part_of(surface: Surface, chosen: NDArray[np.bool_]) -> Surface:
    """Return some triangles of a surface, shape [triangle_count], with the vertices that they need."""
    if chosen.all():
        return surface
    needed = np.unique(surface.triangles[chosen])
    if surface.normal_of is not None:
        needed = np.union1d(needed, surface.normal_of[needed])
    number = np.zeros(len(surface.particle), dtype=np.int32)
    number[needed] = np.arange(len(needed))
    return Surface(
        particle=surface.particle[needed],
        weights=None if surface.weights is None else surface.weights[needed],
        uv=surface.uv[needed],
        triangles=number[surface.triangles[chosen]],
        normal_of=None if surface.normal_of is None else number[surface.normal_of[needed]],
    )


def uncovered(system: System) -> NDArray[np.bool_]:
    """Return which connections lie inside no body that has a surface, shape [connection_count].

    These are the connections of bodies without a triangle, such as ropes, and those between bodies. A body is what
    connections in lattice directions hold together; particles that have no such connection are one body with those
    that their other connections lead to. So what ties a rope to a ball lies in neither.
    """
    connections, surface = system.connections, system.surface
    if surface is None:
        return np.ones(len(connections), dtype=bool)
    in_lattice = np.zeros(len(connections), dtype=bool)
    for body in system.directions:
        for part in body.values():
            in_lattice[part] = True
    of_lattice = np.zeros(system.particle_count, dtype=bool)
    of_lattice[connections[in_lattice]] = True
    within = in_lattice | ~of_lattice[connections].any(axis=1)
    body_of = pieces(system.particle_count, connections[within])
    first, second = body_of[connections.T]

    carriers = surface.particle[np.unique(surface.triangles)]
    if surface.weights is not None:
        carriers = carriers[surface.weights[np.unique(surface.triangles)] != 0]
    covered = np.zeros(system.particle_count, dtype=bool)
    covered[body_of[carriers]] = True  # at the particle that a body is numbered by
    return ~covered[first] | (first != second)
