"""Effect: the base class of everything that acts in a scene beside springs, dampers and gravity."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import Facets
from ...kernels.colliders import ColliderTerm
from ...kernels.effect import ForceTerm
from ...world import Load
from ..device.launcher import Launcher
from .model import Model
from .state import Instant


class Steps(NamedTuple):
    """The substeps of a frame, and the times at which their stages evaluate forces."""

    fps: float
    """Frames per second."""
    substeps: int
    """Substeps in a frame."""
    stage_times: Sequence[float] = (0.0,)
    """Times at which a method's launches evaluate forces, as fractions of the substep; the first is 0."""

    weights: Sequence[float] = (1.0,)
    """Weights of these evaluations in an integral over the substep; they sum to 1."""
    lag: float = 0.0
    """Time by which the method's velocities lag behind positions, in substeps."""

    lagging: bool = False
    """Whether the velocities passed to forces lag half a substep behind the positions."""

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / (self.fps * self.substeps)

    def times(self, start: float) -> NDArray[np.float64]:
        """Return the times of all force evaluations in the frame that begins at `start` [s], and of its end."""
        stages = np.arange(self.substeps)[:, None] + np.asarray(self.stage_times)
        return np.append(start + self.dt * stages, (round(start * self.fps) + 1) / self.fps)


class Numbers(NamedTuple):
    """The numbers on which the forces of elements depend, such as the pressure on a triangle."""

    group: NDArray[np.integer]
    """The group of each element: its elements share their numbers, and derivatives are summed over it."""
    width: int
    """How many numbers an element has."""
    of: Any = None
    """wp.func that returns those of an element, see `elements_adjoint`; None if `prepare` adds derivatives."""


class Elements(NamedTuple):
    """Groups of points with forces that depend only on the group, for gradients."""

    data: Any
    """The struct that `projected` reads."""
    projected: Any
    """wp.func that returns φ·F of an element, see `kernels.adjoint.elements_adjoint`."""
    points: NDArray[np.integer]
    """The points of each element, -1 for none, shape [element_count, k]: indices of particles or vertices."""
    vertices: Facets | None = None
    """The vertices, if points are vertices."""
    prepare: Callable[..., None] | None = None
    """Function (particle, weight, x, φ, by_numbers) that launches what must precede; see `elements_adjoint`."""
    of_all_worlds: bool = False
    """Whether `data` concatenates the elements of all worlds; else all worlds share it."""
    numbers: Numbers | None = None
    """The numbers on which the forces depend, if there are derivatives by them."""
    of_motion: bool = True
    """Whether the forces depend on the motion; else only derivatives by numbers need the elements."""


class Parameter(NamedTuple):
    """A derivative by a number, or several, of a load or an obstacle."""

    of: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Function that returns it from the sums of derivatives by numbers of elements, shape [..., group, k]."""
    varies: bool = False
    """Whether it is a function of time; then there is a derivative for each stage."""


def summed(
    model: Model, kernel: Any, count: int, inputs: Sequence[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Launch a kernel over worlds and `count` parts of an effect; return the sums of both its outputs, by world.

    The outputs are energies [J] and powers [W], float64 of shape [worlds, count].
    """
    shape = (model.worlds, count)
    found = [wp.zeros(shape, dtype=wp.float64, device=model.device) for _ in range(2)]
    wp.launch(kernel, shape, list(inputs), found, device=model.device)
    energies, powers = (one.numpy().sum(axis=1) for one in found)
    return energies, powers


