"""StepController: chooses the automatic substeps of each frame so that energy does not grow."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any, Self

from .. import checks
from ..engine import EnergyBalance, rounding_energy, size, weight
from ..integrators import MOST_SUBSTEPS, StepChoice, UnstableStep
from ..runtime import stop_if_asked
from .stepping import Stepping
from .track import LONG

MOST_RISE = 0.02
"""Allowed rise of the energy above its minimum, as a fraction of the scale.

Rounding and a sufficiently short step cause smaller fluctuations of the conserved energy, even in a strongly
stretched body. With a longer step it rises by more within a second.
"""
MOST_SWING = 0.04
"""Allowed difference between the conserved and the physical energy, as a fraction of the scale.

The physical energy of the fastest modes is larger by a factor 1/(1 − h²λ/4), 2.8 at 0.8 of the limit, although the
conserved energy stays the same.
"""
ENOUGH_FOR_SWING = 8.0
"""At this refinement the swing due to the step is 1/64 of the original; contact and loads cause the rest."""
MOST_GAINED = 0.08
"""A run ends when its energy has risen above the floor by this fraction of the scale."""
ROUNDED = 1e-4
"""Rounding errors exceed this fraction of the allowance only if they add up; one error is a tenth of it."""
MOST_REFINEMENT = 64.0
"""The largest refinement that is tried."""
SAME = 0.7
"""If halving the step keeps more than this fraction of a rise, the rise is physical. Order 1 keeps half."""
SLOW = 0.25
"""A frame that used less than this fraction of the allowance did not cause the rise; earlier frames did."""
LONGEST_INTERVAL = 64
"""Maximal number of frames between two checks. A check costs as much as a few substeps."""
OFTEN = 8
"""At shorter intervals than this, each frame on a GPU sums its energy balance."""
WITHIN = 8
"""Moments at which a frame's energies are looked at within, before it is refused."""
LARGE_STRAIN = 0.3
"""Above this strain the stability limit of small motions is unreliable, and every frame is checked."""
FRAGILE_STRAIN = 0.4
"""Above this strain of a connection a body with cells of negative modulus may stay distorted."""
PATIENCE = 60
"""Quiet frames before fewer substeps are tried."""
MOST_PATIENCE = 4096
"""Maximal patience. It doubles when fewer substeps were too few."""
EASING = 1.25
"""Divisor of the substeps when fewer substeps are tried."""
KEPT = 0.9
"""If the required substeps are at least this fraction of the current, these are kept: recording is slow."""


class StepControlFailed(Exception):
    """Raised if no number of substeps is enough: the frame diverges, or the energy still rises."""

    def __init__(self, stepping: Stepping, gained: float | None = None) -> None:
        super().__init__()
        self.stepping = stepping
        """The stepping of the last attempt."""
        self.gained = gained
        """The rise of energy as a fraction of its scale; None if the frame diverged."""


_STORED = {"quiet_frames": "calm", "coarsen_after": "patience", "rechoose": "anew"}


def _stored(name: str) -> str:
    """Return a field's name in checkpoints: the name in version 0.1, so that files of this version still load."""
    return f"pace.{_STORED.get(name, name)}"


