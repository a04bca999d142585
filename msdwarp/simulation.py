"""Simulation: a system in its surroundings, advanced frame by frame on a device."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from . import checks
from .colliders import Plane
from .dynamics import Dynamics
from .integrators import Integrator, SymplecticEuler
from .kernels.watch import first_non_finite
from .model import Model, State
from .stability import stable_substeps
from .system import System


class Frame(NamedTuple):
    """One recorded instant, on the host."""

    time: float
    """Simulated time [s]."""
    position: NDArray
    """Particle positions [m], shape [particle_count, d]."""
    velocity: NDArray
    """Particle velocities [m/s], shape [particle_count, d]."""


class SimulationDiverged(RuntimeError):
    """A position or velocity is no longer finite; the run cannot go on."""

    def __init__(self, time: float, particle: int, advice: str) -> None:
        super().__init__(f"particle {particle} was no longer finite at {time:.4g} s; {advice}")
        self.time = time
        """End of the frame in which it happened [s]."""
        self.particle = particle
        """The first particle concerned."""


def frame_count(duration: float, fps: float) -> int:
    """Return how many frames of 1/fps s a duration [s] has, rounded; raise ValueError if there is none."""
    count = round(checks.positive("duration", duration) * checks.positive("fps", fps))
    if count == 0:
        raise ValueError(f"duration is {duration:g}; it must be at least one frame, {1 / fps:g} s")
    return count


class Simulation:
    """A system in its surroundings, advanced frame by frame on a device.

    Parameters
    ----------
    system
        What is simulated.
    gravity
        Acceleration of free fall [m/s²]: its size, downwards along the last coordinate, or a vector.
    colliders
        Obstacles.
    contact
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact`.
    integrator
        The time-stepping method.
    fps
        Frames per second of simulated time.
    substeps
        Integrator steps per frame; "auto" takes the least that stay within 0.8 of the stability limit
        of the system at the start (see `msdwarp.stability`).
    device
        A Warp device's name; by default the first CUDA device, else the CPU.
    precision
        "float32" or "float64".

    Raises
    ------
    ValueError
        If an argument is out of its range or there is no such device.
    """

    def __init__(
        self,
        system: System,
        *,
        gravity: ArrayLike = 9.82,
        colliders: Sequence[Plane] = (),
        contact: str = "coulomb",
        integrator: Integrator | None = None,
        fps: float = 60.0,
        substeps: int | str = "auto",
        device: str | None = None,
        precision: str = "float32",
    ) -> None:
        self.fps = checks.positive("fps", fps)
        self.integrator = SymplecticEuler() if integrator is None else integrator
        if not isinstance(self.integrator, Integrator):
            raise ValueError(f"integrator is {integrator!r}; it must be an instance of one, such as RK4()")
        if not isinstance(colliders, Iterable):
            raise ValueError(f"colliders is {colliders!r}; it must be a sequence of colliders")
        self.auto_substeps = substeps == "auto"
        if not self.auto_substeps:
            if isinstance(substeps, str):
                raise ValueError(f"substeps is {substeps!r}; it must be a whole number or 'auto'")
            self.substeps = checks.count("substeps", substeps, 1)
        self._surroundings: dict[str, Any] = {
            "gravity": gravity,
            "colliders": tuple(colliders),
            "contact": contact,
            "device": device,
            "precision": precision,
        }
        self._initial = system
        self.reset()

    def reset(self) -> None:
        """Go back to the system as it was given, at time 0, with the parameters it was given."""
        self.frame_index = 0
        self._load(self._initial)

    def _load(self, system: System) -> None:
        """Upload a system and prepare to advance it."""
        self.model = Model(system, **self._surroundings)
        self.system = system
        if self.auto_substeps:
            self.substeps = stable_substeps(system, self.integrator, self.fps)
        self._dynamics = Dynamics(self.model)
        self._watch = first_non_finite(self.model.dim, self.model.scalar)
        self._first_bad = wp.empty(1, dtype=int, device=self.model.device)
        self.state = State.of(system, self.model)
        self._work = self.integrator.workspace(self.state)
        self._graph: Any = None
        self.integrator.start(self._dynamics, self.state, self._work, self.dt)

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / (self.fps * self.substeps)

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self.frame_index / self.fps

    @property
    def device(self) -> str:
        """The device that simulates, by Warp's name for it."""
        return self.model.device.alias

    def step(self, frames: int = 1) -> None:
        """Advance by one frame or more.

        Raises
        ------
        SimulationDiverged
            If a position or velocity is no longer finite.
        """
        for _ in range(checks.count("frames", frames, 1)):
            if self._graph is None:
                self._graph = self._record_frame()
            wp.capture_launch(self._graph)
            self.frame_index += 1
            first_bad = int(self._first_bad.numpy()[0])
            if first_bad < self.model.particle_count:
                raise SimulationDiverged(self.time, first_bad, self._advice())

    def _record_frame(self) -> Any:
        """Record the substeps of a frame, and the watch after them, as one graph."""
        with wp.ScopedCapture(device=self.model.device) as capture:
            for _ in range(self.substeps):
                self.integrator.step(self._dynamics, self.state, self._work, self.dt)
            self._first_bad.fill_(self.model.particle_count)
            wp.launch(
                self._watch,
                dim=self.model.particle_count,
                inputs=[self.state.x, self.state.v],
                outputs=[self._first_bad],
                device=self.model.device,
            )
        return capture.graph

    def _advice(self) -> str:
        needed = stable_substeps(self.system, self.integrator, self.fps)
        if needed > self.substeps:
            return f"{self.substeps} substeps per frame are too few: {needed} would be stable"
        return f"try more than {self.substeps} substeps per frame: it was stretched far beyond its rest shape"

    def frame(self) -> Frame:
        """Return the present positions and velocities."""
        velocity = self.integrator.velocity(self._dynamics, self.state, self._work, self.dt)
        return Frame(self.time, _to_host(self.state.x), _to_host(velocity))

    def frames(self, duration: float) -> Iterator[Frame]:
        """Return an iterator over the present frame and every frame of the next `duration` seconds.

        Raises
        ------
        ValueError
            If the duration is not positive or shorter than a frame.
        SimulationDiverged
            While iterating, if a position or velocity is no longer finite.
        """
        count = frame_count(duration, self.fps)  # checked here, not at the first next()
        return self._frames(count)

    def _frames(self, count: int) -> Iterator[Frame]:
        yield self.frame()
        for _ in range(count):
            self.step()
            yield self.frame()

    def snapshot(self) -> System:
        """Return the system as it is now: present positions and velocities, present parameters."""
        _, position, velocity = self.frame()
        return self.system.replace(position=position, velocity=velocity)

    def change(self, **parameters: Any) -> None:
        """Change mass, stiffness, damping or rest_length between frames; positions and velocities stay.

        A mass of inf pins a particle where it is.
        Kernels are composed for the effects a scene has, so only a first damper or a first pinned particle
        needs another one. Substeps that were chosen automatically are chosen anew.

        Raises
        ------
        ValueError
            If a name is none of these, or a value is out of its range; nothing has changed then.
        """
        for name in parameters:
            checks.one_of("parameter", name, ("mass", "stiffness", "damping", "rest_length"))
        now = self.snapshot()
        velocity = now.velocity
        if "mass" in parameters:  # what is pinned stops where it is
            pinned = np.isinf(checks.broadcast("mass", parameters["mass"], now.mass.shape))
            velocity = np.where(pinned[:, None], 0.0, velocity)
        self._load(now.replace(velocity=velocity, **parameters))


def _to_host(array: wp.array) -> NDArray:
    """Copy to the host; on the CPU `numpy()` alone would show the array as it goes on changing."""
    return np.array(array.numpy())
