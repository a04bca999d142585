"""How all worlds of an ensemble are advanced by one frame after the other."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from ..engine import Assembly, Dynamics, EnsembleDivergenceMonitor, Rates, Stepper, Steps, starting_state
from ..integrators import Integrator, StepChoice, choose_forced
from .pinned_staging import CAPTURE_LOCK


class EnsembleStepping:
    """All worlds on a device, and how they are advanced: by which method, with how many substeps a frame.

    Parameters
    ----------
    assembly
        The worlds, and what acts on them; they begin where it says.
    method
        The time-stepping method.
    choices
        The substeps of a frame that worlds ask for, of those that differ: all take the most of them.
    energy_limit, threads
        See `Ensemble`.

    Attributes
    ----------
    state, watch, choice
        What moves; who looks at it; the substeps of all.
    integrator
        The method as it is best used with these.
    threads
        See `Ensemble`.
    """

    def __init__(
        self,
        assembly: Assembly,
        method: Integrator,
        choices: Sequence[StepChoice],
        *,
        energy_limit: float,
        threads: int | str | None,
    ) -> None:
        self._assembly, model = assembly, assembly.model
        fps = choices[0].fps
        self.state = starting_state(model.system, assembly, method.method_state, 0.0, fps)
        self.choice = max(choices, key=lambda choice: (choice.substeps, choice.rates.stiffness))
        fitting = Rates(
            max(one.rates.stiffness for one in choices),
            max(one.rates.damping for one in choices),
            min(one.rates.least_ratio for one in choices),
        )
        fps, substeps, step = self.choice.fps, self.choice.substeps, self.choice.step
        own = self.integrator = method.fitted(fitting, step)
        self._contact: Any = assembly.body_contact
        if self._contact is not None:
            self._contact.forget()
        self._dynamics = Dynamics(assembly)
        self._dynamics.begin(Steps(fps, substeps, own.stage_times, own.weights, own.lag, own.lagging))
        self._dynamics.hold(0.0)
        self._work = own.workspace(self.state)
        swing = np.array([choose_forced(one.rates, own, fps, substeps).energy_swing for one in choices])
        limit = energy_limit * swing[np.arange(model.worlds) % len(swing)]
        self.watch = EnsembleDivergenceMonitor(self._dynamics, self.state, limit)
        take_substep = partial(own.step, self._dynamics, self.state, self._work, step)
        self._stepper = Stepper(self._dynamics, self.state, take_substep, blocks=threads)
        self.threads = None if self._stepper.blocks is None else self._stepper.blocks[1]
        self._graph: Any = None
        self._generation = model.generation
        own.start(self._dynamics, self.state, self._work, step)

    def advance(self, time: float) -> None:
        """Advance all worlds that have not diverged by the frame that begins at `time` [s].

        What diverges meanwhile is frozen.
        """
        self._dynamics.begin_frame(time)
        self._take_frame()
        if self._contact is None:
            return
        while self._is_void():
            self.watch.go_back()
            self._take_frame()
        self._contact.frozen = self.watch.found()[0] != 0

    def _take_frame(self) -> None:
        """Launch a frame."""
        if self._graph is None or self._generation != self._assembly.model.generation:
            self._generation = self._assembly.model.generation
            with CAPTURE_LOCK, wp.ScopedCapture(device=self._assembly.model.device) as capture:
                self.watch.begin()
                self._stepper.take(self.choice.substeps)
                for effect in self._assembly.all:
                    effect.look()
                self.watch.end()
            self._graph = capture.graph
        wp.capture_launch(self._graph)

    def _is_void(self) -> bool:
        """Tell whether the frame just launched must be repeated, as lists of contacts did not hold."""
        if self._assembly.model.device.is_cuda:
            wp.synchronize_stream(self._assembly.model.device.stream)
        void = [effect.is_void() for effect in self._assembly.all]  # each of them is asked
        return any(void)

    def velocity(self) -> wp.array:
        """Return the velocities at the instant of the positions [m/s], on the device."""
        return self.integrator.velocity(self._dynamics, self.state, self._work, self.choice.step)
