"""Predictions of a fit: simulated measurements for given values of the parameters."""

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..integrators import StepChoice, UnstableStep
from ..simulation import Ensemble, Simulation, SimulationDiverged, observations
from ..world import Probe, Scene
from .measured import ON_FRAME, Channel
from .parameters import OF_CELLS, Parameter, scene_with

MOST_CORNERS = 6
"""With more parameters than this one corner of the bounds, instead of all 2^n, determines the substeps."""


class Worlds:
    """Simulates a scene for many sets of parameter values, in an `Ensemble` if it can, and reads channels.

    With "auto" all runs use the substeps of the stiffest world within the bounds: measurements would jump if
    substeps changed with the values. `options` are further arguments of both `Ensemble` and `Simulation`.
    """

    def __init__(
        self,
        scene: Scene,
        parameters: Sequence[Parameter],
        channels: Sequence[Channel],
        fps: float,
        substeps: int | str,
        options: dict[str, Any],
    ) -> None:
        self._scene, self.parameters, self.channels, self.fps = scene, parameters, channels, fps
        self._options: dict[str, Any] = options | {"fps": fps, "substeps": substeps}
        self.start: StepChoice
        """The substeps that the starting values need alone, with the scene's rates there."""
        self.alone = ""
        """Why worlds are simulated one by one; empty if an ensemble simulates them."""
        self.runs = 0
        """Number of worlds simulated so far."""
        self.batches = 0
        """Number of runs of several worlds at once."""
        self.diverged = False
        """Whether the first world of the last batch has diverged."""
        if len(parameters) > MOST_CORNERS:
            corners = np.array([[one.low if one.name == "mass" else one.high for one in parameters]])
        else:
            corners = np.array(list(itertools.product(*((one.low, one.high) for one in parameters))))
        corners = np.vstack([corners, [one.start for one in parameters]])
        try:
            ensemble = self._ensemble(corners)
            self._observations(ensemble)
            self.substeps, self.on_gpu = ensemble.substeps, ensemble.model.device.is_cuda
            self.start = ensemble.stepping.choices[-1]
        except UnstableStep as error:
            raise UnstableStep(f"at a corner of the bounds, {error}") from error
        except ValueError as error:  # unsupported by ensembles, or invalid, in which case simulations fail too
            several = [self._simulation(one) for one in corners]
            self.alone, self.on_gpu = str(error), several[0].model.device.is_cuda
            self.substeps, self.start = max(one.substeps for one in several), several[-1].choice
        self.refine(1.0)

    def refine(self, times: float) -> None:
        """Multiply the number of substeps of later runs by `times`."""
        self.substeps = math.ceil(times * self.substeps)
        self._options["substeps"] = self.substeps

    def scene(self, values: NDArray[np.float64]) -> Scene:
        """Return the scene with these values of the fitted parameters."""
        return scene_with(self._scene, self.parameters, values)

    def predict(self, values: NDArray[np.float64], end: float) -> list[NDArray[np.float64]]:
        """Return simulated values of each channel until `end` [s], each of shape [worlds, rows, width].

        A world that diverges keeps the values of its last good frame.
        """
        frames = max(1, math.ceil(end * self.fps - ON_FRAME))
        simulated = self._one_by_one(values, frames) if self.alone else self._together(values, frames)
        self.runs += len(values)
        self.batches += 1
        return [one.at_times(own, self.fps) for one, own in zip(self.channels, simulated, strict=True)]

    def _ensemble(self, values: NDArray[np.float64]) -> Ensemble:
        """Return an ensemble with a world for each row of values; raise ValueError if it cannot do that."""
        scaled = [one.name for one in self.parameters if one.name in OF_CELLS]
        if scaled and self._scene.system.cells is not None:
            raise ValueError(
                f"{scaled[0]} scales cells as well as springs; worlds of an ensemble share their cells"
            )
        rows: dict[str, Any] = {one.name: one.rows(values[:, k]) for k, one in enumerate(self.parameters)}
        return Ensemble(self._scene, len(values), **rows, **self._options)

    def _simulation(self, values: NDArray[np.float64]) -> Simulation:
        return Simulation.from_scene(self.scene(values), **self._options)

    def _observations(self, ensemble: Ensemble) -> list[Any]:
        """Return an observation for each channel; raise ValueError if an ensemble does not support one."""
        return observations(ensemble, {one.name: _observed(one) for one in self.channels})

    def _together(self, values: NDArray[np.float64], frames: int) -> list[NDArray[np.float64]]:
        """Return each channel in each frame from an ensemble, shape [frame_count, worlds, ...]."""
        ensemble = self._ensemble(values)
        observed = self._observations(ensemble)
        for frame in range(frames + 1):
            if frame:
                ensemble.step()
            for one in observed:
                one.look()
        self.diverged = bool(ensemble.status[0] != "running")
        return [np.stack(one.values) for one in observed]

    def _one_by_one(self, values: NDArray[np.float64], frames: int) -> list[NDArray[np.float64]]:
        """Return each channel in each frame from successive simulations, shape [frame_count, worlds, ...]."""
        runs = [self._run(one, frames) for one in values]
        self.diverged = len(runs[0]) <= frames
        whole = [run + run[-1:] * (frames + 1 - len(run)) for run in runs]
        channels = range(len(self.channels))
        return [np.stack([[frame[k] for frame in run] for run in whole], axis=1) for k in channels]

    def _run(self, values: NDArray[np.float64], frames: int) -> list[list[NDArray[np.float64]]]:
        """Return the channels in each frame of one simulation, until the last good frame."""
        simulation = self._simulation(values)
        found = [[_value(simulation, channel) for channel in self.channels]]
        with suppress(SimulationDiverged):
            for _ in range(frames):
                simulation.step()
                found.append([_value(simulation, channel) for channel in self.channels])
        return found


def _observed(channel: Channel) -> Any:
    """Return the quantity that a channel observes in an ensemble, see `Ensemble.run`."""
    if isinstance(channel.what, np.ndarray):
        return lambda position, velocity: position[:, channel.what].astype(float)
    return channel.what


def _value(simulation: Simulation, channel: Channel) -> NDArray[np.float64]:
    if isinstance(channel.what, np.ndarray):
        return np.asarray(simulation.frame().position[channel.what], dtype=float)
    if isinstance(channel.what, Probe):
        values = simulation.readings[channel.name].values
        # A probe has no value before the first frame, but no measurement is compared with this 0.
        return values[-1] if len(values) else np.zeros(values.shape[1])
    return np.array(getattr(simulation.measure(), channel.what.replace(" ", "_")))
