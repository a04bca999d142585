"""Properties of simulations and ensembles that can be read between two frames."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NoReturn

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame, System
from ..engine import (
    LOOK,
    Assembly,
    Measures,
    Model,
    Rates,
    State,
    functions_of,
    measure,
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
from ..runtime import ReleasedInTurn, in_turn
from ..world import Change
from .arguments import given_substeps
from .pinned_staging import to_host
from .readings import Readings
from .stepping import Stepping

EASE_AFTER = 60
"""Frames between looks at whether functions of one's own are less steep: recording frames again is slow."""
FEW = 2
"""Given substeps are warned of if automatic ones would be more than so many times as many."""


def _asked(method: Integrator, fps: float, time: float, *scene: Any) -> str:
    """Return as text how many substeps parts of a scene ask for, and its functions of time."""
    own = [one for one in time_rates(scene[0], scene[1], time, fps).items() if one[1] < math.inf]
    parts = rates_by_part(*scene) | {name: Rates(0.0, 0.0, math.inf, own=rate) for name, rate in own}
    return asked_by(parts, method, fps)


class Present(ReleasedInTurn):
    """Properties common to simulations and ensembles.

    Attributes
    ----------
    stepping
        The worlds on their device, and the method that advances them.
    fps
        Frames per second of simulated time.
    frame_index
        Frames since the start.
    """

    stepping: Stepping
    fps: float
    frame_index: int
    _warned: set[type[Warning]]
    """Warnings that the run has given."""
    _due: Sequence[Change] = ()
    """Scheduled changes that have not been made yet."""

    def __reduce__(self) -> NoReturn:
        """Refuse copying and pickling, since memory and graphs on the device cannot be copied."""
        kind, instead = type(self).__name__, "use checkpoint and restore, or make another with the same arguments"
        raise TypeError(f"the {kind} cannot be copied or pickled; {instead}")

    def _held_back(self) -> NDArray[np.float64]:
        """Return the largest distance by which contact held a particle back, by world, in the last frame [m]."""
        contact = self.assembly.body_contact
        return np.zeros(self.model.worlds) if contact is None else contact.held_back

    def _inverted(self) -> NDArray[np.integer]:
        """Return the number of cells that are turned inside out, by world."""
        return self.assembly.inverted_cells.find(self.state.x).sum(axis=1)

    def _set_up_steps(
        self,
        integrator: Integrator | None,
        fps: float,
        substeps: int | str,
        safety: float,
        allow_unstable: bool,
        energy_limit: float,
    ) -> None:
        """Check and store the arguments that concern time steps."""
        self.fps = checks.positive("fps", fps)
        self._method = SymplecticEuler() if integrator is None else integrator
        checks.instance("integrator", self._method, Integrator, "Leapfrog()")
        self._forced, self._safety = given_substeps(substeps), checks.between("safety", safety, 1e-3, 1)
        checks.one_of("allow_unstable", allow_unstable, (False, True))
        self._allow_unstable = allow_unstable
        self._energy_limit = checks.non_negative("energy_limit", energy_limit, infinite=True)

    def _rates(self, assembly: Assembly, state: State) -> list[Rates]:
        """Return bounds of the rates of worlds with different parameters, and what functions of time ask for."""
        found, own = world_rates(assembly, state), max(self._time_rates(assembly, state).values(), default=0.0)
        return [one._replace(own=max(one.own, own)) for one in found]

    def _time_rates(self, assembly: Assembly, state: State) -> dict[str, float]:
        """Return finite `time_rates` now; warn once of others, or if a function is too fast for given substeps."""
        found = time_rates(assembly, state, self.time, self.fps)
        name, most = max(found.items(), key=lambda one: one[1], default=("", 0.0))
        given = "automatic substeps" if self._forced is None else f"substeps={self._forced}"
        if most > FEW * (self._forced or checks.LARGEST) * self.fps and checks.StepWarning not in self._warned:
            self._warned.add(checks.StepWarning)
            enough = math.ceil(most / self.fps) if most < math.inf else "no number"
            warnings.warn(
                f"{name} changes too fast for {given} between {self.time:.4g} s and "
                f"{self.time + LOOK / self.fps:.4g} s; {enough} would resolve it",
                checks.StepWarning,
                stacklevel=7,
            )
        return {name: rate for name, rate in found.items() if math.isfinite(rate)}

    def _looks_at(self, frame: int) -> bool:
        """Return whether functions of one's own, or of time, are looked at before frame number `frame`."""
        own = self._forced is None and bool(functions_of(self.assembly))
        return own or (frame % LOOK == 0 and any(one.timed for one in self.assembly.all))

    def _functions_changed(self) -> bool:
        """Return whether functions of one's own, or of time, need other substeps than those chosen."""
        if not self._looks_at(self.frame_index):
            return False
        functions, chosen = functions_of(self.assembly), max(one.rates.own for one in self.stepping.choices)
        for one in functions:
            one.hold(self.time)
        own, of_time = own_rates(self.assembly, self.state), 0.0
        now = float(np.max(own, initial=0.0, where=self._running()))
        if self.frame_index % LOOK == 0:
            of_time = max(self._time_rates(self.assembly, self.state).values(), default=0.0)
        ease = self.frame_index % (EASE_AFTER if functions else LOOK) == 0
        more = now > 1.1 * chosen or of_time > self.substeps * self.fps
        return self._forced is None and (more or (ease and max(now, of_time) < 0.5 * chosen))

    def _running(self) -> NDArray[np.bool_]:
        """Return whether any of the worlds with the same parameters runs, shape [different]."""
        frozen, different = self.stepping.frozen, self.model.different
        status = np.zeros(different) if frozen is None else frozen.found().status
        return (status == 0).reshape(-1, different).any(axis=0)

    def _choose(self, rates: Rates, *scene: Any) -> StepChoice:
        """Return the substeps for these rates; raise UnstableStep if the requested substeps are too few.

        `scene` are arguments of `rates_by_part`, which is called for messages only.
        """
        given = rates, self._method, self.fps
        asked = partial(_asked, *given[1:], self.time, *scene)  # without a reference to `self`
        if self._forced is not None and self._allow_unstable:
            return replace(choose_forced(*given, self._forced), asked=asked)
        try:
            return replace(choose_stable(*given, self._forced, self._safety), asked=asked)
        except UnstableStep as error:
            raise UnstableStep(f"{error}{asked()}") from None

    @property
    def assembly(self) -> Assembly:
        """The system on the device, with the effects that act on it."""
        return self.stepping.assembly

    @property
    def model(self) -> Model:
        """The system on the device."""
        return self.stepping.model

    @property
    def state(self) -> State:
        """The state on the device; velocities are at the integrator's own times."""
        return self.stepping.state

    @property
    def integrator(self) -> Integrator:
        """The time-stepping method with its options for the current number of substeps."""
        return self.stepping.integrator

    @property
    def choice(self) -> StepChoice:
        """The number of substeps per frame and its reason; in an ensemble the largest that a world needs."""
        return self.stepping.choice

    @property
    def substeps(self) -> int:
        """Integrator steps per frame; if automatic, the number in the last frame."""
        return self.choice.substeps

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return self.choice.step

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self.frame_index / self.fps

    @property
    def device(self) -> str:
        """The name of the Warp device."""
        return self.model.device.alias

    @property
    def positions(self) -> wp.array:
        """Current positions [m]: a Warp array on the device, which later steps overwrite.

        Vectors, shape [particle_count]; `Renderer.image` can draw them without a copy to the host. In an ensemble
        the array has the vectors of all worlds; each world begins `model.stride` after the previous one.
        """
        return self.state.x

    @in_turn
    def frame(self) -> Frame:
        """Return the current positions and velocities, shape [particle_count, d]; in an ensemble [worlds, ...]."""
        return self.stepping.frame(self.time)


