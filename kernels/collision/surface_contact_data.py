"""Device data of contact between facets and obstacles, the forces on particles, and sums of forces and powers."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..colliders.signed_distance import solids
from ..effect import ForceTerm, instant

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
        first: wp.array(dtype=int)  # row starts of particle and weight, shape [vertex_count + 1]
        particle: wp.array(dtype=int)  # shape [any]
        weight: wp.array(dtype=scalar)  # of each particle, shape [any]
        mobility: wp.array(dtype=scalar)  # Σ weight² / mass [1/kg], shape [vertex_count]
        # Facets, of shape [facet_count] unless noted:
        corner: wp.array(dtype=wp.vec3i)  # its three vertices
        stiffness: wp.array(dtype=scalar)  # of each sample on it [N/m]
        whole: wp.array(dtype=scalar)  # of all samples around a vertex [N/m]
        slack: wp.array(dtype=scalar)  # smaller depths are rounding errors [m], less the radius of the shell
        tangential_displacement: wp.array2d(dtype=V)  # along contact_body [m], shape [HISTORY, facet_count]
        contact_body: wp.array2d(dtype=int)  # obstacle that the facet touches, −1: none
        way: wp.array2d(dtype=V)  # normal of the entry side if the facet is deep, else 0
        level: wp.array2d(dtype=scalar)  # offset of the entry side along `way`, in the obstacle's given pose [m]
        initial_overlap: wp.array(dtype=scalar)  # depth at the start that is still allowed [m]
        overlap_release_speed: scalar  # rate at which initial_overlap shrinks [m/s]
        power: wp.array(dtype=wp.float64)  # power of the obstacles on it [W]
        force: wp.array2d(dtype=wp.int64)  # on particles, in units, shape [particle_count, 3]
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


@functools.cache
def surface_contact_term(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the force term of contact between facets and obstacles."""
    V = vector(dim, scalar)
    Instant = instant(dim, scalar, compensated)

    @wp.struct
    class Pushed:
        force: wp.array2d(dtype=wp.int64)  # in units, shape [particle_count, 3]
        unit: wp.float64  # [N]

    @wp.func
    def push(data: Pushed, now: Instant, i: int) -> V:
        total = V()
        for k in range(wp.static(dim)):
            total[k] = scalar(wp.float64(data.force[i, k]) * data.unit)
        return total

    return ForceTerm("surface_contact", Pushed, force=push, selective=True)


@functools.cache
def add_pushes(scalar: type):
    """Compose the kernel, over particles, that sums the impulses of obstacles' forces on facets.

    Forces act for `seconds`. The sums are impulses per mass [m/s], in float64.
    """
    Wide = vector(3, wp.float64)

    @kernel
    def add_push(
        force: wp.array2d(dtype=wp.int64),  # in units, shape [particle_count, 3]
        unit: wp.float64,  # [N]
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], shape [particle_count]
        seconds: wp.float64,  # duration for which the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # per mass [m/s], shape [particle_count]
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
    """Add to each work in `done` the power times `seconds`."""
    i = wp.tid()
    done[i] = done[i] + seconds * power[i]
