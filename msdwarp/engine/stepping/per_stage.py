"""PerStage: launches one stage at a time, with a thread for each particle or column of particles."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from ...kernels.integrators.composition import Composition
from ...kernels.integrators.stages import each_column, each_connection, each_masked, each_particle
from ...kernels.springs.stencil import COLUMN
from ..model.model import Model

LEAST_IN_COLUMNS = 100_000
"""With fewer particles there are too few columns to keep a GPU busy."""


class PerStage:
    """Launches one stage at a time.

    If effects act on few particles, a second launch (`each_masked`) advances these. Launches before forces then
    run on a side stream, in parallel with the first launch.
    """

    def __init__(self, model: Model, composition: Composition, launches_before_forces: bool) -> None:
        self._model, self._composition, self._note = model, composition, model.kernels.note
        self._columns = column_count(model, composition.force_algorithm)
        parallel = launches_before_forces and composition.second_pass
        self._side = wp.Stream(model.device, priority=-1) if parallel else None

    @contextmanager
    def side_stream(self) -> Iterator[None]:
        """Let launches run in parallel with later ones, up to `each_masked`, if the composition allows it."""
        if self._side is None:
            yield
            return
        self._side.wait_event(wp.get_stream(self._model.device).record_event())
        with wp.ScopedStream(self._side, sync_enter=False):
            yield

    def note(self, method: Any) -> None:
        """Note the kernels that `launch` launches for a method."""
        composition, forced = self._composition, method(self._composition).forced
        algorithm = composition.force_algorithm
        if forced and algorithm.evaluate is not None and self._model.connection_count:
            self._note(each_connection(composition, *([method] if self._model.in_worlds else [])), block=1024)
        each = each_column if forced and self._columns else each_particle
        self._note(each(composition, method), block=algorithm.block)
        if forced and composition.second_pass:
            self._note(each_masked(composition, method))

    def launch(self, scene: Any, method: Any, step: Any) -> None:
        """Launch a stage with a thread for each connection, and one for each particle or column of particles."""
        model, composition, forced = self._model, self._composition, method(self._composition).forced
        algorithm = composition.force_algorithm
        if forced and algorithm.evaluate is not None and model.connection_count:
            threads = of_each_world(model, model.connection_count)
            if model.in_worlds:
                inputs, kernel = [scene, step], each_connection(composition, method)
            else:
                inputs = [scene.forces, step.compensation, step.x, step.v]
                kernel = each_connection(composition)
            wp.launch(kernel, threads, inputs, device=model.device, block_dim=1024)
        if forced and self._columns:
            kernel, threads = each_column(composition, method), self._columns
        else:
            kernel = each_particle(composition, method)
            threads = of_each_world(model, model.particle_count * algorithm.lanes)
        wp.launch(kernel, threads, [scene, step], device=model.device, block_dim=algorithm.block)
        if forced and composition.second_pass:
            if self._side is not None:
                wp.get_stream(model.device).wait_event(self._side.record_event())
            kernel, threads = each_masked(composition, method), len(scene.masked_particles)
            wp.launch(kernel, threads, [scene, step], device=model.device)


def column_count(model: Model, algorithm: Any) -> int:
    """Return the number of particle columns that an algorithm advances; 0 if it advances single particles."""
    return columns(model) if algorithm.column_forces and not model.in_worlds else 0


def columns(model: Model) -> int:
    """Return the number of columns in a lattice; 0 if it has too few particles or no evenly spaced layers."""
    stride = model.lattice.stride if model.lattice else 0
    if stride <= 0 or not model.device.is_cuda or model.particle_count < LEAST_IN_COLUMNS:
        return 0
    return -(-model.particle_count // (COLUMN * stride)) * stride


def of_each_world(model: Model, count: int) -> int | tuple[int, int]:
    """Return the dimensions of a launch with `count` threads for each world."""
    return (model.worlds, count) if model.in_worlds else count
