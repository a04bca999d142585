"""A differentiable run: frames forward, and derivatives of a loss from the last frame to the first."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
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
)
from ..integrators import Integrator, StepChoice
from .stepping import Stepping

MOST_MEMORY, MOST_FOR_SUBSTEPS = 1 / 4, 1 / 16
"""Most of the free memory that states at the start of all frames may take, and those of all substeps. On a CPU the
frames that the loss gets take nearly as much again as the former, and its derivatives twice that."""

MOST_KEPT = 100_000
"""Number of particles above which a GPU simulates a substep as fast as it copies its state (an H100)."""


class Frames(NamedTuple):
    """The frames of a run, from its start on, as they are passed to a loss.

    Arrays of an ensemble have the axis of worlds first, like `Ensemble.frame`: shape [worlds, frames + 1,
    particle_count, d]. They are NaN from the frame on in which a world diverges.

    Attributes
    ----------
    time
        Simulated times [s], shape [frames + 1].
    position
        Particle positions [m], shape [frames + 1, particle_count, d].
    velocity
        Particle velocities [m/s], shape [frames + 1, particle_count, d].
    """

    time: NDArray[np.float64]
    position: NDArray
    velocity: NDArray


class Differentiated:
    """A differentiable run: the frames forward, and their adjoint.

    Parameters
    ----------
    assembly, state, own_v
        The scene, at its start, with velocities at the time of the positions; the method's own velocities [m/s].
    method, choices
        The integrator, and the substeps of all frames; in an ensemble those that each world needs.
    start
        Time of the start [s].
    wanted
        Names of the requested derivatives.
    energy_limit
        See `Simulation`.
    threads
        Number of CPU threads that share a frame.
    """

    def __init__(
        self,
        assembly: Assembly,
        state: State,
        own_v: wp.array,
        method: Integrator,
        choices: Sequence[StepChoice],
        start: float,
        wanted: Iterable[str],
        energy_limit: float,
        threads: int = 1,
    ) -> None:
        self._model, self._fps, self._start = assembly.model, choices[0].fps, start
        self._given_v = state.model.vectors()
        wp.copy(self._given_v, state.v)
        dynamics = Dynamics(assembly, threads=threads)
        self._stepping = Stepping(
            dynamics, state, method, choices, energy_limit=energy_limit, blocks="auto", time=start
        )
        choice = self._stepping.choice
        wp.copy(state.v, own_v)
        self._first = self._model.vectors_together(2)
        copy_vectors(self._first, (state.x, state.v))
        self._dynamics, self._h, own = dynamics, choice.step, self._stepping.integrator
        self._stages = choice.substeps * len(own.stage_times)
        self._lag = own.lag * choice.step if own.staggered else 0.0
        """Time by which the method's velocities lag behind the velocities that users give and read [s]."""
        work, tableau, names = own.workspace(state), own.tableau, set(wanted)
        self._tape = Tape(dynamics, choice.substeps, lambda one: own.substep(one, work, choice.step))
        if tableau is None:
            self._adjoint = Adjoint(dynamics, names)
        else:
            self._adjoint = StageAdjoint(dynamics, names, tableau, choice.step)
        self._by_stage = dict[str, NDArray[np.float64]]()
        self._checkpoints, self._between = list[Sequence[wp.array]](), list[Sequence[wp.array]]()
        self._tapes = list[wp.array]()
        """The tape of each frame, if they are kept: then no frame is simulated again."""
        self._every, self._part = 1, 0
        """Frames between checkpoints; number of the checkpoint after which states of all frames are stored."""
        self._v_read, self._times = self._model.vectors(), list[float]()
        self._graphs = dict[str, Any]()
        self.stopped = np.zeros(self._model.worlds if self._model.in_worlds else (), dtype=bool)
        """Which worlds have diverged, shape [worlds]; in a simulation False, of shape []."""
        self.times = dict[str, NDArray[np.float64]]()
        """Times at which each requested function of time was evaluated, by name [s]."""

    def stop(self, status: NDArray[np.int32]) -> None:
        """Stop the worlds whose status is not 0 at the start."""
        self._dynamics.frozen.assign(status)

    def forward(self, frames: int) -> Frames:
        """Simulate frames from the start, and return them."""
        model = self._model
        shape: tuple[int, ...] = (frames + 1, model.particle_count, model.dim)
        shape = (model.worlds, *shape) if model.in_worlds else shape
        size = 2 * math.prod(shape) * np.dtype(model.dtype).itemsize
        checks.fits(f"frames is {frames}", "their positions and velocities", size)
        position, velocity = (np.empty(shape, model.dtype) for _ in range(2))

        def read(k: int) -> None:
            frame = self._stepping.frame(self._times[k])
            position[..., k, :, :], velocity[..., k, :, :] = frame.position, frame.velocity

        self.take(frames, read)
        velocity[..., 0, :, :] = self._of_each_world(self._given_v)
        if self._stepping.frozen is not None:
            last = self._stepping.frozen.found().good_frames
            self.stopped = last >= 0
            for w in np.flatnonzero(self.stopped):
                position[w, last[w] + 1 :] = velocity[w, last[w] + 1 :] = np.nan
        return Frames(np.array(self._times), position, velocity)

    def take(self, frames: int, look: Callable[[int], None] = lambda k: None) -> None:
        """Simulate frames from the start and store states for `backward`; call `look` with each frame's index."""
        stepping, first = self._stepping, round(self._start * self._fps)
        if len(self._times) != frames + 1:
            self._make_room(frames + 1)
        times = self._times = [self._start, *((first + k + 1) / self._fps for k in range(frames))]
        now = stepping.state.x, stepping.state.v
        copy_vectors(now, self._first)
        stepping.begin_at(self._start)
        stepping.velocities.give(None)
        for k in range(frames + 1):
            if k > 0 and not stepping.advance(times[k - 1]):
                raise ValueError(f"the run diverged in frame {k - 1}; it needs more substeps, or a softer start")
            copy_vectors(self._place(k), now)
            if k > 0 and self._tapes:
                wp.copy(self._tapes[k - 1], self._tape.storage)
            look(k)
        self._part = frames // self._every

    def _make_room(self, count: int) -> None:
        """Make room for the states of all substeps, or at the start of `count` frames, or for 2 √count, as fit."""
        x: Any = self._first[0]
        device, size, substeps = x.device, 2 * len(x) * x.strides[0], len(self._tape.states)
        free = device.free_memory if device.is_cuda else checks.free_memory()
        many = free is not None and count * size > MOST_MEMORY * free
        self._every = math.isqrt(count - 1) + 1 if many else 1
        small = not device.is_cuda or len(x) <= MOST_KEPT
        keep = small and free is not None and (count - 1) * substeps * size <= MOST_FOR_SUBSTEPS * free
        self._tapes = [wp.empty_like(self._tape.storage) for _ in range(count - 1)] if keep else []
        on_tape = partial(self._tape.advance, self._stepping.state)
        self._stepping.launch_substeps_by(on_tape if keep else self._stepping.stepper.take)
        self._checkpoints = [self._model.vectors_together(2) for _ in range(0, count, self._every)]
        self._between = [self._model.vectors_together(2) for _ in range(self._every - 1)]

    def _place(self, k: int) -> Sequence[wp.array]:
        """Return the arrays for the state at the start of frame k."""
        part, after = divmod(k, self._every)
        return self._between[after - 1] if after else self._checkpoints[part]

    def _state(self, k: int) -> Sequence[wp.array]:
        """Return the state at the start of frame k; if it is not stored, repeat frames since its checkpoint."""
        part, now = k // self._every, (self._stepping.state.x, self._stepping.state.v)
        if part != self._part:
            self._part, begin = part, part * self._every
            copy_vectors(now, self._checkpoints[part])
            for n in range(begin, min(begin + len(self._between), len(self._times) - 1)):
                self._dynamics.begin_frame(self._times[n])
                self._play(self._launch_again)
                copy_vectors(self._place(n + 1), now)
        return self._place(k)

    def by_frame(self, values: NDArray[np.float64]) -> list[NDArray | None]:
        """Return derivatives by each frame, None if they are all 0; for worlds that have diverged they are 0."""
        if self.stopped.any():
            values = np.where(self.stopped[:, None, None, None], 0.0, values)
        return [one if one.any() else None for one in np.moveaxis(values, -3, 0)]

    def backward(
        self, by_position: Sequence[NDArray | None], by_velocity: Sequence[NDArray | None]
    ) -> NDArray[np.float64]:
        """Propagate derivatives by frames (None for 0) back to the start; return their growth (see `Gradient`)."""
        adjoint, count = self._adjoint, len(by_position) - 1
        adjoint.clear()
        self._by_stage = {}
        added = np.zeros((count + 1, self._model.worlds))
        for k in reversed(range(count + 1)):
            if k < count:
                self._propagate_frame(k)
            by_x, by_v = by_position[k], by_velocity[k]
            self._add(k, by_x, by_v)
            added[k] = np.hypot(_norm(by_x), self._fps * _norm(by_v))
            adjoint.measure(k, count + 1)
        adjoint.forget_driven(0)
        if adjoint.motions is not None:
            adjoint.motions.take_start(self._start, self._lag)
        adjoint.add_up()
        most = np.maximum.accumulate(added[::-1])[::-1]
        sizes = np.hypot(*np.moveaxis(adjoint.sizes() * [1.0, self._fps], -1, 0))
        sizes[:, self.stopped] = 0.0
        return self._model.of_each((sizes / np.where(most > 0, most, np.inf)).T)

    def _add(self, k: int, by_x: NDArray | None, by_v: NDArray | None) -> None:
        """Add derivatives by the positions of frame k, and by its velocities at the time of the positions."""
        adjoint = self._adjoint
        if by_v is not None:
            if k > 0 and self._lag:  # a kick of half a substep gives them from the method's velocities
                self._restart(k)
                self._dynamics.hold(float(self._times[k]))
                v_out = kicked(self._dynamics, self._tape.state, self._lag, self._v_read)
                with adjoint.aside(by_v):
                    x, v = self._tape.states[0]
                    adjoint.kick(0.0, self._lag, x, v, v_out, 0)
                self._keep_stages(k)
                if adjoint.motions is not None:
                    by_worlds = by_v.reshape(self._model.worlds, *by_v.shape[-2:])
                    adjoint.motions.add_reading(float(self._times[k]), self._lag, by_worlds)
            else:
                adjoint.add(adjoint.by_v, by_v)
        if by_x is not None:
            adjoint.add(adjoint.by_x, by_x)

    def _restart(self, k: int) -> None:
        """Copy the state at the start of frame k to the start of the tape."""
        copy_vectors(self._tape.states[0], self._state(k))
        self._tape.go_to(0)

    def _propagate_frame(self, k: int) -> None:
        """Propagate derivatives back through frame k; for k = 0 also to the given velocities."""
        if self._tapes:
            wp.copy(self._tape.storage, self._tapes[k])
        else:
            self._restart(k)
        self._dynamics.begin_frame(float(self._times[k]))
        self._play(self._launch_adjoint if self._tapes else self._launch_back)
        self._keep_stages(k)
        if k == 0 and self._lag:
            x, v = self._checkpoints[0]
            self._dynamics.hold(float(self._times[0]))
            self._adjoint.kick(0.0, -self._lag, x, self._given_v, v, 0)
            self._keep_stages(k, before=self._start > 0)
        if self._adjoint.motions is not None:
            self._adjoint.motions.take_frame(float(self._times[k]))

    def _keep_stages(self, k: int, *, before: bool = False) -> None:
        """Store the derivatives by functions of time that the launches of frame k, or `before` it, have summed."""
        axis = int(self._model.in_worlds)
        for name, added in self._adjoint.take_stages().items():
            if before and self._adjoint.varies(name):  # what it was then is past
                continue
            added = np.moveaxis(added, axis, 0)
            if name not in self._by_stage:
                self._by_stage[name] = np.zeros((self._stages * (len(self._times) - 1) + 1, *added.shape[1:]))
            rows = self._by_stage[name][k * self._stages :][: self._stages]
            rows += added[: len(rows)]

    def _play(self, launch: Callable[[], None]) -> None:
        """Run the launches of a method; they are recorded as a graph the first time, and then replayed."""
        name = launch.__name__
        self._graphs[name] = self._graphs.get(name) or self._dynamics.recorded(launch)
        self._graphs[name]()

    def _launch_again(self) -> None:
        """Launch a frame's substeps once more, without checks: the first run of the frame has passed them."""
        self._stepping.stepper.take(self._stepping.choice.substeps)

    def _launch_back(self) -> None:
        """Launch a frame's substeps again, and their adjoints."""
        self._tape.launch()
        self._launch_adjoint()

    def _launch_adjoint(self) -> None:
        """Launch the adjoints of the substeps on the tape, from the last to the first."""
        self._adjoint.frame(self._h, self._tape)
        self._adjoint.add_up()

    def found(self, names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        """Return the requested derivatives, NaN for worlds that have diverged."""
        result = {}
        state = {"position": self._adjoint.by_x, "velocity": self._adjoint.by_v}
        parameters, motions = self._adjoint.found(), self._adjoint.motions
        stages = [self._dynamics.steps.times(time)[:-1] for time in self._times[:-1]]
        times = np.concatenate([*stages, self._times[-1:]])
        for name, values in self._by_stage.items():
            if self._adjoint.varies(name):
                parameters[name], self.times[name] = np.moveaxis(values, 0, int(self._model.in_worlds)), times
            else:
                parameters[name] = np.asarray(values.sum(axis=0))
        if motions is not None:
            for name in motions.names:
                self.times[name], values = motions.found(name)
                parameters[name] = self._model.of_each(values)
        for name in names:
            if name in state:
                result[name] = self._of_each_world(state[name]).astype(np.float64)
            else:
                result[name] = parameters[name]
            result[name][self.stopped] = np.nan
        return result

    def _of_each_world(self, vectors: wp.array) -> NDArray:
        """Return an array of vectors on the host, of shape [particle_count, d] or [worlds, particle_count, d]."""
        return self._model.of_each(self._model.by_world(vectors.numpy()))


def _norm(values: NDArray | None) -> Any:
    """Return the norm of vectors of shape [particle_count, d]; in an ensemble the norm for each world."""
    if values is None:
        return 0.0
    flat = np.asarray(values).reshape(*np.shape(values)[:-2], -1)
    return np.sqrt((flat[..., None, :] @ flat[..., None])[..., 0, 0])  # by BLAS, without an array of squares
