"""Effect: the base class of everything that acts in a scene beside springs, dampers and gravity."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import Facets
from ...kernels.colliders.collide import ColliderTerm
from ...kernels.effect import ElementForce, ForceTerm
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
    """Times at which launches of a method evaluate forces, as fractions of a substep; the first is 0."""

    weights: Sequence[float] = (1.0,)
    """Weights of the forces at `stage_times` in an integral over the substep; they sum to 1."""
    lag: float = 0.0
    """Time by which the method's velocities lag behind positions, in substeps."""

    lagging: bool = False
    """Whether the velocities passed to forces lag half a substep behind the positions."""
    still: bool = False
    """Whether functions of time keep their values at a frame's start, as in settling."""

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / (self.fps * self.substeps)

    def times(self, start: float) -> NDArray[np.float64]:
        """Return the times of all force evaluations in the frame from `start` [s], then the frame's end."""
        stages = np.arange(self.substeps)[:, None] + np.asarray(self.stage_times)
        if self.still:
            return np.full(stages.size + 1, start)
        return np.append(start + self.dt * stages, (round(start * self.fps) + 1) / self.fps)


class Elements(NamedTuple):
    """Groups of points, such as triangles under wind, whose forces depend on no other points; for gradients."""

    data: Any
    """The struct that the law reads."""
    law: ElementForce
    """The force of an element."""
    points: NDArray[np.integer]
    """Points of each element, −1 for none, shape [element_count, k]: indices of particles or of `vertices`."""
    vertices: Facets | None = None
    """The surface's vertices, if points are vertices; else None."""
    prepare: Callable[..., None] | None = None
    """Function (particle, weight, x, φ, by_numbers) that launches kernels before those of `elements_adjoint`."""
    of_all_worlds: bool = False
    """Whether `data` concatenates the elements of all worlds; else all worlds share it."""
    group: NDArray[np.integer] | None = None
    """The group of each element: its elements share their numbers, and derivatives are summed over it.

    None if there are no derivatives by numbers. For gases, the groups themselves; `prepare` adds derivatives.
    """
    of_motion: bool = True
    """Whether the forces depend on the motion; else only derivatives by numbers need the elements."""


class Parameter(NamedTuple):
    """A number or vector of a load or an obstacle with respect to which gradients are computed."""

    of: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Function that converts sums of derivatives by elements' numbers, shape [..., group, k], to this one."""
    varies: bool = False
    """Whether the parameter is a function of time; then there is a derivative for each stage."""


