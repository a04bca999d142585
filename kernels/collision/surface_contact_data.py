"""Facets on obstacles, on a device: the facets, the obstacles, and the forces on particles with their sums."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..colliders import solids
from ..compensation import compensated_sum
from ..effect import ForceTerm

SIDES = 12
"""Parts of each side of a facet."""
QUADRATURE_POINTS = (SIDES + 1) * (SIDES + 2) // 2
"""Places on a facet that are looked at."""


def quadrature_weights() -> list[tuple[float, float, float]]:
    """Return the shares of the corners in each of the places on a facet, shape [PLACES, 3]."""
    rows = [(i, j) for i in range(SIDES + 1) for j in range(SIDES + 1 - i)]
    return [((SIDES - i - j) / SIDES, i / SIDES, j / SIDES) for i, j in rows]


@functools.cache
def SurfaceContactData(scalar: type, moving: bool):
    """Compose the struct of facets, and of the obstacles that they may lie on."""
    V, Solids, Turn = vector(3, scalar), solids(3, scalar), wp.types.matrix((3, 3), scalar)

    @wp.struct
    class FacetsAndObstacles:
        place: wp.array(dtype=V)  # shares of the corners in each place, shape [PLACES]
        # Vertices, mixtures of particles, as `place_vertices` has them:
        x: wp.array(dtype=V)  # where each is [m], shape [vertex_count]
        v: wp.array(dtype=V)  # how fast [m/s]
        first: wp.array(dtype=int)  # where the particles of each begin, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # the share of each, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        # Facets, of shape [facet_count] unless noted:
        corner: wp.array(dtype=wp.vec3i)  # the vertices of each
        stiffness: wp.array(dtype=scalar)  # of each place on it [N/m]
        whole: wp.array(dtype=scalar)  # of all around a vertex [N/m]
        slack: wp.array(dtype=scalar)  # how deep is none yet, for roundings [m]
        tangential_displacement: wp.array2d(
            dtype=V
        )  # how far it was moved along what it touches [m], shape [HISTORY, facet_count]
        contact_body: wp.array2d(dtype=int)  # which obstacle that is, −1: none
        way: wp.array2d(dtype=V)  # if it is deep in it, the normal of the side that it came in by, else 0
        level: wp.array2d(dtype=scalar)  # and where that side is along it, in the obstacle as given [m]
        initial_overlap: wp.array(dtype=scalar)  # how deep it may still lie, since it did at the start [m]
        overlap_release_speed: scalar  # how fast that shrinks [m/s]
        power: wp.array(dtype=wp.float64)  # power of the obstacles on it [W]
        force: wp.array2d(dtype=wp.int64)  # on particles, in units, shape [particle_count, 3]
        # Obstacles:
        solid: wp.array(dtype=int)  # which of them are no planes, shape [solid_count]
        solids: Solids  # the shapes of all
        lower: wp.array(dtype=V)  # boxes around all as they were given [m], shape [obstacle_count]
        upper: wp.array(dtype=V)
        friction: wp.array(dtype=scalar)  # of each
        damping: wp.array(dtype=scalar)  # damping ratio, from its restitution
        thin: wp.array(dtype=scalar)  # how deep in it the nearest side may be another one [m]
        if moving:  # where each is at the ends of substeps, see `collider_contact`
            turn: wp.array2d(dtype=Turn)
            shift: wp.array2d(dtype=V)
            turning: wp.array2d(dtype=Turn)
            speed: wp.array2d(dtype=V)

    return FacetsAndObstacles


@functools.cache
def surface_contact_term(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of facets on obstacles: the forces on particles."""
    V = vector(dim, scalar)
    Compensation, _ = compensated_sum(dim, scalar, compensated)

    @wp.struct
    class Pushed:
        force: wp.array2d(dtype=wp.int64)  # in units, shape [particle_count, 3]
        unit: wp.float64  # [N]

    def force(SceneData: Any):
        @wp.func
        def push(
            scene: SceneData, compensation: Compensation, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int
        ) -> V:
            total = V()
            for k in range(wp.static(dim)):
                total[k] = scalar(wp.float64(scene.surface_contact.force[i, k]) * scene.surface_contact.unit)
            return total

        return push

    return ForceTerm("surface_contact", Pushed, force=force, selective=True)


@functools.cache
def add_pushes(scalar: type):
    """Compose the kernel, over particles, that adds the forces of obstacles on facets to impulses.

    That is summed by mass, in float64.
    """
    Wide = vector(3, wp.float64)

    @kernel
    def add_push(
        force: wp.array2d(dtype=wp.int64),  # in units, shape [particle_count, 3]
        unit: wp.float64,  # [N]
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], shape [particle_count]
        seconds: wp.float64,  # how long the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # by mass [m/s], shape [particle_count]
    ):
        i = wp.tid()
        by_mass = seconds * unit * wp.float64(inverse_mass[i])
        total = Wide()
        for k in range(3):
            total[k] = by_mass * wp.float64(force[i, k])
        impulse[i] = impulse[i] + total

    return add_push


@kernel
def add_energies(
    power: wp.array(dtype=wp.float64),  # [W], shape [any]
    seconds: wp.float64,  # [s]
    # In and out:
    done: wp.array(dtype=wp.float64),  # [J], shape [any]
):
    """Add the energies of powers over some time."""
    i = wp.tid()
    done[i] = done[i] + seconds * power[i]
