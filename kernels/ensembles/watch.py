"""Watching all worlds from the device: which of them have diverged, and their state put back."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..reductions import free_energies

RUNNING, NOT_FINITE, ENERGY = 0, 1, 2
"""What has become of a world."""


@functools.cache
def look_over_worlds(dim: int, scalar: type):
    """Compose the kernel, over worlds and lanes, that sums energies and finds the first particle not finite.

    Each lane sums the kinetic and gravitational energies of a share of its world's particles, in float64, strided;
    pinned ones have none. What constant forces can do is counted as gravity's.
    """
    V, energies_of = vector(dim, scalar), free_energies(dim, scalar)

    @kernel
    def look_over_each(
        # Model:
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], 0 where pinned, shape [rows, particle_count]
        gravity: wp.array(dtype=V),  # [m/s²], shape [rows]
        steady: wp.array(dtype=V),  # constant force on each particle [N], shape [particle_count]; or [0]: none
        # State in:
        x: wp.array(dtype=V),  # positions [m], of all worlds
        v: wp.array(dtype=V),  # velocities [m/s], of all worlds
        stride: int,  # from one world to the next, in particles
        # Out:
        first: wp.array2d(dtype=int),  # particle_count where all are finite, shape [world_count, lane_count]
        energies: wp.array3d(dtype=wp.float64),  # [J], shape [world_count, lane_count, 2]
    ):
        w, lane = wp.tid()
        count = inverse_mass.shape[1]
        g = gravity[w % gravity.shape[0]]
        found = count
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        i = lane
        while i < count:
            x_i = x[w * stride + i]
            v_i = v[w * stride + i]
            if not (wp.isfinite(x_i) and wp.isfinite(v_i)):
                found = wp.min(found, i)
            if steady.shape[0] > 0:
                for k in range(wp.static(dim)):
                    potential -= wp.float64(steady[i][k]) * wp.float64(x_i[k])
            moves, falls = energies_of(inverse_mass[w % inverse_mass.shape[0], i], g, x_i, v_i)
            kinetic += moves
            potential += falls
            i += energies.shape[1]
        first[w, lane] = found
        energies[w, lane, 0] = kinetic
        energies[w, lane, 1] = potential

    return look_over_each


@kernel
def judge(
    # What was found out:
    first: wp.array2d(dtype=int),  # particle_count where all are finite, shape [world_count, lane_count]
    energies: wp.array3d(dtype=wp.float64),  # [J], shape [world_count, lane_count, 2]
    most: wp.array(dtype=wp.float64),  # that a world may have of them [J], shape [world_count]
    particle_count: int,
    frame: wp.array(dtype=int),  # frames before this one, shape [1]
    # In and out:
    frozen: wp.array(dtype=wp.int32),  # RUNNING, or what has become of a world, shape [world_count]
    found: wp.array2d(dtype=int),  # shape [2, world_count]: in which frame, counted from 0, and at which particle
):
    """Freeze the worlds whose last frame has gone wrong."""
    w = wp.tid()
    if frozen[w] != wp.static(RUNNING):
        return
    total = wp.float64(0.0)
    least = particle_count
    for lane in range(first.shape[1]):
        total += energies[w, lane, 0] + energies[w, lane, 1]
        least = wp.min(least, first[w, lane])
    if least < particle_count:
        frozen[w] = wp.static(NOT_FINITE)
    elif not (total <= most[w]):
        frozen[w] = wp.static(ENERGY)
    if frozen[w] != wp.static(RUNNING):
        found[0, w] = frame[0]
        found[1, w] = least


@functools.cache
def put_back(dim: int, scalar: type):
    """Compose the kernel, over worlds and particles, that puts frozen worlds back to where their frame began."""
    V = vector(dim, scalar)

    @kernel
    def put_frozen_back(
        frozen: wp.array(dtype=wp.int32),  # shape [world_count]
        stride: int,  # from one world to the next, in particles
        kept: wp.array(dtype=V),
        # Out:
        live: wp.array(dtype=V),
    ):
        w, i = wp.tid()
        if frozen[w] != wp.static(RUNNING):
            live[w * stride + i] = kept[w * stride + i]

    return put_frozen_back


@kernel
def next_frame(frame: wp.array(dtype=int)):
    """Count a frame."""
    frame[0] = frame[0] + 1
