"""StepController: how many automatic substeps a frame gets, so that no energy comes from nothing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from .. import checks
from ..engine import EnergyBalance, rounding_energy, size, weight
from ..integrators import MOST_SUBSTEPS, StepChoice, UnstableStep
from .stepping import Stepping

SHARE = 0.02
"""Energy may rise by this share of its scale above the least so far.

The energy that a method conserves swings by less where steps are short enough for a strongly stretched body; where
they are not, it rises by more within a second.
"""
MOST_SWING = 0.04
"""What a method conserves may differ from the energy there is by this share of the scale.

Energy that goes over to the fastest modes grows by 1/(1 − h²λ/4), 2.8 times at 0.8 of the limit, though the method
has gained nothing.
"""
ENOUGH_FOR_SWING = 8.0
"""Beyond this refinement that is less than 1/64 of what it was, and comes from what presses, not from the step."""
MOST_GAINED = 0.08
"""A run ends when its energy is above the least ever by so large a share of its scale, from nothing."""
ROUNDED = 1e-4
"""Rounding errors make less than this share of what is allowed for them, unless they add up: ten times one's."""
MOST_REFINEMENT = 64.0
"""More times the substeps that small motions need are not tried."""
SAME = 0.7
"""A rise of which more than this is left when steps are halved is none of their doing: at order 1 half is left."""
SLOW = 0.25
"""A frame with a smaller share of what is allowed is not what has let energy rise too far: those before it are."""
LONGEST_INTERVAL = 64
"""Frames from one look to the next, at most. A look costs as much as a few substeps."""
OFTEN = 8
"""Frames from one look to the next up to which each frame on a GPU tells its balance."""
LARGE_STRAIN = 0.3
"""Beyond it the limit of small motions says little, and every frame is looked at."""
PATIENCE = 60
"""Frames without a rise after which fewer substeps are tried."""
MOST_PATIENCE = 4096
"""Patience doubles when fewer substeps were too few, up to this."""
EASING = 1.25
"""How many times fewer substeps are tried."""


class StepControlFailed(Exception):
    """No number of substeps does: the frame diverges, or energy rises all the same."""

    def __init__(self, stepping: Stepping, gained: float | None = None) -> None:
        super().__init__()
        self.stepping = stepping
        """What the last try was made with."""
        self.gained = gained
        """The share of its scale by which energy has risen; None if the frame diverged."""


def _stored(name: str) -> str:
    """Return the name that a field has in checkpoints: that of version 0.1."""
    return f"pace.{ {'quiet_frames': 'calm', 'coarsen_after': 'patience'}.get(name, name) }"


