"""Gradients: how a loss changes with the start and the parameters of a run."""

import math
import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..engine import (
    Adjoint,
    Assembly,
    Dynamics,
    StageAdjoint,
    State,
    Tape,
    copy_vectors,
    kicked,
    without_adjoint,
)
from ..integrators import Integrator, Leapfrog, StepChoice, SymplecticEuler
from ..runtime import in_turn, record
from ..world import Actuator
from .properties import Present
from .stepping import Stepping

GRADIENT_NAMES = (
    "position",
    "velocity",
    "stiffness",
    "damping",
    "rest_length",
    "mass",
    "gravity",
    "force",
    "strain",
)
"""What derivatives may be asked for by."""
EXPLODES = 1000.0
"""Growth of a gradient for each frame, above which `GradientWarning` says that it explodes."""


class Frames(NamedTuple):
    """The frames of a run, from its start on, as a loss gets them.

    Those of an ensemble have the axis of worlds first, like `Ensemble.frame`: shape [worlds, frames + 1,
    particle_count, d]. From the frame on in which a world diverges they are NaN.
    """

    time: NDArray[np.float64]
    """[s], shape [frames + 1]."""
    position: NDArray
    """[m], shape [frames + 1, particle_count, d]."""
    velocity: NDArray
    """At the same times [m/s], shape [frames + 1, particle_count, d]."""


Loss = Callable[[Frames], tuple[Any, Any, Any]]
"""Function of frames -> (value, ∂/∂position, ∂/∂velocity); a derivative may be None if it is 0."""


