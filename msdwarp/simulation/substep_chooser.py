"""SubstepChooser: how many substeps a frame needs, by the stability limit and by functions of time."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..engine import (
    LOOK,
    Assembly,
    Rates,
    State,
    functions_of,
    own_rates,
    rates_by_part,
    time_rates,
    world_rates,
)
from ..integrators import (
    Integrator,
    StepChoice,
    SymplecticEuler,
    UnstableStep,
    asked_by,
    choose_forced,
    choose_stable,
)
from .arguments import given_substeps
from .stepping import Stepping

EASE_AFTER = 60
"""Frames between looks at whether functions of one's own are less steep: recording frames again is slow."""
FEW = 2
"""Given substeps are warned of if automatic ones would be more than so many times as many."""


class SubstepChooser:
    """Chooses the substeps of a simulation, or of the worlds of an ensemble; see `Simulation` for the arguments.

    `StepController` then takes more where energy rises. `method` is the integrator, `forced` the given number of
    substeps, None for automatic ones.
    """

    def __init__(
        self,
        integrator: Integrator | None,
        fps: float,
        substeps: int | str,
        safety: float,
        allow_unstable: bool,
        refresh: bool = False,
    ) -> None:
        self.fps = checks.positive("fps", fps)
        self.method = SymplecticEuler() if integrator is None else integrator
        checks.instance("integrator", self.method, Integrator, "Leapfrog()")
        self.forced, self._safety = given_substeps(substeps), checks.between("safety", safety, 1e-3, 1)
        checks.one_of("allow_unstable", allow_unstable, (False, True))
        checks.one_of("refresh", refresh, (False, True))
        self._allow_unstable, self._refresh = allow_unstable, refresh and self.forced is None
        self.warned = False
        """Whether the run has been warned of a function that is too fast."""

    def choose(self, rates: Rates, assembly: Assembly, state: State, time: float, world: int = 0) -> StepChoice:
        """Return the substeps for these rates of a world; raise UnstableStep if the requested ones are too few."""
        given = rates, self.method, self.fps
        asked = partial(_asked, *given[1:], time, assembly, state, world)  # called for messages only
        if self.forced is not None and self._allow_unstable:
            return replace(choose_forced(*given, self.forced), asked=asked)
        try:
            return replace(choose_stable(*given, self.forced, self._safety), asked=asked)
        except UnstableStep as error:
            raise UnstableStep(f"{error}{asked()}") from None

    def rates(self, assembly: Assembly, state: State, time: float) -> list[Rates]:
        """Return bounds of the rates of worlds with different parameters, and what functions of time ask for."""
        found = world_rates(assembly, state)
        own = max(self._time_rates(assembly, state, time).values(), default=0.0)
        return [one._replace(own=max(one.own, own)) for one in found]

    def looks_at(self, assembly: Assembly, frame: int) -> bool:
        """Return whether functions of one's own, or of time, are looked at before frame number `frame`."""
        own = self.forced is None and bool(functions_of(assembly))
        return self._refresh or own or (frame % LOOK == 0 and any(one.timed for one in assembly.all))

    def is_outdated(self, stepping: Stepping, frame: int) -> bool:
        """Return whether substeps are chosen again before frame number `frame`, as functions have changed."""
        assembly, state, time = stepping.assembly, stepping.state, frame / self.fps
        if self._refresh or not self.looks_at(assembly, frame):
            return self._refresh
        functions, chosen = functions_of(assembly), max(one.rates.own for one in stepping.choices)
        for one in functions:
            one.hold(time)
        own, of_time = own_rates(assembly, state), 0.0
        now = float(np.max(own, initial=0.0, where=running(stepping)))
        if frame % LOOK == 0:
            of_time = max(self._time_rates(assembly, state, time).values(), default=0.0)
        ease = frame % (EASE_AFTER if functions else LOOK) == 0
        more = now > 1.1 * chosen or of_time > stepping.choice.substeps * self.fps
        return self.forced is None and (more or (ease and max(now, of_time) < 0.5 * chosen))

    def _time_rates(self, assembly: Assembly, state: State, time: float) -> dict[str, float]:
        """Return finite `time_rates` now; warn once of others, or if a function is too fast for given substeps."""
        found = time_rates(assembly, state, time, self.fps)
        name, most = max(found.items(), key=lambda one: one[1], default=("", 0.0))
        given = "automatic substeps" if self.forced is None else f"substeps={self.forced}"
        if most > FEW * (self.forced or checks.LARGEST) * self.fps and not self.warned:
            self.warned = True
            enough = math.ceil(most / self.fps) if most < math.inf else "no number"
            checks.warn(
                f"{name} changes too fast for {given} between {time:.4g} s and "
                f"{time + LOOK / self.fps:.4g} s; {enough} would resolve it",
                checks.StepWarning,
            )
        return {name: rate for name, rate in found.items() if math.isfinite(rate)}


def running(stepping: Stepping) -> NDArray[np.bool_]:
    """Return whether any of the worlds with the same parameters runs, shape [different]."""
    frozen, different = stepping.frozen, stepping.model.different
    status: Sequence[Any] | NDArray = np.zeros(different) if frozen is None else frozen.found().status
    return (np.asarray(status) == 0).reshape(-1, different).any(axis=0)


def _asked(method: Integrator, fps: float, time: float, *scene: Any) -> str:
    """Return as text how many substeps parts of a scene ask for, and its functions of time."""
    own = [one for one in time_rates(scene[0], scene[1], time, fps).items() if one[1] < math.inf]
    parts = rates_by_part(*scene) | {name: Rates(0.0, 0.0, math.inf, own=rate) for name, rate in own}
    return asked_by(parts, method, fps)
