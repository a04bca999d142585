"""Pace: how many automatic substeps a frame gets, so that no energy comes from nothing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from .. import checks
from ..engine import Balance, balance, rounding_energy, size, weight
from ..integrators import MOST_SUBSTEPS, StepChoice
from .stepping import Stepping

SHARE = 0.02
"""Energy may rise by this share of its scale above the least so far: the method's own energy swings by less where
steps are short enough, and what it has at the limit of a strongly stretched body grows by more within a second."""
SHARE_OF_WORK = 0.1
"""The same where something may do work: then each rise is tried with shorter steps before it is believed."""
MOST_GAINED = 0.08
"""Energy that shorter steps could not take away ends the run at this share of its scale."""
MOST_REFINEMENT = 64.0
"""More times the substeps that small motions need are not tried."""
SAME = 0.7
"""A rise that falls by less when the step is halved is not the step's doing: that of a method of order 1 halves."""
LONGEST_INTERVAL = 16
"""Frames from one look at all connections to the next, at most: a look costs as much as a few substeps."""
LARGE_STRAIN = 0.3
"""Beyond it the limit of small motions says little, and every frame is looked at."""
PATIENCE = 60
"""Frames without a rise after which fewer substeps are tried."""
MOST_PATIENCE = 4096
DEBUG = False
EASING = 1.25
"""How many times fewer those are."""


class Hopeless(Exception):
    """No number of substeps does: the frame diverges, or energy rises all the same."""

    def __init__(self, stepping: Stepping, gained: float | None) -> None:
        super().__init__()
        self.stepping = stepping
        """What the last try was made with."""
        self.gained = gained
        """The share of its scale by which energy has risen; None if the frame diverged."""