@dataclass(frozen=True)
class Gradient:
    """The value of a loss, and its derivatives by name: `gradient["stiffness"]`.

    Of an ensemble all arrays have the axis of worlds first. They are NaN for worlds that diverged.
    """

    value: Any
    """The loss; in an ensemble that of each world, shape [worlds]."""
    derivatives: dict[str, NDArray[np.float64]]
    """By name; each has the shape of its parameter in `System`, and that by gravity has d numbers.

    "force" has those by a constant force on each particle, shape [particle_count, d], in addition to all others.
    "strain" has the derivatives by the strains of actuators at each stage of each substep, and at the end of the
    run: shape [frames · substeps · stages + 1, column_count], a column for each delay of each actuator. Stages are
    at `integrator.stage_times`; `SymplecticEuler` and `Leapfrog` have one, at the start.
    """
    growth: NDArray[np.float64]
    """Size of the derivative by the state at each frame, over the largest that the loss has added from there on.

    Shape [frames + 1]. Derivatives by velocities count by their product with frames per second.
    """
    frames: Frames
    """The run."""

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the derivative by a parameter."""
        if name not in self.derivatives:
            raise KeyError(f"{name!r} was not asked for; there are {', '.join(map(repr, self.derivatives))}")
        return self.derivatives[name]


class Differentiated:
    """A run that can be led back: the frames forward, and their adjoint.

    Parameters
    ----------
    assembly, state
        The scene, at its start.
    method, choices
        The integrator, and the substeps of all frames; in an ensemble those that each world needs.
    start
        Time of the start [s].
    wanted
        Names of the derivatives that are asked for.
    energy_limit
        See `Simulation`.
    threads
        Number of CPU threads that share a frame.
    """

    def __init__(
        self,
        assembly: Assembly,
        state: State,
        method: Integrator,
        choices: Sequence[StepChoice],
        start: float,
        wanted: Iterable[str],
        energy_limit: float,
        threads: int = 1,
    ) -> None:
        self._model, self._fps, self._start = assembly.model, choices[0].fps, start
        self._given_v = state.empty_vectors(1)[0]
        wp.copy(self._given_v, state.v)
        dynamics = Dynamics(assembly, threads=threads)
        self._stepping = Stepping(
            dynamics, state, method, choices, energy_limit=energy_limit, blocks="auto", time=start
        )
        choice = self._stepping.choice
        self._first = self._model.vectors_together(2)
        copy_vectors(self._first, (state.x, state.v))
        self._dynamics, self._h, own = dynamics, choice.step, self._stepping.integrator
        self._stages = choice.substeps * len(own.stage_times)
        self._lag = own.lag * choice.step if own.staggered else 0.0
        """Time by which the method's velocities lag behind those given and read [s]."""
        work, tableau, names = own.workspace(state), own.tableau, set(wanted)
        self._tape = Tape(dynamics, choice.substeps, lambda one: own.substep(one, work, choice.step))
        self._adjoint = (
            Adjoint(dynamics, names) if tableau is None else StageAdjoint(dynamics, names, tableau, choice.step)
        )
        self._strains, self._by_strain = "strain" in names, None
        self._checkpoints: list[Sequence[wp.array]] = []
        self._v_read, self._times = self._model.vectors(), list[float]()
        self._graph: Any = None
        self.stopped = np.zeros(self._model.worlds if self._model.in_worlds else (), dtype=bool)
        """Which worlds have diverged, shape [worlds]; in a simulation False, of shape []."""

    def stop(self, status: NDArray[np.int32]) -> None:
        """Stop the worlds whose status is not 0 at the start."""
        self._dynamics.frozen.assign(status)

    def forward(self, frames: int) -> Frames:
        """Take frames from the start, and return them."""
        found = list[tuple[NDArray, NDArray]]()

        def read(time: float) -> None:
            frame = self._stepping.frame(time)
            found.append((np.array(frame.position), np.array(frame.velocity)))

        self.take(frames, read)
        position, velocity = (np.stack(each, axis=-3) for each in zip(*found, strict=True))
        velocity[..., 0, :, :] = self._of_each_world(self._given_v)
        if self._stepping.frozen is not None:
            last = self._stepping.frozen.found().good_frames
            self.stopped = last >= 0
            for w in np.flatnonzero(self.stopped):
                position[w, last[w] + 1 :] = velocity[w, last[w] + 1 :] = np.nan
        return Frames(np.array(self._times), position, velocity)

    def take(self, frames: int, look: Callable[[float], None] = lambda time: None) -> None:
        """Take frames from the start, and keep the state at the start of each; call `look` at its time [s]."""
        stepping, first = self._stepping, round(self._start * self._fps)
        times = self._times = [self._start, *((first + k + 1) / self._fps for k in range(frames))]
        if len(self._checkpoints) != frames + 1:
            self._checkpoints = [self._model.vectors_together(2) for _ in range(frames + 1)]
        now = stepping.state.x, stepping.state.v
        copy_vectors(now, self._first)
        stepping.begin_at(self._start)
        for k in range(frames + 1):
            if k > 0 and not stepping.advance(times[k - 1]):
                raise ValueError(f"the run diverged in frame {k - 1}; it needs more substeps, or a softer start")
            copy_vectors(self._checkpoints[k], now)
            look(times[k])

    def backward(
        self, by_position: Sequence[NDArray | None], by_velocity: Sequence[NDArray | None]
    ) -> NDArray[np.float64]:
        """Lead derivatives by frames, None for 0, back to the start; return their growth (see `Gradient`)."""
        adjoint, count = self._adjoint, len(by_position) - 1
        adjoint.clear()
        self._by_strain = None
        added = np.zeros((count + 1, self._model.worlds))
        for k in reversed(range(count + 1)):
            if k < count:
                self._lead_back(k)
            by_x, by_v = by_position[k], by_velocity[k]
            self._add(k, by_x, by_v)
            added[k] = np.hypot(_norm(by_x), self._fps * _norm(by_v))
            adjoint.measure(k, count + 1)
        adjoint.forget_driven(adjoint.by_x, adjoint.by_v)
        adjoint.add_up()
        most = np.maximum.accumulate(added[::-1])[::-1]
        sizes = np.hypot(*np.moveaxis(adjoint.sizes() * [1.0, self._fps], -1, 0))
        return self._model.of_each((sizes / np.where(most > 0, most, np.inf)).T)

    def _add(self, k: int, by_x: NDArray | None, by_v: NDArray | None) -> None:
        """Add derivatives by frame k, whose velocities are those at the time of its positions."""
        adjoint = self._adjoint
        if by_v is not None:
            if k > 0 and self._lag:  # they are read by a kick of half a substep from the method's velocities
                self._restart(k)
                self._dynamics.hold(float(self._times[k]))
                v_out = kicked(self._dynamics, self._tape.state, self._lag, self._v_read)
                with adjoint.aside(by_v):
                    x, v = self._tape.states[0]
                    adjoint.kick(0.0, self._lag, x, v, v_out, 0)
                self._keep_strains(k)
            else:
                adjoint.add(adjoint.by_v, by_v)
        if by_x is not None:
            adjoint.add(adjoint.by_x, by_x)

    def _restart(self, k: int) -> None:
        """Write the state at the start of frame k to the start of the tape."""
        copy_vectors(self._tape.states[0], self._checkpoints[k])
        self._tape.go_to(0)

    def _lead_back(self, k: int) -> None:
        """Take frame k again, and lead back through it; the first also through the shift of velocities."""
        self._restart(k)
        self._dynamics.begin_frame(float(self._times[k]))
        partition = self._dynamics.partition
        if partition is not None:
            self._graph = self._graph or partition.record(self._launch_back)
            self._graph.replay()
        else:
            self._graph = self._graph or record(self._launch_back, self._model.device)
            wp.capture_launch(self._graph)
        if k == 0 and self._lag:
            x, v = self._checkpoints[0]
            self._dynamics.hold(float(self._times[0]))
            self._adjoint.kick(0.0, -self._lag, x, self._given_v, v, 0)
        self._keep_strains(k)

    def _keep_strains(self, k: int) -> None:
        """Keep the derivatives by strains that launches of frame k have added."""
        if not self._strains:
            return
        stages = self._adjoint.take_strains()
        if self._by_strain is None:
            rows = self._stages * (len(self._times) - 1) + 1
            self._by_strain = np.zeros((*stages.shape[:-2], rows, stages.shape[-1]))
        begin = k * self._stages
        rows = self._by_strain[..., begin : begin + self._stages, :]
        rows += stages[..., : rows.shape[-2], :]

    def _launch_back(self) -> None:
        """Launch a frame's substeps, and their adjoints from the last to the first."""
        self._tape.launch()
        self._adjoint.frame(self._h, self._tape)
        self._adjoint.add_up()

    def found(self, names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        """Return the derivatives that have been asked for, NaN for worlds that have diverged."""
        result = {}
        state = {"position": self._adjoint.by_x, "velocity": self._adjoint.by_v}
        parameters = self._adjoint.found()
        if self._by_strain is not None:
            parameters["strain"] = self._by_strain
        for name in names:
            if name in state:
                result[name] = self._of_each_world(state[name]).astype(np.float64)
            else:
                result[name] = parameters[name]
            result[name][self.stopped] = np.nan
        return result

    def _of_each_world(self, vectors: wp.array) -> NDArray:
        """Return vectors of shape [particle_count, d], or [worlds, particle_count, d], on the host."""
        return self._model.of_each(self._model.by_world(vectors.numpy()))


def _norm(values: NDArray | None) -> Any:
    """Return the norm of vectors of shape [particle_count, d]; in an ensemble that of each world."""
    return 0.0 if values is None else np.sqrt((values**2).sum(axis=(-2, -1)))


class Differentiable(Present):
    """A simulation, or an ensemble, whose frames can be differentiated."""

    _surroundings: dict[str, Any]

    @abstractmethod
    def _assembled(self) -> tuple[Assembly, State]:
        """Return the scene once more, and its present state."""

    @in_turn
    def gradient(self, loss: Loss, frames: int, by: Sequence[str] = ("position", "velocity")) -> Gradient:
        """Return a loss of the coming frames, and its derivatives by the present state and by parameters.

        The frames are taken from the present state, at the present number of substeps, and led back from the last
        to the first; the simulation itself stays as it is. The state at the start of each frame is kept, and a
        frame's substeps are taken once more. See docs/gradients.md for what can be differentiated.

        In an ensemble each world has its own loss and derivatives, and all are led back together: `value` and what
        the loss returns, the derivatives and `growth` have the axis of worlds first, as the `Frames` have.

        Parameters
        ----------
        loss
            Function of the `Frames`, from the present one on, that returns its value, and its derivatives by their
            positions and by their velocities, each of the shape of these, or None for 0.
        frames
            How many frames to take.
        by
            Names of "position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity", "force", and
            "strain" of actuators; see `Gradient`.

        Raises
        ------
        ValueError
            If an argument is out of range, or the scene has something that has no derivative: its name is told.

        Warns
        -----
        GradientWarning
            If the gradient grows so much backwards that it tells little of finite changes.
        """
        run, found = self.differentiated(frames, by)
        told, both, stopped = loss(found), [], run.stopped
        if not isinstance(told, tuple) or len(told) != 3:
            raise ValueError(
                f"loss returned {checks.repr_short(told)}; it must return its value, and its derivatives by "
                "positions and by velocities (or None)"
            )
        value = np.array(told[0] if stopped.shape else float(told[0]), dtype=np.float64)
        if value.shape != stopped.shape:
            raise ValueError(
                f"loss returned a value of shape {value.shape}; it must be of shape {stopped.shape}, a number for "
                "each world"
            )
        value[stopped] = np.nan
        for name, each in zip(("∂/∂position", "∂/∂velocity"), told[1:], strict=True):
            values = [None] * len(found.time)
            if each is not None:
                if stopped.any():
                    each = np.where(stopped[:, None, None, None], 0.0, each)
                each = checks.broadcast(f"{name} of the loss", each, found.position.shape)
                values = [one if one.any() else None for one in np.moveaxis(each, -3, 0)]
            both.append(values)
        growth = run.backward(*both)
        growth[stopped] = 0.0
        most = float(growth.max())
        if not math.isfinite(most) or most > EXPLODES * frames:
            where = f" of world {int(growth.max(axis=-1).argmax())}" if stopped.shape else ""
            warnings.warn(
                f"the gradient{where} is {most:.2g} times as large at the start as what the loss adds: the motion "
                "is chaotic over so many frames, and the gradient tells nothing of finite changes",
                checks.GradientWarning,
                stacklevel=4,
            )
        growth[stopped] = np.nan
        return Gradient(value if stopped.shape else float(value), run.found(by), growth, found)

    def differentiated(self, frames: int, by: Sequence[str]) -> tuple[Differentiated, Frames]:
        """Take frames that can be led back, and return them; see `gradient` for the arguments and errors."""
        count = checks.count("frames", frames, 1)
        names = checks.sequence("by", by, str, "'stiffness'")
        for k, name in enumerate(names):
            checks.one_of(f"by[{k}]", name, GRADIENT_NAMES)
        method, around = self.integrator, self._surroundings
        led_back = method.tableau is not None or isinstance(method, SymplecticEuler | Leapfrog)
        if not led_back or method.method_state:
            raise ValueError(
                f"integrator is {method!r}; gradients need SymplecticEuler(), Leapfrog(), RK4(), RKC2() or "
                "ExplicitEuler()"
            )
        if self.model.compensated:
            raise ValueError(f"precision is {self.model.precision!r}; gradients need 'float32' or 'float64'")
        if missing := without_adjoint(self.assembly):
            raise ValueError(f"the scene has {' and '.join(missing)}; gradients cannot be led back through these")
        if "strain" in names and not any(isinstance(one, Actuator) for one in around["loads"]):
            raise ValueError("by has 'strain', that of actuators; there must be an Actuator among the loads")
        for name in ("gravity", "mass"):
            if name in names and callable(around["gravity"]):
                raise ValueError(f"by has {name!r}, and gravity is a function of time here; it must be constant")
        start = (self.time, names, self._energy_limit)
        assembly, state = self._assembled()
        choices, threads = self.stepping.choices, self.stepping.dynamics.threads
        run = Differentiated(assembly, state, method, choices, *start, threads)
        if self.stepping.frozen is not None:
            run.stop(self.stepping.frozen.found().status)
        return run, run.forward(count)
