"""Single launches of many stages, by a block or a cluster of blocks on a GPU, or one CPU thread."""

from typing import Any

import warp as wp

from ...kernels.integrators.persistent import MOST_THREADS, NOTHING_BEFORE
from ...kernels.threads import Part
from ..model.model import Model
from .stages import stages_for
from .world_differences import power_of_two

MOST_IN_ONE_BLOCK = 350
"""With more particles, or connections, a cluster of blocks is faster than one block."""
CLUSTER = 8
"""Blocks in a cluster: the largest number that every GPU with clusters allows."""
MOST_IN_CLUSTER = {"scatter": 12_000, "gather": 2_048, "stencil": 4_096}
"""With more connections, or particles, a launch per stage is faster."""


def whole(model: Model, threads: int) -> Any:
    """Return the part of a launch that advances a whole body, or each world, by so many threads."""
    part: Any = Part()
    part.last, part.last_spring, part.stride = model.particle_count, model.connection_count, threads
    return part


def launch_persistent(
    kernel: Any, model: Model, scene: Any, steps: wp.array, stages: int, blocks: int, threads: int
) -> None:
    """Launch `stages` stages, in the order of `steps`, by `blocks` blocks of `threads` threads."""
    total, part = blocks * threads, whole(model, threads if model.in_worlds else blocks * threads)
    inputs = [scene, stages_for(kernel, steps), stages, part, NOTHING_BEFORE.Data()]
    wp.launch(kernel, total, inputs, device=model.device, block_dim=threads)


def persistent_blocks(model: Model, lanes: int = 1) -> tuple[int, int] | None:
    """Return (blocks, threads per block) for one launch of all stages; None if a launch per stage is faster.

    `lanes` threads share a particle.
    """
    device = model.device
    if not device.is_cuda:
        return 1, 1
    work = model.connection_count if model.force_algorithm == "scatter" else model.particle_count * lanes
    if work <= MOST_IN_ONE_BLOCK:
        return 1, power_of_two(work)
    most = MOST_IN_CLUSTER[model.force_algorithm] if lanes == 1 else CLUSTER * MOST_THREADS
    if device.arch < 90 or work > most:
        return None
    return CLUSTER, min(MOST_THREADS, power_of_two(-(-work // CLUSTER)))
