"""Stepper: takes substeps, by a launch for each stage or one for all."""

from collections.abc import Callable

import warp as wp

from ..kernels.integrators import MOST_THREADS, persistent
from .dynamics import Dynamics
from .model import Model
from .state import State

MOST_IN_ONE_BLOCK = 350
"""More particles, or connections, are faster in a cluster of blocks that wait for each other."""
CLUSTER = 8
"""Blocks in a cluster: as many as every GPU that has clusters allows."""
MOST_IN_CLUSTER = {"scatter": 12_000, "gather": 2_048, "stencil": 2_048}
"""More connections, or particles, are faster with a launch for each stage."""


class Stepper:
    """Takes substeps: by a launch for each stage or, where launches would be most of the time, by one for all.

    Parameters
    ----------
    dynamics
        What launches.
    state
        What it moves.
    take_substep
        A method's `step`, for this state.
    one_kernel
        Whether all that a substep launches is stages of one method.
    """

    def __init__(
        self, dynamics: Dynamics, state: State, take_substep: Callable[[], None], *, one_kernel: bool = True
    ) -> None:
        self._dynamics, self._state, self._take_substep = dynamics, state, take_substep
        blocks = staying_blocks(dynamics.model) if one_kernel else None
        self._stays = blocks is not None
        if blocks is None:
            return
        # Each substep flips the state: the third is the first again.
        stages = dynamics.record(lambda: (take_substep(), take_substep()))
        (method, _), device = stages[0], dynamics.model.device
        self._per_substep = len(stages) // 2
        self._kernel, self._blocks = persistent(dynamics.motion, method, blocks[0]), blocks
        self._kept = [step for _, step in stages]
        self._steps = wp.array(self._kept, dtype=method(dynamics.motion).Step, device=device)

    def take(self, substeps: int, first: int = 0) -> None:
        """Take substeps, from number `first` of a frame on; the state then lies where it lay before."""
        if not self._stays:
            for k in range(substeps):
                self._dynamics.begin_substep(self._state, first + k)
                self._take_substep()
        else:
            self._stay(substeps * self._per_substep, first)
            if substeps % 2:
                self._state.flip()
        self._state.settle()

    def _stay(self, stages: int, first: int) -> None:
        model, (blocks, threads) = self._dynamics.model, self._blocks
        everyone = blocks * threads
        self._dynamics.move_colliders(first)
        wp.launch(
            self._kernel,
            dim=everyone,
            inputs=[self._dynamics.world, self._steps, stages, model.connection_count, everyone],
            device=model.device,
            block_dim=threads,
        )


def staying_blocks(model: Model) -> tuple[int, int] | None:
    """Return (blocks, threads in each) with which a body is best advanced in one launch; None where it is not."""
    device = model.device
    if not device.is_cuda:
        return 1, 1
    work = model.connection_count if model.route == "scatter" else model.particle_count
    if work <= MOST_IN_ONE_BLOCK:
        return 1, _power_of_two(work)
    if device.arch < 90 or work > MOST_IN_CLUSTER[model.route]:
        return None
    return CLUSTER, min(MOST_THREADS, _power_of_two(-(-work // CLUSTER)))


def _power_of_two(threads: int) -> int:
    """Return so many threads or more, of few different numbers: a kernel is compiled for each."""
    return max(32, 1 << (threads - 1).bit_length())