def summed(
    model: Model, kernel: Any, count: int, inputs: Sequence[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Launch a kernel over worlds and `count` items of an effect; return the sums of its two outputs by world.

    The outputs are energies [J] and powers [W], float64 of shape [worlds, count].
    """
    shape = (model.worlds, count)
    found = [wp.zeros(shape, dtype=wp.float64, device=model.device) for _ in range(2)]
    wp.launch(kernel, shape, list(inputs), found, device=model.device)
    energies, powers = (one.numpy().sum(axis=1) for one in found)
    return energies, powers


class Effect:
    """Something that acts in a scene beside springs, dampers and gravity.

    An effect is a file in `engine`, a file in `kernels`, and a line in `engine.stepping.assemble`. A scene without
    the effect compiles, stores and launches nothing of it. The stepper, checkpoints, the divergence monitor and
    the measures call every effect; a subclass overrides the methods that it needs.
    """

    term: ForceTerm | ColliderTerm | None
    """The effect's term in kernels; None if the force algorithms do its work."""
    data: Any
    """The struct that kernels read; `begin` and `begin_substep` may replace it."""
    members: NDArray[np.bool_] | None = None
    """Mask of the particles under the effect's force, shape [particle_count], if `term` is selective."""
    by_world: Sequence[str] = ()
    """Names of the arrays of `data` that have a part for each world."""
    done: wp.array | None = None
    """External work done by the effect so far, as terms to sum [J], float64; None if it does no work.

    If `term.works`, `Work` sums the work instead.
    """

    shared_points: int = 0
    """Number of the effect's points that CPU threads can divide; a point costs about as much as a connection."""

    conserves: bool = False
    """Whether the forces only store or dissipate energy, so that energy rises only if the step is too long."""

    timed: bool = False
    """Whether there are functions of time, of which `look_ahead` returns values."""

    numbers_substeps: bool = False
    """Whether launches differ between all substeps of a frame, not only for the first two and the last."""

    launcher = Launcher()

    steps: Steps = Steps(1.0, 1)
    """The substeps of the coming frames; set when `begin` is called."""

    def go_on_from(self, other: "Effect") -> None:
        """Copy the state of `other`: the same effect in the model before a change of the scene."""

    def use_launcher(self, launcher: Launcher) -> None:
        """Set the launcher that makes those launches that CPU threads may divide."""
        self.launcher = launcher

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""

    def begin_frame(self, time: float) -> None:
        """Prepare for the frame that begins at `time` [s]: on the host, before the frame's graph is launched."""

    def place(self, state: Any, time: float, fps: float) -> None:
        """Write the prescribed part of a `State` at `time` [s], the start of a frame of 1 / `fps` seconds."""

    def prepare(self, time: float) -> None:
        """Prepare early, on the host, for the frame that begins at `time` [s], while another frame may be running.

        The frame may never run, or another frame may run instead. So nothing may change that the device or
        `begin_frame` reads, and no exception may be raised.
        """

    def hold(self, time: float) -> None:
        """Set all stages of time-dependent tables to the value at `time` [s], for launches between frames."""

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace loads (keys) by other loads of the same kind (values); `hold` is called next.

        Graphs may have recorded the loads' arrays, nothing else. See `differ_in_values` in `world/loads.py`.
        """

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """Allocate lists of neighbours at positions x and velocities v, when a run starts or continues."""

    def search(
        self, x: wp.array, v: wp.array, compensation: Any, after: float, begins: bool, frame_begins: bool
    ) -> None:
        """Launch the search for neighbours, if one is due, for positions x and velocities v.

        The search precedes `before_forces`. `after` is the time since the end of the last substep [s]; `begins`:
        a substep begins; `frame_begins`: a frame begins. Between frames only `frame_begins` is true.
        """

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch kernels that must precede the evaluation of forces, for positions x and velocities v.

        `compensation` is a struct of kernels; `begins`: these are the first forces of a substep. If an effect
        overrides this method, each stage is a separate launch.
        """

    def watch(self) -> None:
        """Launch kernels that `end_substep` needs, after `search`; they may run parallel to the first forces."""

    def end_substep(self, before: Instant, after: Instant, substep: int) -> None:
        """Launch changes of `after`, the state at a substep's end, given `before`, the state at its start.

        Only effects that also override `before_forces` may change the state.
        """

    @property
    def precedes(self) -> bool:
        """Whether the effect launches anything before forces are evaluated."""
        return self.overrides("before_forces")

    def overrides(self, *names: str) -> bool:
        """Return whether the effect's class overrides any of these methods."""
        return any(getattr(type(self), name) is not getattr(Effect, name) for name in names)

    def add_up(self, seconds: float) -> None:
        """Launch the sum of the forces that `before_forces` has just computed, weighted with `seconds`.

        Over a substep's stages the weights sum to its length. Only measurements read these sums.
        """

    def look(self) -> None:
        """Launch the kernels whose results `is_void` reads, at the end of a frame; a graph may record them."""

    def will_be_void(self) -> bool:
        """Return whether the frame that runs must be repeated, so that its other substeps would be in vain."""
        return False

    def is_void(self) -> bool:
        """Return whether the finished frame must be repeated; if so, first allocate the room that it lacked."""
        return False

    def tell_repeats(self, time: float, times: int) -> None:
        """Warn that the frame from `time` [s] on has been void so many times, why, and what to do."""

    def begin_substep(self, substep: int) -> bool:
        """Prepare for the launches of a substep of a frame, counted from 0; return whether `data` changed."""
        return False

    @property
    def changing(self) -> list[wp.array]:
        """Arrays that substeps change; they must be restored to repeat a frame."""
        return []

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the state that substeps change, by name, in an order that does not depend on the device."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned."""

    def changed_fields(self) -> dict[str, NDArray]:
        """Return current values of the system's fields that the run has changed, by name."""
        return {}

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the effect's stiffness [N/m] and damping [N s/m] to the diagonal blocks for the stability bound.

        The arrays hold the blocks A_i and B_i of `integrators.stability`, float64 matrices of shape
        [particle_count], for the particles of a world at x. The bound is twice the largest eigenvalue of block
        over mass, as for a spring between two particles. So a force that depends on only one particle adds half.

        `ElementLoads` takes Warp's derivatives of its force. Others have bounds by hand, since these must hold
        longer than the present: for the next second of a wind or a pressure, before an obstacle is touched, in the
        directions to which a spring turns.
        """

    def add_resistance(self, x: wp.array, v: wp.array, damping: NDArray[np.float64]) -> None:
        """Add the derivative of each particle's resisting forces by its speed [N s/m], shape [particle_count].

        For forces that depend on speeds, at positions x and velocities v.
        """

    def look_ahead(self, times: NDArray[np.float64], x: wp.array, v: wp.array) -> dict[str, NDArray[np.float64]]:
        """Return values of the effect's functions of time by name, shape [time_count, columns, width].

        Functions also of place are taken for particles at positions x with velocities v. The substeps follow from
        these values, each column by itself (`time_rates`). Raises ValueError if one is undefined.
        """
        return {}

    def elements(self) -> Elements | None:
        """Return the elements whose forces Warp differentiates; None if the effect has none."""

    def parameters(self) -> dict[str, Parameter]:
        """Return the parameters for gradients, by names such as "loads[0].drag"."""
        return {}

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the energy that the effect stores [J] and the power that it dissipates [W], by world."""
        return np.zeros(1), np.zeros(1)
