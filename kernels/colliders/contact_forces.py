"""Contact forces on particles: the sum over obstacles and other bodies."""

import functools

import warp as wp

from ..basis import kernel, vector


@functools.cache
def sum_impulses(dim: int):
    """Compose the kernel, over particles, that sums the impulses of obstacles and of other bodies."""
    Wide = vector(dim, wp.float64)

    @kernel
    def sum_up(
        mass: wp.array(dtype=wp.float64),  # [kg], 0 if obstacles cannot move the particle, shape [particle_count]
        by_obstacles: wp.array(dtype=Wide),  # per mass [m/s], shape [particle_count]
        by_bodies: wp.array(dtype=Wide),  # [N s], shape [particle_count]
        # Out:
        impulse: wp.array(dtype=Wide),  # [N s], shape [particle_count]
    ):
        i = wp.tid()
        impulse[i] = mass[i] * by_obstacles[i] + by_bodies[i]

    return sum_up


@functools.cache
def mean_forces(dim: int, scalar: type):
    """Compose the kernel, over particles, that divides impulses by a duration to get mean forces."""
    V, Wide = vector(dim, scalar), vector(dim, wp.float64)

    @kernel
    def take_means(
        impulse: wp.array(dtype=Wide),  # [N s], shape [particle_count]
        seconds: wp.float64,  # [s]
        # Out:
        force: wp.array(dtype=V),  # [N], shape [particle_count]
    ):
        i = wp.tid()
        force[i] = V(impulse[i] / seconds)

    return take_means
