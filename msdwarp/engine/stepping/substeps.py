"""Stepper: takes the substeps of a frame, by a launch for each stage or by one for all."""

from collections.abc import Callable, Sequence
from typing import Literal

import warp as wp

from ... import checks
from ...kernels.integrators import MOST_THREADS
from ..model.state import State
from .dynamics import Dynamics
from .persistent import CLUSTER, launch_persistent, persistent_blocks
from .shared_memory import Chip, on_chip
from .stages import Solve, Stage
from .worlds import threads_of_world

Blocks = tuple[int, int] | Literal["auto"] | None
"""How many blocks of threads, and threads in each, take the substeps of a frame in one launch."""


class Stepper:
    """Takes substeps: by a launch for each stage or, where launches would be most of the time, by one for all.

    Parameters
    ----------
    dynamics
        Runs stages.
    state
        What they advance.
    stages
        Returns the stages of a substep that begins at the state's present instant.
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
        stages: Callable[[], Sequence[Stage | Solve]],
        *,
        behind_each: Callable[[int], None] | None = None,
        blocks: Blocks | int | str = "auto",
    ) -> None:
        self._dynamics, self._state, self._behind_each = dynamics, state, behind_each
        self._substeps = list[Sequence[Stage | Solve]]()
        """The stages of two substeps: each swaps the instants of the state, so the third equals the first."""
        for _ in range(2):
            self._substeps.append(stages())
            state.flip()
        self._chip: Chip | None = None
        model, chosen = dynamics.model, blocks == "auto"
        if model.in_worlds:
            assert not isinstance(blocks, tuple)
            threads = threads_of_world(dynamics.assembly, blocks)
            blocks = None if threads is None else (model.worlds, threads)
        elif blocks == "auto":
            blocks = persistent_blocks(model, dynamics.composition.force_algorithm.lanes)
        assert not isinstance(blocks, int | str)
        everything = [one for substep in self._substeps for one in substep]
        only_stages = [one for one in everything if isinstance(one, Stage)]
        launches_between = behind_each is not None or dynamics.launches_before_forces
        one_launch = len(only_stages) == len(everything) and not launches_between
        self.blocks: tuple[int, int] | None = blocks if one_launch else None
        """How many blocks of threads, and threads in each, take all substeps in one launch; None where none do."""
        if self.blocks is None and not (model.in_worlds and one_launch and chosen):
            return
        self._method, self._per_substep = only_stages[0].method, len(only_stages) // 2
        self._kept = [one.step(dynamics.composition) for one in only_stages]
        if model.in_worlds and chosen:
            self._chip = on_chip(dynamics, state, self._method, self._kept[: self._per_substep])
        if self._chip is not None:
            self.blocks = model.worlds, self._chip.threads
        elif self.blocks is not None:
            self._kernel = dynamics.persistent(self._method, *self.blocks)
            Step = self._method(dynamics.composition).Step
            self._steps = wp.array(self._kept, dtype=Step, device=model.device)

    def take(self, substeps: int, first: int = 0) -> None:
        """Take substeps, from number `first` of a frame on; the state then lies where it lay before."""
        if self.blocks is None:
            for k in range(substeps):
                self._dynamics.begin_substep(self._state, first + k)
                for stage in self._substeps[k % 2]:
                    self._dynamics.run(stage)
                self._state.flip()
                if self._behind_each is not None:
                    self._behind_each(first + k)
        else:
            self._take_at_once(*self.blocks, substeps * self._per_substep, first)
            if substeps % 2 and self._chip is None:
                self._state.flip()
        self._dynamics.rest()
        self._state.settle()

    def _take_at_once(self, blocks: int, threads: int, stages: int, first: int) -> None:
        """Take stages from substep number `first` on in one launch, or in one for each thread of the CPU."""
        dynamics, partition = self._dynamics, self._dynamics.partition
        dynamics.go_to(first)
        if partition is not None and partition.is_recording:
            partition.launch(self._method, dynamics.scene, self._steps, stages)
        elif self._chip is not None:
            self._chip.launch(dynamics, self._method, stages)
        else:
            launch_persistent(self._kernel, dynamics.model, dynamics.scene, self._steps, stages, blocks, threads)
        dynamics.have_begun()


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
