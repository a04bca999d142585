"""Worlds of a fit: what would have been measured, had parameters other values."""

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..integrators import UnstableStep
from ..simulation import Ensemble, Simulation, SimulationDiverged, observations
from ..world import Probe, Scene
from .measured import ON_FRAME, Channel
from .parameters import Parameter, scene_with

MOST_CORNERS = 6
"""Of more parameters than this not all corners of the bounds are looked at for the substeps: 2^6 worlds."""


class Worlds:
    """Simulates a scene with values of its parameters, many at once where an `Ensemble` can.

    Parameters
    ----------
    scene
        The scene.
    parameters
        What differs between worlds.
    channels
        What is read off them.
    fps
        Frames a second.
    substeps
        Of every run, or "auto" for those of the stiffest world within the bounds: were they to change with the
        values, what is measured would jump.
    options
        Other arguments that `Ensemble` and `Simulation` share.
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
        self._scene, self._parameters, self._channels, self.fps = scene, parameters, channels, fps
        self._options: dict[str, Any] = options | {"fps": fps}
        self.alone = ""
        """Why worlds are simulated one after the other; empty where they are not."""
        self.runs = 0
        """Worlds simulated so far."""
        self.batches = 0
        """Times that worlds were simulated together."""
        self.diverged = False
        """Whether the first world of the last batch has diverged."""
        self._options["substeps"] = substeps
        corners = self._corners()
        try:
            ensemble = self._ensemble(corners)
            self._readers(ensemble)
            self.substeps, self.on_gpu = ensemble.substeps, ensemble.model.device.is_cuda
        except UnstableStep as error:
            raise UnstableStep(f"at a corner of the bounds, {error}") from error
        except ValueError as error:
            # Not every scene can be an ensemble. What is wrong with the scene itself a simulation says too.
            several = [self._simulation(one) for one in corners]
            self.alone, self.on_gpu = str(error), several[0].model.device.is_cuda
            self.substeps = max(one.substeps for one in several)
        self.refine(1.0)

    def refine(self, times: float) -> None:
        """Take so many times as many substeps from now on."""
        self.substeps = math.ceil(times * self.substeps)
        self._options["substeps"] = self.substeps

    def _corners(self) -> NDArray[np.float64]:
        """Return the corners of the bounds, shape [corners, parameters]."""
        ends = [(one.low, one.high) for one in self._parameters]
        if len(ends) > MOST_CORNERS:
            highest = [one.low if one.name == "mass" else one.high for one in self._parameters]
            return np.array([highest])
        return np.array(list(itertools.product(*ends)))

    def predict(self, values: NDArray[np.float64], end: float) -> list[NDArray[np.float64]]:
        """Return what each channel would have been up to a time [s], each of shape [worlds, rows, width].

        A world that diverges stays as its last good frame was.
        """
        frames = max(1, math.ceil(end * self.fps - ON_FRAME))
        told = self._one_by_one(values, frames) if self.alone else self._together(values, frames)
        self.runs += len(values)
        self.batches += 1
        return [one.at_times(own, self.fps) for one, own in zip(self._channels, told, strict=True)]

    def _ensemble(self, values: NDArray[np.float64]) -> Ensemble:
        rows: dict[str, Any] = {one.name: one.rows(values[:, k]) for k, one in enumerate(self._parameters)}
        return Ensemble(self._scene, len(values), **rows, **self._options)

    def _simulation(self, values: NDArray[np.float64]) -> Simulation:
        return Simulation.from_scene(scene_with(self._scene, self._parameters, values), **self._options)

    def _readers(self, ensemble: Ensemble) -> list[Callable[[], NDArray[np.float64]]]:
        """Return what reads each channel off an ensemble as it is; raise ValueError if that cannot be."""
        others = {one.name: one.what for one in self._channels if not isinstance(one.what, np.ndarray)}
        seen = {one.name: one for one in observations(ensemble, others)}
        model, state = ensemble.model, ensemble.state

        def positions(numbers: NDArray[np.int64]) -> NDArray[np.float64]:
            """Return positions alone: velocities, which a whole frame has too, would be computed for nothing."""
            found = model.by_world(state.x)[:, numbers].astype(float)
            return found - model.by_world(state.compensation.x)[:, numbers] if model.compensated else found

        def looked(name: str) -> NDArray[np.float64]:
            seen[name].look()
            return seen[name].values[-1]

        return [
            partial(looked, one.name) if one.name in seen else partial(positions, np.asarray(one.what))
            for one in self._channels
        ]

    def _together(self, values: NDArray[np.float64], frames: int) -> list[NDArray[np.float64]]:
        """Return what an ensemble tells in each frame, by channel: shape [frame_count, worlds, ...]."""
        ensemble = self._ensemble(values)
        readers, told = self._readers(ensemble), list[list[NDArray[np.float64]]]()
        for frame in range(frames + 1):
            if frame:
                ensemble.step()
            told.append([read() for read in readers])
        self.diverged = bool(ensemble.status[0] != "running")
        return [np.stack([frame[k] for frame in told]) for k in range(len(readers))]

    def _one_by_one(self, values: NDArray[np.float64], frames: int) -> list[NDArray[np.float64]]:
        """Return the same of simulations, one after the other."""
        runs, good = [], []
        for one in values:
            simulation = self._simulation(one)
            told = [[_told(simulation, channel) for channel in self._channels]]
            try:
                for _ in range(frames):
                    simulation.step()
                    told.append([_told(simulation, channel) for channel in self._channels])
                good.append(True)
            except SimulationDiverged:
                told += [told[-1]] * (frames + 1 - len(told))
                good.append(False)
            runs.append(told)
        self.diverged = not good[0]
        return [
            np.stack([[frame[k] for frame in told] for told in runs], axis=1) for k in range(len(self._channels))
        ]

    def scene(self, values: NDArray[np.float64]) -> Scene:
        """Return the scene with these values."""
        return scene_with(self._scene, self._parameters, values)


def _told(simulation: Simulation, channel: Channel) -> NDArray[np.float64]:
    """Return what a channel tells of the present frame."""
    if isinstance(channel.what, np.ndarray):
        return np.asarray(simulation.frame().position[channel.what], dtype=float)
    if isinstance(channel.what, Probe):
        values = simulation.readings[channel.name].values
        # Before the first frame a probe has told nothing, and nothing measured is compared with it.
        return values[-1] if len(values) else np.zeros(values.shape[1])
    measures = simulation.measure()
    return np.array(getattr(measures, channel.what.replace(" ", "_")))