@dataclass
class Pace:
    """Decides on automatic substeps: as many as the stability limit asks for, times `refinement`.

    After a frame the energy that the method conserves is looked at. Without work from outside it can only fall: where
    it has risen above the least so far by more than `SHARE` of its scale, the run goes back to the frame's start and
    takes twice the substeps. When all has been calm for a while, fewer are tried. Looks are rare while nothing happens.
    All is decided by counts and energies, never by time, so that runs repeat and resume to the last bit.
    """

    refinement: float = 1.0
    """Times the substeps that the stability limit asks for."""
    least: float = 0.0
    """Least energy so far, raised by what has been accepted as work, or has been gained [J]."""
    scale: float = 0.0
    """Largest energy of motion and stretching so far [J]."""
    gained: float = 0.0
    """Energy that came from nothing, and was not to be prevented [J]."""
    low: float = 0.0
    """Least kinetic and gravitational energy that has been looked at [J]."""
    strain: float = 0.0
    """The largest strain that the stability limit was computed at."""
    interval: int = 1
    """Frames from one look to the next."""
    since: int = 0
    """Frames since the last look."""
    calm: int = 0
    """Frames since the last rise, or the last change for fewer substeps."""
    patience: int = PATIENCE
    """Frames of calm after which fewer substeps are tried."""
    anew: bool = False
    """Whether the next frame begins with a new choice: fewer substeps, or the limit of a body stretched otherwise."""

    def saved(self) -> dict[str, float]:
        """Return what a checkpoint keeps."""
        return {f"pace.{field.name}": getattr(self, field.name) for field in fields(self)}

    @classmethod
    def restored(cls, numbers: Mapping[str, Any]) -> Self | None:
        """Return the pace that a checkpoint keeps; None if it keeps none, raise ValueError if it is none."""
        found = {
            name: numbers[f"pace.{name}"] for name in (f.name for f in fields(cls)) if f"pace.{name}" in numbers
        }
        if not found:
            return None
        for field in fields(cls):
            value = checks.member("checkpoint", numbers, f"pace.{field.name}")
            if isinstance(value, bool) and isinstance(field.default, bool):
                continue
            if isinstance(field.default, int):
                checks.count(f"pace.{field.name}", value, 0)
            elif not isinstance(value, float | int) or not math.isfinite(value):
                raise ValueError(f"pace.{field.name} of the checkpoint is {value!r}; it must be a finite number")
        return cls(**found)

    def begin(self, stepping: Stepping, above: float = 0.0) -> None:
        """Take the present state for the start, or for where a run goes on whose energy is `above` its least [J]."""
        now = self._balance(stepping)
        model, state = stepping.model, stepping.state
        base = 0.05 * weight(model) * size(state) + rounding_energy(model, state)
        self.scale = max(base, now.inner + 0.05 * now.kinetic)
        self.least, self.strain = now.energy - above, now.strain
        self.low = now.free
        self.interval, self.since = 1, 0

    def advance(self, stepping: Stepping, time: float, bound: Callable[[], StepChoice]) -> Stepping:
        """Advance by the frame that begins at `time` [s], with as many substeps as it needs.

        Parameters
        ----------
        stepping
            What advances.
        time
            When the frame begins [s].
        bound
            Returns the substeps that the stability limit asks for in the present state.

        Returns
        -------
        Stepping
            What the frame was done with.

        Raises
        ------
        Hopeless
            If no number of substeps does; the state is then that after the last try.
        """
        if self.anew:
            stepping, self.anew = self.follow(stepping, bound()), False
        usual, start, rises = self.refinement, None, list[float]()
        while True:
            fine = stepping.advance(time)
            self.since += 1
            if fine and start is None and not self._is_due(stepping):
                return stepping
            now = self._balance(stepping) if fine else None
            if now is not None and now.energy <= self.least + self._allowed(stepping):
                return self._go_on(stepping, now)
            if now is not None and start is not None:
                rises.append(now.energy - start.energy)
                slow, real = rises[-1] <= 0.25 * self._allowed(stepping), _is_real(stepping, rises)
                if real or (slow and _works(stepping)):
                    self.refinement, self.least = usual, now.energy
                    return self._go_on(stepping, now)
                if slow:  # most of it has come in frames before
                    return self._bear(stepping, now)
            if self.refinement >= MOST_REFINEMENT or 2 * stepping.choice.substeps > MOST_SUBSTEPS:
                if now is None:
                    raise Hopeless(stepping, None)
                return self._bear(stepping, now)
            stepping.backup.restore()
            if not math.isfinite(self._balance(stepping).energy):  # so it was not this frame that spoilt it
                raise Hopeless(stepping, None)
            stepping, start = self._finer(stepping, bound)
            self.patience = min(2 * self.patience, MOST_PATIENCE) if self.calm < self.patience else PATIENCE
            self.calm = 0

    def follow(self, stepping: Stepping, bound: StepChoice) -> Stepping:
        """Return what goes on with the substeps that the stability limit now asks for."""
        return self._with(stepping, bound.refined(self.refinement))[0]

    def _is_due(self, stepping: Stepping) -> bool:
        """Tell whether the frame is to be looked at: by count, or as something happens that has not been seen."""
        cheap, margin = stepping.watch.energy, 0.05 * self.scale
        if self.since >= self.interval or cheap < self.low - margin:
            return True
        return cheap > self.least + self._allowed(stepping)  # stretching only adds to it

    def _allowed(self, stepping: Stepping) -> float:
        """Return by how much energy may exceed the least so far [J]."""
        return (SHARE_OF_WORK if _works(stepping) else SHARE) * self.scale

    def _bear(self, stepping: Stepping, now: Balance) -> Stepping:
        """Let energy that came from nothing stand, as long as it is little in all."""
        if not _works(stepping):
            self.gained += now.energy - self.least
        if self.gained > MOST_GAINED * self.scale:
            raise Hopeless(stepping, self.gained / self.scale)
        self.least = now.energy
        return self._go_on(stepping, now)

    def _go_on(self, stepping: Stepping, now: Balance) -> Stepping:
        """Note what was seen of a frame that stands."""
        self.least = min(self.least, now.energy)
        self.scale = max(self.scale, now.inner + 0.05 * now.kinetic)
        cheap = stepping.watch.energy
        self.low = min(self.low, cheap)
        self.calm += self.since
        calm = now.energy <= self.least + 0.5 * self._allowed(stepping) and now.strain <= LARGE_STRAIN
        self.interval = min(2 * self.interval, LONGEST_INTERVAL) if calm and self.refinement == 1 else 1
        self.since = 0
        ease = self.refinement > 1 and self.calm >= self.patience
        stretched = now.strain > 1.2 * self.strain + 0.05 or now.strain < 0.5 * self.strain - 0.05
        if ease:
            self.refinement, self.calm = max(1.0, self.refinement / EASING), 0
        if stretched or self.refinement != stepping.choice.refinement:
            self.strain, self.anew = now.strain, True
        return stepping

    def _finer(self, stepping: Stepping, bound: Callable[[], StepChoice]) -> tuple[Stepping, Balance]:
        """Return what takes twice the substeps, at least, from the present state, and the balance of that."""
        choice = bound()
        self.refinement = max(2 * self.refinement, 2 * stepping.choice.substeps / choice.substeps)
        return self._with(stepping, choice.refined(self.refinement))

    def _with(self, stepping: Stepping, choice: StepChoice) -> tuple[Stepping, Balance]:
        """Return what goes on with other substeps, and the balance; the energy of another step is counted anew."""
        before = self._balance(stepping)
        if choice.substeps == stepping.choice.substeps:
            return stepping, before
        stepping = stepping.with_choice(choice)
        after = self._balance(stepping)
        self.least += after.energy - before.energy
        return stepping, after

    @staticmethod
    def _balance(stepping: Stepping) -> Balance:
        return balance(stepping.model, stepping.state, stepping.integrator.lag * stepping.choice.step)


def _works(stepping: Stepping) -> bool:
    """Tell whether anything may do work on the bodies."""
    return any(effect.works for effect in stepping.model.effects)


def _is_real(stepping: Stepping, rises: list[float]) -> bool:
    """Tell whether a rise is none of the step's doing: it stays the same as steps are halved, again and again.

    A body with nothing around it has no source of energy; an obstacle that stands still is one where it puts
    back what starts inside it.
    """
    if _works(stepping):
        return len(rises) > 1 and rises[-1] >= SAME * rises[-2]
    return bool(stepping.model.effects) and len(rises) > 2 and min(rises[-3:]) >= SAME * max(rises[-3:])