class PresentWorld(Present):
    """The properties of a simulation that can be read between two frames.

    Attributes
    ----------
    readings
        Readings of the probes so far, by name: `times, values = simulation.readings["foot"]`.
    """

    readings: Readings

    @property
    def system(self) -> System:
        """The system as last uploaded, at the start or at the last change."""
        return self.stepping.model.system

    @property
    def threads(self) -> int:
        """Number of CPU threads; 1 on a GPU."""
        return self.stepping.dynamics.threads

    @in_turn
    def measure(self) -> Measures:
        """Return energies, momentum, strain and the number of inverted cells of the current state."""
        found = measure(self.assembly, self.state, self.stepping.velocity(), self.state.compensation.x)
        return found._replace(inverted=int(self._inverted()[0]))

    @property
    def rest_length(self) -> NDArray:
        """Current rest lengths of the connections [m], including plastic deformation."""
        return self.assembly.changed_fields().get("rest_length", self.system.rest_length)

    @property
    def held_back(self) -> float:
        """Largest distance by which contact held a particle back in a substep of the last frame, or 0 [m].

        If impulses between bodies do not suffice, displacements are shortened; velocities are only if any particle
        is pinned.
        """
        return float(self._held_back()[0])

    @in_turn
    def contact_force(self) -> NDArray:
        """Return the force of obstacles and other bodies on each particle [N], shape [particle_count, d].

        The mean over the last frame: the sum of contact impulses, divided by the frame's duration. It is 0 before
        the first frame, and after `settle` or another change that uploads the system again. Obstacles do not push
        pinned or driven particles.

        Raises
        ------
        ValueError
            If the simulation was made without `contact_forces=True` and without a probe of contact forces.
        """
        summed, model = self.stepping.contact_forces, self.model
        if summed is None:
            raise ValueError("contact_forces is False; it must be True for these forces to be summed")
        force = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)
        summed.write_force(force)
        return to_host(force)

    @in_turn
    def snapshot(self) -> System:
        """Return the system with its current positions, velocities and parameters."""
        _, position, velocity = self.frame()
        return self.system.replace(position=position, velocity=velocity, **self.assembly.changed_fields())
