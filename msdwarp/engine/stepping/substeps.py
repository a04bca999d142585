"""Stepper: takes substeps, by a launch for each stage or one for all."""

from collections.abc import Callable
from typing import Literal

import warp as wp

from ... import checks
from ...kernels.integrators import MOST_THREADS
from ..model.model import Model
from ..model.state import State
from .launcher import Dynamics
from .shared_memory import Chip, on_chip
from .worlds import power_of_two, threads_of_world

Blocks = tuple[int, int] | Literal["auto"] | None
"""How many blocks of threads, and threads in each, take the substeps of a frame in one launch."""
MOST_IN_ONE_BLOCK = 350
"""More particles, or connections, are faster in a cluster of blocks that wait for each other."""
CLUSTER = 8
"""Blocks in a cluster: as many as every GPU that has clusters allows."""
MOST_IN_CLUSTER = {"scatter": 12_000, "gather": 2_048, "stencil": 4_096}
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
    behind_each
        Launches what looks at the state behind each substep, given its number in the frame; None for nothing.
    blocks
        Blocks of threads, and threads in each, that take all substeps in one launch; None for a launch for each
        stage; "auto" for what was faster where it was measured. In an ensemble the threads of a world's block.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        take_substep: Callable[[], None],
        *,
        one_kernel: bool = True,
        behind_each: Callable[[int], None] | None = None,
        blocks: Blocks | int | str = "auto",
    ) -> None:
        self._dynamics, self._state, self._take_substep = dynamics, state, take_substep
        self._behind_each = behind_each
        self._chip: Chip | None = None
        model, chosen = dynamics.model, blocks == "auto"
        if model.in_worlds:
            assert not isinstance(blocks, tuple)
            threads = threads_of_world(dynamics.assembly, blocks)
            blocks = None if threads is None else (model.worlds, threads)
        elif blocks == "auto":
            blocks = persistent_blocks(model, dynamics.composition.force_algorithm.lanes)
        assert not isinstance(blocks, int | str)
        one_kernel = one_kernel and behind_each is None and not dynamics.launches_before_forces
        self.blocks: tuple[int, int] | None = blocks if one_kernel else None
        """How many blocks of threads, and threads in each, take all substeps in one launch; None where none do."""
        if self.blocks is None and not (model.in_worlds and one_kernel and chosen):
            return
        # Each substep flips the state: the third is the first again.
        stages = dynamics.record(lambda: (take_substep(), take_substep()))
        (method, _), self._per_substep = stages[0], len(stages) // 2
        self._method, self._kept = method, [step for _, step in stages]
        if model.in_worlds and chosen:
            self._chip = on_chip(dynamics, state, method, self._kept[: self._per_substep])
        if self._chip is not None:
            self.blocks = model.worlds, self._chip.threads
        elif self.blocks is not None:
            self._kernel = dynamics.persistent(method, *self.blocks)
            self._steps = wp.array(self._kept, dtype=method(dynamics.composition).Step, device=model.device)

    def take(self, substeps: int, first: int = 0) -> None:
        """Take substeps, from number `first` of a frame on; the state then lies where it lay before."""
        if self.blocks is None:
            for k in range(substeps):
                self._dynamics.begin_substep(self._state, first + k)
                self._take_substep()
                if self._behind_each is not None:
                    self._behind_each(first + k)
        else:
            self._persist(*self.blocks, substeps * self._per_substep, first)
            if substeps % 2 and self._chip is None:
                self._state.flip()
        self._dynamics.rest()
        self._state.settle()

    def _persist(self, blocks: int, threads: int, stages: int, first: int) -> None:
        model, everyone = self._dynamics.model, blocks * threads
        self._dynamics.go_to(first)
        partition = self._dynamics.partition
        if partition is not None and partition.is_recording:
            partition.launch(self._method, self._dynamics.scene, self._steps, stages)
        elif self._chip is not None:
            self._chip.launch(self._dynamics, self._method, stages)
        else:
            share = threads if model.in_worlds else everyone
            inputs = [self._dynamics.scene, self._steps, stages, model.connection_count, share]
            wp.launch(self._kernel, everyone, inputs, device=model.device, block_dim=threads)
        self._dynamics.have_begun()


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


def check_blocks(blocks: Blocks, *, on_gpu: bool) -> None:
    """Raise ValueError unless `blocks` is "auto", None, or two numbers that the device can do with."""
    if blocks is None or blocks == "auto":
        return
    if not isinstance(blocks, tuple) or len(blocks) != 2:
        raise ValueError(f"blocks is {blocks!r}; it must be 'auto', None, or (blocks, threads in each)")
    most = (CLUSTER, MOST_THREADS) if on_gpu else (1, 1)
    for k, (number, limit) in enumerate(zip(blocks, most, strict=True)):
        if checks.count(f"blocks[{k}]", number, 1) > limit:
            where = "on a GPU" if on_gpu else "on the CPU"
            raise ValueError(f"blocks[{k}] is {number}; it must be at most {limit} {where}")
