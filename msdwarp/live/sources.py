"""Sources of a view: a running simulation, or a trajectory that is replayed."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import Frame
from ..files import Trajectory
from ..pictures import framed
from ..runtime import find_device
from ..simulation import Simulation
from ..world import Scene
from .handling import Handling

MOST_SEEN = 200
"""Maximal number of frames of a trajectory that are read to place the camera."""
ASPECT = 16 / 9
"""Width over height of the picture for which the camera is placed; others show nearly as much."""

BELOW = 0.35
"""Height below a body without ground, which may fall, in the first view; as a fraction of the body's length."""


class Reading(NamedTuple):
    """Energies [J] and the largest strain |l / l0 − 1| at a time [s]."""

    time: float
    kinetic: float
    elastic: float
    potential: float
    strain: float

    @property
    def sum(self) -> float:
        """Kinetic, elastic and potential energy [J]."""
        return self.kinetic + self.elastic + self.potential


class Running:
    """A running simulation of a scene that `within_reach` returned.

    `parameters` are the scene's, by name; `attributes` describe in recordings how the simulation was made.
    `rebuild` builds the scene with other parameters, if a function has built it. Functions in `after_frame` are
    called after each frame.
    """

    frame_count = None

    def __init__(
        self,
        scene: Scene,
        simulation: Simulation,
        title: str = "",
        *,
        parameters: Mapping[str, Any] | None = None,
        attributes: Mapping[str, Any] | None = None,
    ) -> None:
        self.scene, self.title, self.fps = scene, title, simulation.fps
        self.parameters, self.attributes = dict(parameters or {}), dict(attributes or {})
        self.handling = Handling(scene, simulation)
        self._simulation, self.device = simulation, simulation.device
        self.frame, self.reset = simulation.frame, self.handling.reset
        self.after_frame: list[Callable[[], None]] = []
        self.rebuild: Callable[..., Running] | None = None

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.time

    @property
    def index(self) -> int:
        """The index of the current frame."""
        return self._simulation.frame_index

    def seen(self) -> NDArray:
        """Return points to keep in view while the body's path is unknown; see `surroundings`."""
        return surroundings(self.scene, self.frame().position)

    def advance(self) -> bool:
        """Simulate one frame; raise SimulationDiverged if it diverges."""
        self._simulation.step()
        for call in self.after_frame:
            call()
        return True

    def broken_at(self) -> NDArray | None:
        """Return the times at which springs broke [s], shape [connection_count]; None if none can break."""
        if not self.scene.system.tears:  # avoids copying other changed fields
            return None
        return self._simulation.assembly.changed_fields().get("broken_at")

    def seek(self, k: int) -> None:
        """Do nothing, since a simulation has only the current frame."""

    def reading(self) -> Reading:
        """Return the energies and the largest strain."""
        found = self._simulation.measure()
        return Reading(
            self.time, found.kinetic_energy, found.elastic_energy, found.gravitational_energy, found.largest_strain
        )

    def summary(self) -> str:
        """Return substeps, precision, device and force algorithm as text."""
        choice, model = replace(self._simulation.choice, asked=str), self._simulation.model
        return f"{choice} · {model.precision} on {self._simulation.device}, {model.force_algorithm}"


class Played:
    """A trajectory that is replayed, with a scene of its system."""

    handling = rebuild = None
    parameters: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, trajectory: Trajectory, scene: Scene, title: str = "") -> None:
        if not len(trajectory):
            raise ValueError(f"{trajectory.path} has no frames to play")
        self.scene, self.title, self.fps = scene, title, trajectory.fps
        self._trajectory, self._k = trajectory, 0
        self.device = find_device(None).alias
        self.frame_count = len(trajectory)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._trajectory.times[self._k])

    @property
    def index(self) -> int:
        """The index of the current frame."""
        return self._k

    def seen(self) -> NDArray:
        """Return the outermost particles of all frames, or of a sample of frames [m], shape [any, d]."""
        last, count = self.frame_count - 1, min(self.frame_count, MOST_SEEN)
        chosen = np.unique(np.linspace(0, last, count).round().astype(int))
        positions, times = self._trajectory.positions, self._trajectory.times
        return framed(self.scene, positions, times, chosen.tolist(), ASPECT)[1]

    def advance(self) -> bool:
        """Show the next frame; return whether there was one."""
        before = self._k
        self.seek(before + 1)
        return self._k > before

    def frame(self) -> Frame:
        """Return the current frame."""
        return self._trajectory.frame(self._k)

    def broken_at(self) -> NDArray | None:
        """Return the times at which springs broke [s], shape [connection_count]; None if none can break."""
        return np.asarray(self._trajectory.broken_at) if self.scene.system.tears else None

    def reset(self) -> None:
        """Go back to the first frame."""
        self._k = 0

    def seek(self, k: int) -> None:
        """Go to frame k, or to the nearest existing frame."""
        self._k = min(max(int(k), 0), self.frame_count - 1)

    def reading(self) -> None:
        """Return None, since a trajectory has no energies."""

    def summary(self) -> str:
        """Return the index of the frame as text."""
        return f"frame {self._k} of {self.frame_count - 1}"


def surroundings(scene: Scene, position: NDArray) -> NDArray:
    """Return points to keep in view while the body's path is unknown [m], shape [any, d].

    The points are the body, and the body's projection onto the ground, 1.5 times as large; without ground, points
    below the body at BELOW times its length.
    """
    low, high = position.min(axis=0), position.max(axis=0)
    size = float((high - low).max())
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, len(low))
    if scene.ground is None:
        fallen = corners - BELOW * size * np.eye(len(low))[-1]
    else:
        normal = np.asarray(scene.ground.unit_normal(scene.system.dim), dtype=np.float64)
        height = corners @ normal - scene.ground.offset
        fallen = corners - np.maximum(height, 0.0)[:, None] * normal
        middle = fallen.mean(axis=0)
        fallen = middle + 1.5 * (fallen - middle)
    return np.concatenate([position, fallen])


Source = Running | Played
