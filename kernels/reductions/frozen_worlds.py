"""Freeze diverged worlds, by the rule of `engine/diagnostics/divergence_monitor.py`; restore their state."""

import warp as wp

from ..basis import kernel
from . import columns
from .columns import NONE

RUNNING, NOT_FINITE, ENERGY = 0, 1, 2
"""Values of a world's status."""


@kernel
def judge(
    found: wp.array2d(dtype=wp.float64),  # by `sum_up`, shape [worlds, LOOKED or more]
    before: wp.array(dtype=wp.float64),  # work to add to the sums [J], shape [worlds]
    most: wp.array(dtype=wp.float64),  # allowed kinetic plus gravitational energy of a world [J], shape [worlds]
    # In and out:
    frozen: wp.array(dtype=wp.int32),  # status of each world, shape [worlds]
    good_frames: wp.array(dtype=int),  # shape [worlds]
    particle: wp.array(dtype=int),  # first particle that is not finite, or NONE, shape [worlds]
    most_work: wp.array(dtype=wp.float64),  # largest work so far [J], shape [worlds]
):
    """Freeze worlds that have diverged in the last frame; count the successful frames of other worlds."""
    w = wp.tid()
    if frozen[w] != wp.static(RUNNING):
        return
    work = before[w] + found[w, wp.static(columns.WORK)]
    energy = found[w, wp.static(columns.KINETIC)] + found[w, wp.static(columns.POTENTIAL)] - work
    # Work has errors of first order in the step, which remain after forces have taken it back.
    most_work[w] = wp.max(most_work[w], wp.abs(work))
    particle[w] = int(-found[w, wp.static(columns.FIRST)])
    if particle[w] < wp.static(NONE):
        frozen[w] = wp.static(NOT_FINITE)
    elif not (energy <= most[w] + most_work[w]):
        frozen[w] = wp.static(ENERGY)
    else:
        good_frames[w] = good_frames[w] + 1


@kernel
def put_back(
    frozen: wp.array(dtype=wp.int32),  # shape [worlds]
    threads: int,  # per world
    kept: wp.array2d(dtype=wp.uint32),  # words at the frame's start, shape [worlds, word_count]
    # Out:
    live: wp.array2d(dtype=wp.uint32),
):
    """Restore frozen worlds to their state at the frame's start."""
    w, i = wp.tid()
    if frozen[w] == wp.static(RUNNING):
        return
    while i < live.shape[1]:
        live[w, i] = kept[w, i]
        i += threads
