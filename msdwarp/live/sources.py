"""Sources: what a view shows, a simulation as it runs or a trajectory as it is played."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import Frame
from ..files import Trajectory
from ..pictures import outermost
from ..simulation import Simulation
from ..world import Scene
from .handling import Handling

MOST_SEEN = 200
"""The most frames of a trajectory that are read to find out where the camera must be."""
ASPECT = 16 / 9
"""Width over height of the picture that it is found for; others see nearly the same."""


class Reading(NamedTuple):
    """Energies and the largest strain at a time."""

    time: float
    """[s]"""
    kinetic: float
    """[J]"""
    elastic: float
    """[J]"""
    potential: float
    """[J]"""
    strain: float
    """Largest |l / l0 − 1|."""


class Source(Protocol):
    """What a view shows."""

    scene: Scene
    """What is drawn."""
    title: str
    """What it is called."""
    fps: float
    """Frames per second of simulated time."""
    device: str
    """Where its frames are drawn if they are drawn as images: cpu, cuda:0 ..."""

    @property
    def handling(self) -> Handling | None:
        """What is done by hand; None where nothing can be."""
        ...

    @property
    def parameters(self) -> Mapping[str, Any]:
        """What the scene was built with, by name."""
        ...

    @property
    def frame_count(self) -> int | None:
        """How many frames there are; None where it goes on."""
        ...

    @property
    def index(self) -> int:
        """The number of the present frame."""
        ...

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        ...

    def seen(self) -> NDArray | None:
        """Return what the camera must have in view [m], shape [any, d]; None where nobody knows where it goes."""
        ...

    def advance(self) -> bool:
        """Go on by a frame; return whether there was one."""
        ...

    def frame(self) -> Frame:
        """Return the present frame."""
        ...

    def broken_at(self) -> NDArray | None:
        """Return when connections broke [s], shape [connection_count]; None where none can."""
        ...

    def reset(self) -> None:
        """Go back to the start."""
        ...

    def seek(self, k: int) -> None:
        """Go to frame k."""
        ...

    def reading(self) -> Reading | None:
        """Return the energies; None where they are not known."""
        ...

    def says(self) -> str:
        """Say how it is simulated, in a few words."""
        ...


class Running:
    """A simulation as it runs.

    Parameters
    ----------
    scene
        What is simulated: one that `within_reach` returned.
    simulation
        Its simulation.
    title
        What it is called.
    parameters
        What the scene was built with, by name: numbers of these can be changed.
    attributes
        What made the simulation, for files that its frames are kept in.
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
        self.behind: list[Callable[[], None]] = []
        """What is called behind each frame."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.time

    @property
    def index(self) -> int:
        """The number of the present frame."""
        return self._simulation.frame_index

    def seen(self) -> None:
        """Return nothing: where it goes is not known."""
        return None

    def advance(self) -> bool:
        """Go on by a frame; raise SimulationDiverged if that cannot be."""
        self._simulation.step()
        for call in self.behind:
            call()
        return True

    def frame(self) -> Frame:
        """Return the present frame."""
        return self._simulation.frame()

    def broken_at(self) -> NDArray | None:
        """Return when connections broke [s], shape [connection_count]; None where none can."""
        if not self.scene.system.tears:  # other fields that the run changes would be copied in vain
            return None
        return self._simulation.stepping.changed_fields().get("broken_at")

    def reset(self) -> None:
        """Go back to the start."""
        self.handling.reset()

    def seek(self, k: int) -> None:
        """Do nothing: a simulation has no frames but the present one."""

    def reading(self) -> Reading:
        """Return the energies, and the largest strain."""
        found = self._simulation.measure()
        return Reading(
            self.time, found.kinetic_energy, found.elastic_energy, found.gravitational_energy, found.largest_strain
        )

    def says(self) -> str:
        """Say how it is simulated, in a few words."""
        choice, model = self._simulation.choice, self._simulation.model
        return f"{choice} · {model.precision} on {self._simulation.device}, {model.force_algorithm}"


class Played:
    """A trajectory as it is played.

    Parameters
    ----------
    trajectory
        Its frames.
    scene
        What is drawn, with the trajectory's system.
    title
        What it is called.
    """

    handling = None
    parameters: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, trajectory: Trajectory, scene: Scene, title: str = "") -> None:
        if not len(trajectory):
            raise ValueError(f"{trajectory.path} has no frames to play")
        self.scene, self.title, self.fps = scene, title, trajectory.fps
        self._trajectory, self._k = trajectory, 0
        self.device: str = wp.get_preferred_device().alias
        self.frame_count = len(trajectory)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._trajectory.times[self._k])

    @property
    def index(self) -> int:
        """The number of the present frame."""
        return self._k

    def seen(self) -> NDArray:
        """Return the outermost particles of the frames [m], shape [any, d]; of many frames those of some."""
        chosen = np.unique(
            np.linspace(0, self.frame_count - 1, min(self.frame_count, MOST_SEEN)).round().astype(int)
        )
        positions, look = self._trajectory.positions, self.scene.look
        return np.concatenate([outermost(positions[k], look, ASPECT) for k in chosen])

    def advance(self) -> bool:
        """Go on by a frame; return whether there was one."""
        if self._k + 1 >= self.frame_count:
            return False
        self._k += 1
        return True

    def frame(self) -> Frame:
        """Return the present frame."""
        return self._trajectory.frame(self._k)

    def broken_at(self) -> NDArray | None:
        """Return when connections broke [s], shape [connection_count]; None where none can."""
        return np.asarray(self._trajectory.broken_at) if self.scene.system.tears else None

    def reset(self) -> None:
        """Go back to the first frame."""
        self._k = 0

    def seek(self, k: int) -> None:
        """Go to frame k, the nearest that there is."""
        self._k = min(max(int(k), 0), self.frame_count - 1)

    def reading(self) -> None:
        """Return nothing: a trajectory does not keep energies."""
        return None

    def says(self) -> str:
        """Say which frame it is."""
        return f"frame {self._k} of {self.frame_count - 1}"
