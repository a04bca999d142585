"""Watching all worlds from the device: which of them have diverged, and their state put back."""

import functools

import warp as wp

from ..basis import kernel, vector
from .divergence import free_energies

RUNNING, NOT_FINITE, ENERGY = 0, 1, 2
"""What has become of a world."""


@functools.cache
def look_over_worlds(dim: int, scalar: type):
    """Compose the kernel, over worlds and lanes, that sums energies and finds the first particle not finite.

    Each lane sums the kinetic and gravitational energies of a share of its world's particles, in float64, strided;
    pinned ones have none.
    """
    V, energies_of = vector(dim, scalar), free_energies(dim, scalar)

    @kernel
    def look_over_each(
        # Model:
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], 0 where pinned, shape [rows, particle_count]
        gravity: wp.array(dtype=V),  # [m/s²], shape [rows]
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
    work: wp.array(dtype=wp.float64),  # of loads [J], as many shares for each world; of shape [0] where none work
    before: wp.array(dtype=wp.float64),  # what is to be added to these [J], shape [world_count]
    most: wp.array(dtype=wp.float64),  # that a world may have of them [J], shape [world_count]
    particle_count: int,
    frame: wp.array(dtype=int),  # frames before this one, shape [1]
    # In and out:
    frozen: wp.array(dtype=wp.int32),  # RUNNING, or what has become of a world, shape [world_count]
    found: wp.array2d(dtype=int),  # shape [2, world_count]: in which frame, counted from 0, and at which particle
    most_work: wp.array(dtype=wp.float64),  # largest work so far [J], shape [world_count]
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
    allowed = most[w]
    if work.shape[0] > 0:
        done = before[w]
        threads = work.shape[0] / frozen.shape[0]
        for k in range(threads):
            done += work[w * threads + k]
        total -= done
        # Work is known to first order in the step only, also what has come back.
        most_work[w] = wp.max(most_work[w], wp.abs(done))
        allowed += most_work[w]
    if least < particle_count:
        frozen[w] = wp.static(NOT_FINITE)
    elif not (total <= allowed):
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
def put_parts_back(
    frozen: wp.array(dtype=wp.int32),  # shape [world_count]
    kept: wp.array(dtype=wp.uint8),  # as many bytes for each world
    # Out:
    live: wp.array(dtype=wp.uint8),
):
    """Put back, byte by byte, what frozen worlds had in an array where their frame began."""
    b = wp.tid()
    if frozen[b / (live.shape[0] / frozen.shape[0])] != wp.static(RUNNING):
        live[b] = kept[b]


@kernel
def next_frame(frame: wp.array(dtype=int)):
    """Count a frame."""
    frame[0] = frame[0] + 1