@dataclass
class StepController:
    """Chooses automatic substeps: the number that stability requires, times `refinement`.

    After a frame it checks the energy that the method conserves, minus external work. This energy can only fall.
    If it has risen above its minimum by more than `MOST_RISE` of its scale, the run goes back to the frame's start
    and doubles the substeps. After quiet frames it tries fewer substeps. Checks become rare while energies stay in
    their known range. Decisions ignore wall-clock time, so runs repeat and resume to the last bit.
    """

    refinement: float = 1.0
    """Factor by which substeps exceed the number that stability requires."""
    least: float = 0.0
    """The least energy since the last rise [J]: the reference for the next rise."""
    floor: float = 0.0
    """The least energy so far, plus accepted physical gains [J]."""
    scale: float = 0.0
    """Largest kinetic and stored energy so far, with a small weight for motion of the whole body [J]."""
    rounding: float = 0.0
    """The part of the scale that allows for float32 rounding [J]; 0 if it is nearly all, as in a body at rest."""
    low: float = 0.0
    """Least kinetic plus gravitational energy minus work at a check [J]."""
    high: float = 0.0
    """Largest kinetic plus gravitational energy minus work at a check [J]."""
    strain: float = 0.0
    """Largest strain when the stability limit was computed."""
    interval: int = 1
    """Frames between two checks."""
    since: int = 0
    """Frames since the last check."""
    quiet_frames: int = 0
    """Frames since the refinement last changed."""
    coarsen_after: int = PATIENCE
    """Quiet frames after which fewer substeps are tried."""
    rechoose: bool = False
    """Whether substeps are chosen again before the next frame: the refinement or the strain has changed."""

    def __post_init__(self) -> None:
        """Start without warnings."""
        self.warnings: dict[type[Warning], str] = {}
        """Messages of pending warnings, by class of warning."""
        self.strained = self.next_look = 0
        """Frames since a check found a large strain, and of these before the next look for inverted cells."""

    def saved(self) -> dict[str, float]:
        """Return the fields' values for a checkpoint."""
        return {_stored(field.name): getattr(self, field.name) for field in fields(self)}

    @classmethod
    def restored(cls, numbers: Mapping[str, Any]) -> Self | None:
        """Return the controller stored in a checkpoint, or None; raise ValueError if a value is invalid."""
        if "pace.refinement" not in numbers:
            return None
        values = {}
        for field in fields(cls):
            name = _stored(field.name)
            if field.name == "rounding" and name not in numbers:  # from an older checkpoint
                continue
            value = values[field.name] = checks.member("checkpoint", numbers, name)
            if isinstance(field.default, bool):
                checks.one_of(name, value, (False, True))
            elif isinstance(field.default, int):
                checks.count(name, value, 0)
            elif not isinstance(value, float) or not math.isfinite(value):
                raise ValueError(
                    f"{name} of the checkpoint is {checks.repr_short(value)}; it must be a finite number"
                )
        return cls(**values)

    def begin(self, stepping: Stepping, above: float = 0.0) -> None:
        """Start, or continue after a change, from a state whose energy is `above` the lowest energy so far [J]."""
        balance, model, state = stepping.balance(), stepping.model, stepping.state
        # Rounding errors of ten seconds add up to several hundred times one error.
        fall, rounding = 0.05 * weight(model) * size(state), 100.0 * rounding_energy(stepping.assembly, state)
        self.scale = fall + rounding
        separable = model.precision != "float64" and max(fall, balance.inner) > ROUNDED * rounding
        self.rounding = rounding if separable else 0.0
        self.least, self.floor, self.strain = balance.energy, balance.energy - above, balance.strain
        self.low = self.high = balance.free
        self.interval, self.since = 1, 0
        self._update_extremes(balance)

    def set_gravity(self, stepping: Stepping, added: float) -> None:
        """Continue with another gravity, which has added energy [J]."""
        self.add_energy(stepping, added)
        self.scale = max(self.scale, 0.05 * weight(stepping.model) * size(stepping.state))

    def add_energy(self, stepping: Stepping, added: float) -> None:
        """Continue after a change that has added energy [J] without moving particles."""
        self.least, self.floor, self.low, self.high = (
            one + added for one in (self.least, self.floor, self.low, self.high)
        )
        self.interval, self.since = 1, 0
        self._update_extremes(stepping.balance())

    def above_floor(self, stepping: Stepping) -> float:
        """Return the excess of the current energy over the lowest energy so far [J]."""
        return max(0.0, stepping.balance().energy - self.floor)

    def advance(
        self,
        stepping: Stepping,
        time: float,
        stable_choice: Callable[[], StepChoice],
        next_time: float | None = None,
    ) -> Stepping:
        """Advance by the frame that begins at `time` [s]; return the `Stepping` that has advanced.

        `stable_choice` returns the substeps that stability requires in the current state. `next_time` is as for
        `Stepping.advance`. Raises StepControlFailed, with the state of the last attempt, if no number of substeps
        is enough; the caller then goes back to the frame's start.
        """
        before, first, moved = vars(self).copy(), stepping, False
        try:
            if self.rechoose:
                stepping.discard_ahead()
                with suppress(UnstableStep):  # otherwise keep the old substeps
                    stepping = self.follow(stepping, stable_choice())
                self.rechoose, moved = False, stepping is not first
            # If checks are rare, balances are needed only near the next check: in this frame or the one after.
            stepping.sum_balance = self.interval < OFTEN or self.since + 2 >= self.interval
            fine = stepping.advance(time, next_time)
            self.since += 1
            if fine and not self._is_due(stepping):
                return stepping
            moved = True
            return self._checked(stepping, fine, time, stable_choice)
        except BaseException as error:  # or of a function of time: the caller goes on with the same `Stepping`
            vars(self).update(before)
            if not isinstance(error, StepControlFailed) and (moved or first.end > time):
                first.go_back()
            raise

    def _checked(
        self, stepping: Stepping, fine: bool, time: float, stable_choice: Callable[[], StepChoice]
    ) -> Stepping:
        """Check the frame that begins at `time` [s]; repeat it with more substeps until its energy is fine."""
        usual, rises, start = self.refinement, list[float](), None
        while True:
            balance = stepping.balance_of_frame() if fine else None
            if stepping.assembly.external_work and not (balance and self._is_acceptable(balance)):
                within = _scale_within(stepping, time)
                fine = stepping.advance(time)
                balance = stepping.balance_of_frame()._replace(within=within) if fine else None
            if balance is not None and self._is_acceptable(balance):
                if start is not None:  # the refinement has handled this rise; the next rise counts from here
                    self.least = max(self.least, balance.energy - SLOW * self._allowed(balance))
                return self._accept(stepping, balance)
            if balance is not None and start is not None:
                rises.append(balance.energy - start.energy)
                if _is_physical(stepping, rises):
                    self.refinement, self.floor = usual, self.floor + balance.energy - self.least
                    self.least = balance.energy
                    return self._accept(stepping, balance)
                if rises[-1] <= SLOW * self._allowed(balance):
                    return self._accept_gain(stepping, balance)
            if self.refinement >= MOST_REFINEMENT or 2 * stepping.choice.substeps > MOST_SUBSTEPS:
                if balance is None:
                    raise StepControlFailed(stepping)
                return self._accept_gain(stepping, balance)
            stepping, start = self._refine(stepping, stable_choice)
            fine = stepping.advance(time)

    def follow(self, stepping: Stepping, choice: StepChoice) -> Stepping:
        """Return the `Stepping` with the substeps of the stable `choice` times the refinement.

        A number that is only slightly smaller than the current one is ignored.
        """
        choice, now = choice.refined(self.refinement), stepping.choice.substeps
        if KEPT * now <= choice.substeps < now:
            choice = replace(choice, substeps=now)
        return self._with_choice(stepping, choice)

    def _is_due(self, stepping: Stepping) -> bool:
        """Return whether the frame is to be checked: after an interval, or if its energies are out of range."""
        free, margin = stepping.watch.energy, 0.05 * self.scale
        if self.since >= self.interval or not self.low - margin <= free <= self.high + margin:
            return True
        return free > self.least + self._allowed()  # true without elastic energy, which only adds to `free`

    def _is_acceptable(self, balance: EnergyBalance) -> bool:
        """Return whether the conserved energy has risen little and differs little from the physical energy."""
        if balance.swing > MOST_SWING * self._scale_of(balance) and self.refinement < ENOUGH_FOR_SWING:
            return False
        return balance.energy <= self.least + self._allowed(balance)

    def _allowed(self, balance: EnergyBalance | None = None) -> float:
        """Return the allowed rise of the energy above its least value so far [J]."""
        return MOST_RISE * self._scale_of(balance)

    def _scale_of(self, balance: EnergyBalance | None) -> float:
        """Return the scale of energies [J]."""
        return self.scale if balance is None else max(self.scale, balance.within, abs(balance.work))

    def _accept_gain(self, stepping: Stepping, balance: EnergyBalance) -> Stepping:
        """Accept a frame with an unexplained rise of energy if the total rise is small."""
        rise, scale = balance.energy - self.floor, self._scale_of(balance)
        gained = rise / scale if scale > 0.0 else math.inf
        if gained > MOST_GAINED:
            raise StepControlFailed(stepping, gained)
        self.least = balance.energy
        return self._accept(stepping, balance)

    def _accept(self, stepping: Stepping, balance: EnergyBalance) -> Stepping:
        """Accept a frame: record its energies; set when energies are checked next, and whether substeps change."""
        self._update_extremes(balance)
        self._check_rounding(stepping, balance)
        cells = stepping.model.system.cells
        if balance.strain > FRAGILE_STRAIN and cells is not None and (cells.modulus < 0).any():
            self.warnings[checks.StrainWarning] = (
                f"a connection has been strained by {balance.strain:.2g}; below a Poisson's ratio of 1/4 (in a "
                "sheet 1/3) a body that is strained so much may stay distorted"
            )
        if self.strained or balance.strain > LARGE_STRAIN:  # a cell without volume strains a spring by 0.23
            self.strained += self.since
        if self.strained > self.next_look:
            self.next_look = self.strained + min(max(self.strained, 4), LONGEST_INTERVAL)
            if found := stepping.assembly.inverted_cells.look(stepping.state.x):
                self.warnings[checks.InvertedWarning] = (
                    f"{found}; springs alone do not resist that: give the body a Material with "
                    "poissons_ratio=0.45, whose cells do, or more stiffness"
                )
        self.quiet_frames += self.since
        self.since = 0
        quiet = balance.energy <= self.least + 0.5 * self._allowed(balance) and balance.strain <= LARGE_STRAIN
        quiet = quiet and self.refinement == 1.0 and not stepping.integrator.long_steps
        self.interval = min(2 * self.interval, LONGEST_INTERVAL) if quiet else 1
        if self.refinement > 1.0 and self.quiet_frames >= self.coarsen_after:
            self.refinement, self.quiet_frames = max(1.0, self.refinement / EASING), 0
        # The stability limit depends on the strain: compute the limit again after a large change.
        stretched = not 0.5 * self.strain - 0.05 <= balance.strain <= 1.2 * self.strain + 0.05
        if stretched or self.refinement != stepping.choice.refinement:
            self.strain, self.rechoose = balance.strain, True
        return stepping

    def _check_rounding(self, stepping: Stepping, balance: EnergyBalance) -> None:
        """Warn if a large rise of energy is allowed only because rounding may cause it."""
        gained = balance.energy - self.floor
        without_rounding = max(self.scale - self.rounding, balance.inner + 0.05 * balance.kinetic)
        if max(MOST_GAINED * without_rounding, ROUNDED * self.rounding) < gained < self.rounding:
            better = "float64" if stepping.model.compensated else "float32-compensated"
            self.warnings[checks.EnergyDriftWarning] = (
                f"the energy has risen by {gained:.3g} J, and rounding to float32 may be why: the springs are so "
                "stiff, or so far from the origin, that the rounding of positions strains them; "
                f"use precision={better!r}"
            )

    def _update_extremes(self, balance: EnergyBalance) -> None:
        """Update the least and the largest energies."""
        self.least, self.floor = min(self.least, balance.energy), min(self.floor, balance.energy)
        self.low, self.high = min(self.low, balance.free), max(self.high, balance.free)
        self.scale = max(self._scale_of(balance), balance.scale)

    def _refine(
        self, stepping: Stepping, stable_choice: Callable[[], StepChoice]
    ) -> tuple[Stepping, EnergyBalance]:
        """Go back to the frame's start and at least double the substeps; return (stepping, its energy balance)."""
        stepping.go_back()
        stop_if_asked()
        try:
            choice = stable_choice()
        except UnstableStep as error:
            raise StepControlFailed(stepping) from error
        if not math.isfinite(stepping.balance().energy):  # an earlier frame has diverged
            raise StepControlFailed(stepping)
        too_early = self.quiet_frames < self.coarsen_after
        self.coarsen_after = min(2 * self.coarsen_after, MOST_PATIENCE) if too_early else PATIENCE
        self.quiet_frames = 0
        self.refinement = max(2 * self.refinement, 2 * stepping.choice.substeps / choice.substeps)
        if self.refinement * choice.substeps * stepping.dynamics.pace.substep > LONG:
            self._tell_refinement(stepping.end)
        stepping = self._with_choice(stepping, choice.refined(self.refinement))
        return stepping, stepping.balance()

    def _tell_refinement(self, time: float) -> None:
        """Warn, before the wait, of a frame that takes far more substeps than stability requires."""
        message = (
            f"the frame from {time:.4g} s on takes long: its energy rises unless it has {self.refinement:.0f} "
            "times as many substeps as are stable; let bodies start nearer to their rest lengths, make contact "
            "softer by Contact(stiffness=...), or give the number of substeps yourself"
        )
        checks.warn(message, checks.StepWarning)

    def _with_choice(self, stepping: Stepping, choice: StepChoice) -> Stepping:
        """Return the `Stepping` with another choice; correct energies for the change of the conserved energy."""
        if choice.substeps == stepping.choice.substeps:
            stepping.choice = choice
            return stepping
        if stepping.at_start:
            stepping = stepping.with_choice(choice)
            self.begin(stepping)
            return stepping
        before = stepping.balance().energy
        stepping = stepping.with_choice(choice)
        added = stepping.balance().energy - before
        self.least, self.floor = self.least + added, self.floor + added
        return stepping


def _scale_within(stepping: Stepping, time: float) -> float:
    """Take the frame from `time` [s] again; return the largest scale within [J], and go back to its start."""
    stepping.go_back()
    stepping.dynamics.begin_frame(time)
    scale, first = 0.0, 0
    for end in sorted({math.ceil(stepping.choice.substeps * k / WITHIN) for k in range(1, WITHIN + 1)}):
        stepping.stepper.take(end - first, first)
        stop_if_asked()
        balance, first = stepping.balance(), end
        stepping.watch.allow_for_work(balance.work)
        scale = max(scale, balance.scale)
    stepping.go_back()
    return scale


def _is_physical(stepping: Stepping, rises: list[float]) -> bool:
    """Return whether a rise of energy is physical: a large part of it remains each time the step is halved.

    An isolated body has no source of energy. A fixed obstacle is a source if a body starts inside it.
    """
    isolated = all(one.conserves for one in stepping.assembly.all)
    return not isolated and len(rises) > 2 and min(rises[-3:]) >= SAME * max(rises[-3:])
