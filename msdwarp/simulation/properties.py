"""Present: what can be read of a simulation and of an ensemble between two frames."""

from collections.abc import Sequence
from typing import NoReturn

import warp as wp

from ..bodies import Frame
from ..engine import Assembly, Model, State
from ..integrators import Integrator, StepChoice
from ..runtime import ReleasedInTurn, in_turn
from ..world import Problem
from .gradient import Gradient, Loss, check_differentiable, differentiated, gradient
from .gradient_run import Differentiated, Frames
from .run import Run
from .stepping import Stepping


class Present(ReleasedInTurn):
    """Views of the `Run` that a simulation or an ensemble owns, and gradients from its state on."""

    _run: Run

    def __reduce__(self) -> NoReturn:
        """Refuse copying and pickling, since memory and graphs on the device cannot be copied."""
        kind, instead = type(self).__name__, "use checkpoint and restore, or make another with the same arguments"
        raise TypeError(f"the {kind} cannot be copied or pickled; {instead}")

    def __getitem__(self, index: object) -> NoReturn:
        """Refuse an index, which would be that of a world or of a frame."""
        instead = "simulation_of(k) is a world of an ensemble, and frame() the present frame"
        raise TypeError(f"the {type(self).__name__} has no items; {instead}")

    @property
    def stepping(self) -> Stepping:
        """The worlds on their device, and the method that advances them."""
        return self._run.stepping

    @property
    def fps(self) -> float:
        """Frames per second of simulated time."""
        return self._run.chooser.fps

    @property
    def frame_index(self) -> int:
        """Frames since the start."""
        return self._run.frame_index

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._run.time

    @property
    def problem(self) -> Problem:
        """Bodies and what surrounds them, as last uploaded: at the start or at the last change."""
        return self._run.problem

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

    @in_turn
    def gradient(self, loss: Loss, frames: int, by: Sequence[str] = ("position", "velocity")) -> Gradient:
        """Return a loss of the coming frames, and its derivatives by the present state and by parameters.

        The frames are simulated from the present state with the present number of substeps, and derivatives are
        propagated back from the last to the first; the simulation itself stays as it is. The state at the start of
        each frame is stored (of every k-th if memory is short), and a frame's substeps are repeated from it. See
        docs/gradients.md for what can be differentiated.

        In an ensemble each world has its own loss and derivatives: `value`, all that `loss` returns, the
        derivatives and `growth` have the axis of worlds first, like the `Frames`.

        Parameters
        ----------
        loss
            Function of the `Frames`, from the present one on. It returns the loss, and its derivatives by their
            positions and by their velocities, of the same shapes, one of which may be None for 0. If it returns an
            array of JAX or a tensor of PyTorch alone, it is called again with frames of such arrays, from which
            that library finds the derivatives.
        frames
            Number of frames to simulate.
        by
            Names of "position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity", "force", and
            "strain" of actuators; and numbers of loads and soft obstacles, such as "loads[0].velocity" of a wind,
            and "colliders[0].friction". See `Gradient`.

        Raises
        ------
        ValueError
            If an argument is out of range, or a part of the scene, which the message names, has no derivative.

        Warns
        -----
        GradientWarning
            If the gradient grows so much backwards that it says little about finite changes.
        """
        return gradient(self, self._run, loss, frames, by)

    def differentiated(self, frames: int, by: Sequence[str]) -> tuple[Differentiated, Frames]:
        """Simulate frames, and return the run and its frames; see `gradient` for the arguments and errors."""
        return differentiated(self._run, frames, by)

    def check_differentiable(self, frames: int, by: Sequence[str]) -> tuple[int, Sequence[str]]:
        """Return the arguments of `gradient`; raise ValueError as it does, before anything is simulated."""
        return check_differentiable(self._run, frames, by)
