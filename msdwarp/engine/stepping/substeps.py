"""Stepper: advances by the substeps of a frame, with a launch per stage or one launch for all stages.

`integrators/stability.py` and `simulation/substep_controller.py` choose their length and number.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import warp as wp

from ... import checks
from ...kernels.integrators.persistent import MOST_THREADS
from ..model.state import State
from ..springs.linearised import note_products
from .contact_launch import ContactLaunch, contact_launch
from .dynamics import Dynamics
from .persistent import CLUSTER, launch_persistent, persistent_blocks
from .repetition import DIFFERENT, repetitions
from .shared_memory import Chip, on_chip
from .stages import Solve, Stage
from .substep import take_substep
from .world_differences import threads_of_world

Blocks = tuple[int, int] | Literal["auto"] | None
"""Number of blocks, and of threads per block, for one launch of all substeps of a frame."""


class Stepper:
    """Advances by substeps: a launch per stage or, if launches would dominate the time, one launch for all.

    `stages` returns the stages of a substep from the current `state.state_in`. `after_substep` launches
    measurements after each substep, given its index in the frame. `blocks` is None for a launch per stage, and
    "auto" for the faster option; for an ensemble it is the number of threads of a world's block.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        stages: Callable[[], Sequence[Stage | Solve]],
        *,
        after_substep: Callable[[int], None] | None = None,
        blocks: Blocks | int | str = "auto",
    ) -> None:
        self._dynamics, self._state, self._after_substep = dynamics, state, after_substep
        self._substeps = list[Sequence[Stage | Solve]]()
        """The stages of two substeps. Each swaps `state_in` and `state_out`, so the third equals the first."""
        for _ in range(2):
            self._substeps.append(stages())
            state.flip()
        self.chip: Chip | None = None
        """The layout of worlds that stay in shared memory; None if they do not."""
        model, chosen = dynamics.model, blocks == "auto"
        if model.in_worlds:
            threads = threads_of_world(dynamics.assembly, blocks)
            blocks = None if threads is None else (model.worlds, threads)
        elif blocks == "auto":
            blocks = persistent_blocks(model, dynamics.composition.force_algorithm.lanes)
        assert not isinstance(blocks, int | str)
        both = [one for substep in self._substeps for one in substep]
        stages_only = [one for one in both if isinstance(one, Stage)]
        launches_between = after_substep is not None or dynamics.launches_between
        single = len(stages_only) == len(both)
        if not single:
            note_products(model)
        one_launch = single and not launches_between
        self.blocks: tuple[int, int] | None = blocks if one_launch else None
        """Blocks, and threads per block, of the single launch; None for a launch per stage."""
        self.contact: ContactLaunch | None = None
        """Launches whole frames of small bodies in contact; None if that is not possible."""
        self.takes_contact_along = False
        """Whether `contact` launches the next frames."""
        if chosen and single and not one_launch and after_substep is None:
            self.contact = contact_launch(dynamics, stages_only, len(stages_only) // 2)
        self._repeated = dynamics.repeated if single and after_substep is None else 0
        """How many substeps are recorded once, and repeated by the device; 0: none."""
        if self.blocks is None and not (model.in_worlds and one_launch and chosen):
            dynamics.note(*(one.method for one in stages_only))
            return
        self._method, self._per_substep = stages_only[0].method, len(stages_only) // 2
        self._kept = [one.step(dynamics.composition) for one in stages_only]
        if model.in_worlds and chosen and not dynamics.launches_before_forces:
            self.chip = on_chip(dynamics, state, self._method, self._kept[: self._per_substep])
        if self.chip is not None:
            self.blocks = model.worlds, self.chip.threads
            model.kernels.note(self.chip.kernel(dynamics, self._method), block=self.chip.threads)
        elif self.blocks is not None:
            self._kernel = dynamics.persistent(self._method, *self.blocks)
            partition = dynamics.partition
            kernel = self._kernel if partition is None else partition.kernel(self._method)
            model.kernels.note(kernel, block=self.blocks[1])
            Step = self._method(dynamics.composition).Step
            self._steps = wp.array(self._kept, dtype=Step, device=model.device).reshape((2, self._per_substep))
        else:
            dynamics.note(*(one.method for one in stages_only))

    @property
    def may_take_contact_along(self) -> bool:
        """Whether one launch for the whole next frame, including all contact kernels, is fastest."""
        return self.contact is not None and self.contact.pays

    def take(self, substeps: int, first: int = 0) -> None:
        """Advance by `substeps` substeps, from number `first` of a frame on; the new state replaces the old."""
        if self.takes_contact_along and self.contact is not None:
            self.contact.launch(substeps, first)
            if substeps % 2:
                self._state.flip()
            self.contact.test_motion(self._state.state_in)
        elif self.blocks is None:
            many, repeats = self._repeated, repetitions(substeps, self._repeated)
            begun = DIFFERENT if repeats else 0
            self._take_each(range(begun), first)
            if repeats:
                self._dynamics.repeat(repeats, lambda: self._take_each(range(begun, begun + many), first % many))
            self._take_each(range(begun + many * repeats, substeps), first)
        else:
            self._launch_all(*self.blocks, substeps * self._per_substep, first)
            if substeps % 2 and self.chip is None:
                self._state.flip()
        self._dynamics.go_to_frame_end()
        self._state.settle()

    def _take_each(self, numbers: range, first: int) -> None:
        """Advance by the substeps `numbers`, counted from `first`, with a launch per stage."""
        for k in numbers:
            take_substep(self._dynamics, self._state, self._substeps[k % 2], first + k)
            self._state.flip()
            if self._after_substep is not None:
                self._after_substep(first + k)

    def _launch_all(self, blocks: int, threads: int, stages: int, first: int) -> None:
        """Advance by `stages` stages, from substep `first` on, in one launch or one per CPU thread."""
        dynamics, partition = self._dynamics, self._dynamics.partition
        dynamics.go_to_substep(first)
        if partition is not None and partition.is_recording:
            partition.launch(self._method, dynamics.scene, self._steps, stages)
        elif self.chip is not None:
            self.chip.launch(dynamics, self._method, stages)
        else:
            launch_persistent(self._kernel, dynamics.model, dynamics.scene, self._steps, stages, blocks, threads)
        dynamics.stop_fracture()


def check_blocks(blocks: Blocks, *, on_gpu: bool) -> None:
    """Raise ValueError unless `blocks` is "auto", None, or two numbers that the device supports."""
    if blocks is None or (isinstance(blocks, str) and blocks == "auto"):
        return
    if not isinstance(blocks, tuple) or len(blocks) != 2:
        raise ValueError(f"blocks is {blocks!r}; it must be 'auto', None, or (blocks, threads in each)")
    most = (CLUSTER, MOST_THREADS) if on_gpu else (1, 1)
    for k, (number, limit) in enumerate(zip(blocks, most, strict=True)):
        if checks.count(f"blocks[{k}]", number, 1) > limit:
            where = "on a GPU" if on_gpu else "on the CPU"
            raise ValueError(f"blocks[{k}] is {number}; it must be at most {limit} {where}")