@dataclass
class StepController:
    """Decides on automatic substeps: as many as the stability limit asks for, times `refinement`.

    After a frame the energy that the method conserves, less work from outside, is looked at. It can only fall:
    where it has risen above the least so far by more than `SHARE` of its scale, the run goes back to the frame's
    start and takes twice the substeps. When all has been calm for a while, fewer are tried. Looks are rare while
    nothing new happens. Counts and energies decide, never the time that something takes, so that runs repeat and
    resume to the last bit.
    """

    refinement: float = 1.0
    """Times the substeps that the stability limit asks for."""
    least: float = 0.0
    """What the next rise counts from: the least energy since the last one [J]."""
    floor: float = 0.0
    """Least energy so far, and what has come in by work since [J]."""
    scale: float = 0.0
    """Largest energy of motion and stretching so far [J]."""
    rounding: float = 0.0
    """What of the scale is for rounding to float32 [J]; 0 if there is nothing else, as for a body at rest."""
    low: float = 0.0
    """Least kinetic and gravitational energy that has been looked at [J]."""
    high: float = 0.0
    """The most of it [J]."""
    strain: float = 0.0
    """The largest strain that the stability limit was computed at."""
    interval: int = 1
    """Frames from one look to the next."""
    since: int = 0
    """Frames since the last look."""
    quiet_frames: int = 0
    """Frames since substeps were last refined, or eased."""
    coarsen_after: int = PATIENCE
    """Frames of calm after which fewer substeps are tried."""
    anew: bool = False
    """Whether the next frame begins with a new choice: fewer substeps, or those of a body stretched otherwise."""

    warnings = ""
    """Words about energy that rounding errors have added."""

    def saved(self) -> dict[str, float]:
        """Return what a checkpoint keeps."""
        return {_stored(field.name): getattr(self, field.name) for field in fields(self)}

    @classmethod
    def restored(cls, numbers: Mapping[str, Any]) -> Self | None:
        """Return the pace that a checkpoint keeps; None if it keeps none, raise ValueError if it is none."""
        if "pace.refinement" not in numbers:
            return None
        values = {}
        for field in fields(cls):
            name = _stored(field.name)
            if field.name == "rounding" and name not in numbers:  # an older checkpoint
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
        """Begin, or go on after a change, from a state whose energy is `above` the least [J]."""
        now, model, state = stepping.balance(), stepping.model, stepping.state
        # Rounding errors of ten seconds add up to hundreds of times what one of them makes.
        fall, rounding = 0.05 * weight(model) * size(state), 100.0 * rounding_energy(model, state)
        self.scale = fall + rounding
        told = model.precision != "float64" and max(fall, now.inner) > ROUNDED * rounding
        self.rounding = rounding if told else 0.0
        self.least, self.floor, self.strain = now.energy, now.energy - above, now.strain
        self.low = self.high = now.free
        self.interval, self.since = 1, 0
        self._see(now)

    def fall(self, stepping: Stepping, added: float) -> None:
        """Go on under another gravity, which has added so much to the energy [J]."""
        self.bring_in(stepping, added)
        self.scale = max(self.scale, 0.05 * weight(stepping.model) * size(stepping.state))

    def bring_in(self, stepping: Stepping, added: float) -> None:
        """Go on after a change that has added so much to the energy watched [J]: places are as before."""
        self.least, self.floor, self.low, self.high = (
            one + added for one in (self.least, self.floor, self.low, self.high)
        )
        self.interval, self.since = 1, 0
        self._see(stepping.balance())

    def above(self, stepping: Stepping) -> float:
        """Return by how much the present energy is above the least [J]."""
        return max(0.0, stepping.balance().energy - self.floor)

    def advance(
        self, stepping: Stepping, time: float, bound: Callable[[], StepChoice], then: float | None = None
    ) -> Stepping:
        """Advance by the frame that begins at `time` [s], and return what it was done with.

        `bound` returns the substeps that the stability limit asks for in the present state; `then` is when the
        next frame begins [s], where one follows at once. StepControlFailed is raised if no number of substeps
        does; the state is then that after the last try.
        """
        if self.anew:
            stepping.land()
            stepping = self._begun_anew(stepping, bound)
        usual, tried = self.refinement, list[float]()
        # Where looks are rare, only frames that are to be looked at by count tell: this one, or the one behind it.
        stepping.telling = self.interval < OFTEN or self.since + 2 >= self.interval
        fine = stepping.advance(time, then)
        self.since += 1
        if fine and not self._is_due(stepping):
            return stepping
        start = None
        while True:
            now = stepping.balance_of_frame() if fine else None
            if now is not None and self._is_well(stepping, now):
                if start is not None:  # refined for what has risen by now: the next rise counts from here
                    self.least = max(self.least, now.energy - SLOW * self._allowed(now))
                return self._go_on(stepping, now)
            if now is not None and start is not None:
                tried.append(now.energy - start.energy)
                slow = tried[-1] <= SLOW * self._allowed(now)
                if _is_real(stepping, tried):
                    self.refinement, self.floor = usual, self.floor + now.energy - self.least
                    self.least = now.energy
                    return self._go_on(stepping, now)
                if slow:
                    return self._bear(stepping, now)
            if self.refinement >= MOST_REFINEMENT or 2 * stepping.choice.substeps > MOST_SUBSTEPS:
                if now is None:
                    raise StepControlFailed(stepping)
                return self._bear(stepping, now)
            stepping, start = self._finer(stepping, bound)
            fine = stepping.advance(time)

    def follow(self, stepping: Stepping, bound: StepChoice) -> Stepping:
        """Return what goes on with the substeps that the stability limit now asks for."""
        return self._with(stepping, bound.refined(self.refinement))

    def _begun_anew(self, stepping: Stepping, bound: Callable[[], StepChoice]) -> Stepping:
        """Return what begins a frame with a new choice; where there is none it goes on as it is, while it can."""
        self.anew = False
        try:
            return self.follow(stepping, bound())
        except UnstableStep:
            return stepping

    def _is_due(self, stepping: Stepping) -> bool:
        """Tell whether the frame is to be looked at: by count, or as something happens that has not been seen."""
        free, margin = stepping.watch.energy, 0.05 * self.scale
        if self.since >= self.interval or not self.low - margin <= free <= self.high + margin:
            return True
        return free > self.least + self._allowed()  # stretching only adds to it

    def _is_well(self, stepping: Stepping, now: EnergyBalance) -> bool:
        """Tell whether energy has risen by no more than is allowed, and is what physics has, or almost."""
        if now.swing > MOST_SWING * self._scale_of(now) and self.refinement < ENOUGH_FOR_SWING:
            return False
        return now.energy <= self.least + self._allowed(now)

    def _allowed(self, now: EnergyBalance | None = None) -> float:
        """Return by how much energy may exceed the least so far [J]."""
        return SHARE * self._scale_of(now)

    def _scale_of(self, now: EnergyBalance | None) -> float:
        """Return the scale of energies [J]: at least the work from outside, known to first order in the step."""
        return self.scale if now is None else max(self.scale, abs(now.work))

    def _bear(self, stepping: Stepping, now: EnergyBalance) -> Stepping:
        """Let energy that came from nothing stand, as long as it is little in all."""
        gained = (now.energy - self.floor) / self._scale_of(now)
        if gained > MOST_GAINED:
            raise StepControlFailed(stepping, gained)
        self.least = now.energy
        return self._go_on(stepping, now)

    def _go_on(self, stepping: Stepping, now: EnergyBalance) -> Stepping:
        """Note what was seen of a frame that stands, and whether the next one begins with a new choice."""
        self._see(now)
        self._doubt_rounding(stepping, now)
        self.quiet_frames += self.since
        self.since = 0
        quiet = now.energy <= self.least + 0.5 * self._allowed(now) and now.strain <= LARGE_STRAIN
        quiet = quiet and self.refinement == 1.0 and not stepping.integrator.long_steps
        self.interval = min(2 * self.interval, LONGEST_INTERVAL) if quiet else 1
        if self.refinement > 1.0 and self.quiet_frames >= self.coarsen_after:
            self.refinement, self.quiet_frames = max(1.0, self.refinement / EASING), 0
        # The limit moves with the stretching: it is computed again where that has changed by much.
        stretched = not 0.5 * self.strain - 0.05 <= now.strain <= 1.2 * self.strain + 0.05
        if stretched or self.refinement != stepping.choice.refinement:
            self.strain, self.anew = now.strain, True
        return stepping

    def _doubt_rounding(self, stepping: Stepping, now: EnergyBalance) -> None:
        """Note if energy has risen by much that is allowed only since rounding errors might add so much."""
        gained = now.energy - self.floor
        apart = max(self.scale - self.rounding, now.inner + 0.05 * now.kinetic)
        if max(MOST_GAINED * apart, ROUNDED * self.rounding) < gained < self.rounding:
            better = "float64" if stepping.model.compensated else "float32-compensated"
            self.warnings = (
                f"the energy has risen by {gained:.3g} J, and rounding to float32 may be why: the springs are so "
                "stiff, or so far from the origin, that the rounding of positions strains them; "
                f"use precision={better!r}"
            )

    def _see(self, now: EnergyBalance) -> None:
        """Take what was seen into the least and the most so far."""
        self.least, self.floor = min(self.least, now.energy), min(self.floor, now.energy)
        self.low, self.high = min(self.low, now.free), max(self.high, now.free)
        # Of a motion as a whole little counts, for it is not what heats.
        self.scale = max(self.scale, now.inner + 0.05 * now.kinetic, abs(now.work))

    def _finer(self, stepping: Stepping, bound: Callable[[], StepChoice]) -> tuple[Stepping, EnergyBalance]:
        """Go back to the frame's start; return what takes twice the substeps at least, and the balance there."""
        stepping.go_back()
        try:
            choice = bound()
        except UnstableStep as error:
            raise StepControlFailed(stepping) from error
        if not math.isfinite(stepping.balance().energy):  # so it was not this frame that spoilt it
            raise StepControlFailed(stepping)
        self.coarsen_after = (
            min(2 * self.coarsen_after, MOST_PATIENCE) if self.quiet_frames < self.coarsen_after else PATIENCE
        )
        self.quiet_frames = 0
        self.refinement = max(2 * self.refinement, 2 * stepping.choice.substeps / choice.substeps)
        stepping = self._with(stepping, choice.refined(self.refinement))
        return stepping, stepping.balance()

    def _with(self, stepping: Stepping, choice: StepChoice) -> Stepping:
        """Return what goes on with another choice; the energy that it conserves is another one."""
        if choice.substeps == stepping.choice.substeps:
            stepping.choice = choice
            return stepping
        if stepping.at_start:  # nothing has happened yet
            stepping = stepping.with_choice(choice)
            self.begin(stepping)
            return stepping
        before = stepping.balance().energy
        stepping = stepping.with_choice(choice)
        other = stepping.balance().energy - before
        self.least, self.floor = self.least + other, self.floor + other
        return stepping


def _is_real(stepping: Stepping, rises: list[float]) -> bool:
    """Tell whether a rise is none of the steps' doing: much of it is left when they are halved, again and again.

    A body with nothing around it has no source of energy. An obstacle that stands still is one where it puts back
    what starts inside it.
    """
    return bool(stepping.assembly.all) and len(rises) > 2 and min(rises[-3:]) >= SAME * max(rises[-3:])