class Effect:
    """Something that acts in a scene beside springs, dampers and gravity.

    An effect is one file in `engine`, one in `kernels`, and one line in `engine.stepping.assemble`. In a scene
    without it nothing of it is compiled, stored or launched. The stepper, checkpoints, the divergence monitor and
    the measures call every effect; an effect overrides the methods that it needs.
    """

    piece: ForceTerm | ColliderTerm | None
    """The term that it adds to kernels; None if the force algorithms do its work."""
    data: Any
    """The struct that the kernels read; it may be replaced in `begin` and `begin_substep`."""
    members: NDArray[np.bool_] | None = None
    """Mask of the particles that its force acts on, shape [particle_count], if `piece` is selective."""
    by_world: Sequence[str] = ()
    """Names of the arrays of `data` that have a part for each world."""
    done: wp.array | None = None
    """External work that it has done so far, as terms to sum [J], float64; None if it does none.

    If `piece.works`, `Work` sums it.
    """

    shared_points: int = 0
    """Number of its points that CPU threads can share, each about as much work as a connection."""

    conserves: bool = False
    """Whether its forces only store or dissipate energy, so that a rise of energy is due to the step."""

    numbers_substeps: bool = False
    """Whether its launches depend on the number of the substep in a frame, beyond the first two and the last."""

    launcher = Launcher()

    steps: Steps = Steps(1.0, 1)
    """The substeps of the coming frames; set when `begin` is called."""

    def go_on_from(self, other: "Effect") -> None:
        """Take over the state of `other`, which is this effect in the model before a change."""

    def use_launcher(self, launcher: Launcher) -> None:
        """Make launches that CPU threads may divide by this launcher."""
        self.launcher = launcher

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""

    def begin_frame(self, time: float) -> None:
        """Prepare for the frame that begins at `time` [s]: on the host, before the frame's graph is launched."""

    def place(self, state: Any, time: float, fps: float) -> None:
        """Write the prescribed part of a `State` at `time` [s], the start of a frame of 1 / `fps` seconds."""

    def prepare(self, time: float) -> None:
        """Prepare early, on the host, for the frame that begins at `time` [s], while another frame is running.

        The frame may never be run, or be replaced by another. So nothing may change that the device or
        `begin_frame` reads, and no exception may be raised.
        """

    def hold(self, time: float) -> None:
        """Set what depends on time to its value at `time` [s] in all stages, for launches between frames."""

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace loads (keys) by other loads of the same kind (values); `hold` is called next.

        Graphs may have recorded only the loads' arrays. See `differ_in_values` in `msdwarp/world/loads.py`.
        """

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """Reserve room for the neighbours of particles, for positions x and velocities v, when a run continues."""

    def search(
        self, x: wp.array, v: wp.array, compensation: Any, after: float, begins: bool, frame_begins: bool
    ) -> None:
        """Launch the search for neighbours, if it is due, for positions x and velocities v.

        It is launched before `before_forces`. `after` is the time from the end of the last substep [s]; `begins`
        and `frame_begins` tell whether a substep and a frame begin. Between frames only `frame_begins` is true.
        """

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch what must precede the evaluation of forces, for positions x and velocities v.

        `compensation` is the kernels' struct; `begins` tells whether these forces begin a substep. If an effect
        overrides this, each stage is a separate launch.
        """

    def watch(self) -> None:
        """Launch what `end_substep` needs, after `search`; it may run beside a substep's first forces."""

    def end_substep(self, before: Instant, after: Instant, substep: int) -> None:
        """Launch changes of the state at a substep's end, `after`, given the state at its start.

        Only effects that also override `before_forces` may do so.
        """

    @property
    def precedes(self) -> bool:
        """Whether the effect launches anything before forces are evaluated."""
        return self.overrides("before_forces")

    def overrides(self, *names: str) -> bool:
        """Tell whether the effect's class overrides any of these methods."""
        return any(getattr(type(self), name) is not getattr(Effect, name) for name in names)

    def add_up(self, seconds: float) -> None:
        """Launch the sum of the forces that `before_forces` has computed, weighted with `seconds`.

        Over the stages of a substep these weights sum to its length. Forces that are only measured are not summed.
        """

    def look(self) -> None:
        """Launch the kernels whose results `is_void` reads, after a frame's substeps; a graph may record it."""

    def is_void(self) -> bool:
        """Return whether the finished frame must be repeated; if so, reserve the room that it lacked."""
        return False

    def begin_substep(self, substep: int) -> bool:
        """Prepare for the launches of a substep of a frame, counted from 0; return whether `data` changed."""
        return False

    @property
    def changing(self) -> list[wp.array]:
        """Arrays that substeps change: a return to the start of a frame must restore them."""
        return []

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the state that substeps change, by name, in an order that does not depend on the device."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned."""

    def changed_fields(self) -> dict[str, NDArray]:
        """Return the current values of the system's fields that the run has changed."""
        return {}

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the effect's stiffness [N/m] and damping [N s/m] to the blocks for the stability bound.

        The arrays hold the diagonal blocks A_i and B_i of `integrators.stability`, float64 matrices of shape
        [particle_count], for the particles of a world at x. The bound is twice the largest eigenvalue of a block
        over the mass, as a spring between two particles needs. A force that depends on one particle adds half.
        """

    def add_resistance(self, x: wp.array, v: wp.array, damping: NDArray[np.float64]) -> None:
        """Add the derivative of resisting forces by each particle's speed [N s/m], shape [particle_count].

        Only for forces that depend on speeds, at positions x and velocities v.
        """

    def elements(self) -> Elements | None:
        """Return the elements whose forces Warp differentiates; None if the effect has none."""

    def parameters(self) -> dict[str, Parameter]:
        """Return the numbers by which there are derivatives, by name such as "loads[0].drag"."""
        return {}

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the energy that the effect stores [J] and the power that it dissipates [W], by world."""
        return np.zeros(1), np.zeros(1)
