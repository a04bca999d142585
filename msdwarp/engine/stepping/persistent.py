"""Many stages in one launch: by a block or a cluster of threads on a GPU, by one thread on the CPU."""

from typing import Any

import warp as wp

from ...kernels.integrators import MOST_THREADS, Composition, persistent
from ..model.model import Model
from .assemble import Assembly
from .worlds import power_of_two, threads_at_a_time

MOST_IN_ONE_BLOCK = 350
"""More particles, or connections, are faster in a cluster of blocks that wait for each other."""
CLUSTER = 8
"""Blocks in a cluster: as many as every GPU that has clusters allows."""
MOST_IN_CLUSTER = {"scatter": 12_000, "gather": 2_048, "stencil": 4_096}
"""More connections, or particles, are faster with a launch for each stage."""


def persistent_kernel(assembly: Assembly, composition: Composition, method: Any, blocks: int, threads: int) -> Any:
    """Return the kernel of a method's stages by blocks of threads; a world takes one block."""
    if assembly.model.in_worlds:
        return persistent(composition, method, 1, threads, threads_at_a_time(assembly))
    return persistent(composition, method, blocks)


def launch_persistent(
    kernel: Any, model: Model, scene: Any, steps: wp.array, stages: int, blocks: int, threads: int
) -> None:
    """Launch `stages` stages, which `steps` holds in turn, by `blocks` blocks of `threads` threads."""
    everyone = blocks * threads
    inputs = [scene, steps, stages, model.connection_count, threads if model.in_worlds else everyone]
    wp.launch(kernel, everyone, inputs, device=model.device, block_dim=threads)


def persistent_blocks(model: Model, lanes: int = 1) -> tuple[int, int] | None:
    """Return (blocks, threads in each) with which a body is best advanced in one launch; None where it is not.

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
