"""Present: what can be read off a simulation between two frames."""

import warp as wp
from numpy.typing import NDArray

from ..bodies import Frame, System
from ..engine import Measures, Model, State, measure
from ..integrators import Integrator, StepChoice
from .readings import Readings
from .stepping import Stepping


class Present:
    """What can be read off a simulation between two frames.

    Attributes
    ----------
    stepping
        The system on its device, and how it is advanced.
    fps
        Frames per second of simulated time.
    frame_index
        Frames since the start.
    readings
        What probes have told so far, by name: `times, values = simulation.readings["foot"]`.
    """

    stepping: Stepping
    fps: float
    frame_index: int
    readings: Readings

    @property
    def system(self) -> System:
        """The system as it was when it was last uploaded: at the start, or by the last change."""
        return self.stepping.model.system

    @property
    def model(self) -> Model:
        """The system on its device."""
        return self.stepping.model

    @property
    def state(self) -> State:
        """What moves, on the device; velocities are at the integrator's own instants."""
        return self.stepping.state

    @property
    def integrator(self) -> Integrator:
        """The time-stepping method as it is used with the present substeps."""
        return self.stepping.integrator

    @property
    def choice(self) -> StepChoice:
        """The substeps of a frame, and why."""
        return self.stepping.choice

    @property
    def substeps(self) -> int:
        """Integrator steps per frame, with automatic substeps those that the last one took."""
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
        """The device that simulates, by Warp's name for it."""
        return self.model.device.alias

    @property
    def threads(self) -> int:
        """How many threads of the CPU share the body's particles; 1 on a GPU."""
        return self.stepping.dynamics.threads

    def measure(self) -> Measures:
        """Return energies, momentum and strain of the present state."""
        return measure(self.model, self.state, self.stepping.velocity(), self.state.lost.x)

    @property
    def rest_length(self) -> NDArray:
        """Present rest lengths of the connections [m]: of the system, or where they yield what it has come to."""
        return self.stepping.changed_fields().get("rest_length", self.system.rest_length)

    @property
    def positions(self) -> wp.array:
        """Present positions [m] where they are: an array of Warp on the device, which later steps overwrite.

        It is of vectors, shape [particle_count]; `Renderer.image` draws it without a copy to the host.
        """
        return self.stepping.state.x

    def frame(self) -> Frame:
        """Return the present positions and velocities."""
        return self.stepping.frame(self.time)

    def contact_force(self) -> NDArray:
        """Return what obstacles and other bodies push each particle with [N], shape [particle_count, d].

        It is the mean over the frame before: the sum of the impulses of contact in it, over its length. It is 0
        before the first frame, and behind a change that uploads the system anew. Obstacles push no pinned or
        driven particles.

        Raises
        ------
        ValueError
            If the simulation was made without `contact_forces=True`, and no probe asks for such forces.
        """
        return self.stepping.contact_force()

    def snapshot(self) -> System:
        """Return the system as it is now: present positions and velocities, present parameters."""
        _, position, velocity = self.frame()
        return self.system.replace(position=position, velocity=velocity, **self.stepping.changed_fields())
