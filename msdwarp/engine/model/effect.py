"""Effect: what acts in a scene beside springs, dampers and gravity."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.colliders import ColliderTerm
from ...kernels.effect import ForceTerm
from ...world import Load
from ..device.launcher import Launcher
from .state import Instant


class Steps(NamedTuple):
    """The substeps of a frame, and when their stages take forces."""

    fps: float
    """Frames per second."""
    substeps: int
    """Substeps in a frame."""
    stage_times: Sequence[float] = (0.0,)
    """When within a substep each launch of a method takes its forces, as shares of the substep; the first is 0."""

    weights: Sequence[float] = (1.0,)
    """What each of these counts in an integral over the substep; together 1."""
    lag: float = 0.0
    """Substeps by which the method keeps velocities behind positions."""

    lagging: bool = False
    """Whether the velocities that forces see lag half a substep behind the positions."""

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / (self.fps * self.substeps)

    def times(self, start: float) -> NDArray[np.float64]:
        """Return when the stages of the frame that begins at `start` [s] take their forces, and its end."""
        stages = np.arange(self.substeps)[:, None] + np.asarray(self.stage_times)
        return np.append(start + self.dt * stages, (round(start * self.fps) + 1) / self.fps)


class Effect:
    """What acts in a scene beside springs, dampers and gravity.

    An effect is one file in this room, one in kernels, and one line in `engine.stepping.assemble`. A scene without
    it compiles, stores and launches nothing of it. The stepper, checkpoints, the divergence monitor and the
    measures call every effect; an effect overrides the methods that concern it.
    """

    piece: ForceTerm | ColliderTerm | None
    """What it adds to kernels; None where the algorithms do it."""
    data: Any
    """The struct that the kernels read; it may be replaced in `begin` and `begin_substep`."""
    members: NDArray[np.bool_] | None = None
    """The particles that its force acts on, shape [particle_count], where its piece is selective."""
    by_world: Sequence[str] = ()
    """Names of arrays of `data` that hold the numbers of one world after the other's."""
    done: wp.array | None = None
    """Work that it has done from outside, as numbers to be added up [J], float64; None where it does none.

    That of a piece that `works` is summed without it.
    """

    rebuild_interval: int = 8
    """Substeps from one `search` to the next."""

    shared_points: int = 0
    """Points of it that threads of the CPU share, each about as much work as a connection."""

    steps: Steps = Steps(1.0, 1)
    """The substeps of the frames to come; known when `begin` is called."""

    def go_on_from(self, other: "Effect") -> None:
        """Continue from the same effect of the model before a change."""

    def use_partition(self, partition: Launcher | None) -> None:
        """Take the launcher that divides launches among threads of the CPU; None if there is one thread."""

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""

    def begin_frame(self, time: float) -> None:
        """Prepare for the frame that begins at `time` [s]: on the host, before the frame's graph is launched."""

    def place(self, state: Any, time: float, fps: float) -> None:
        """Write the prescribed part of a `State` at `time` [s], where one of `fps` frames a second begins."""

    def prepare(self, time: float) -> None:
        """Prepare early, on the host, for the frame that begins at `time` [s], while another is running.

        That frame may never come, or be another one: nothing may change that the device or `begin_frame` sees,
        and nothing is raised.
        """

    def hold(self, time: float) -> None:
        """Have all stages see the values at `time` [s], for launches between frames."""

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace each load that is a key by its value, of the same kind; then `hold` is called.

        Nothing may be recorded of them but arrays. See `msdwarp.world.exchange`.
        """

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """Make room for neighbours of particles at x that move at v, where a run continues."""

    def search(self, x: wp.array, v: wp.array, compensation: Any, within: bool) -> None:
        """Launch the search for neighbours, for particles at x that move at v.

        It is launched before every few substeps, and between frames wherever forces are taken. `within` tells
        whether the last search was in the same frame.
        """

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch what forces need before they are evaluated, for particles at x that move at v.

        `compensation` is as kernels have it; `begins` tells whether a substep begins with these forces. Where an
        effect does so, each stage is a launch of its own.
        """

    def end_substep(self, before: Instant, after: Instant, substep: int) -> None:
        """Launch what changes the end of a substep, `after`, knowing where it began.

        Only effects that also launch something before forces may do so.
        """

    @property
    def precedes(self) -> bool:
        """Whether it launches anything before forces are taken."""
        return self.overrides("before_forces")

    def overrides(self, *names: str) -> bool:
        """Tell whether it has any of these methods of its own."""
        return any(getattr(type(self), name) is not getattr(Effect, name) for name in names)

    def add_up(self, seconds: float) -> None:
        """Launch the sum of the forces that `before_forces` has found, which the method applies for `seconds`.

        Over the stages of a substep these add up to its length. Forces that are only measured are not summed.
        """

    def look(self) -> None:
        """Launch the kernels whose results `is_void` reads, after the substeps of a frame; it may be recorded."""

    def is_void(self) -> bool:
        """Tell whether the frame that was waited for must be repeated, now that there is room for it."""
        return False

    def warnings(self) -> str | None:
        """Return a warning about the frame that was waited for; None if there is none."""
        return None

    def begin_substep(self, substep: int) -> bool:
        """Prepare for the launches of a substep of a frame, counted from 0; return whether `data` changed."""
        return False

    @property
    def changing(self) -> list[wp.array]:
        """Arrays that substeps change, which going back to the start of a frame must restore."""
        return []

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the state that substeps have changed, by name, in an order that is the same on any device."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned."""

    def changed_fields(self) -> dict[str, NDArray]:
        """Return the fields of the system that the run has changed, as they are now."""
        return {}

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add to the bound of the rates the stiffness [N/m] and damping [N s/m] that it holds particles with.

        The arrays hold the diagonal blocks A_i and B_i of `integrators.stability`, float64 matrices of shape
        [particle_count], for particles of a world at x. The bound is twice the largest eigenvalue of a block over
        the mass.
        """

    def add_resistance(self, x: wp.array, v: wp.array, damping: NDArray[np.float64]) -> None:
        """Add how steeply the force on each particle rises against its speed [N s/m], shape [particle_count].

        The same for forces that depend on speeds, for particles at x that move at v.
        """

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the energy that it stores [J] and the power that it dissipates [W], by world."""
        return np.zeros(1), np.zeros(1)
