"""Fire: moves a body to a minimum of its energy, by changing velocities after each substep."""

from typing import Any

import numpy as np
import warp as wp

from ...kernels.integrators import fire
from ..model.effect import Effect
from ..model.model import Model
from ..model.state import Instant


class Fire(Effect):
    """Changes velocities after each substep; the method is in `msdwarp.kernels.integrators.fire`."""

    term = None

    def __init__(self, model: Model) -> None:
        self._model, device = model, model.device
        threads = fire.THREADS if device.is_cuda else 1
        self._sums = wp.zeros((fire.ROWS, threads), dtype=wp.float64, device=device)
        self._decision = wp.zeros(fire.COLUMNS, dtype=wp.float64, device=device)
        start = np.zeros(fire.COLUMNS)
        start[fire.MIXING] = fire.MIXING_AT_START
        self._decision.assign(start)
        model.kernels.note(*(of(model.dim, model.scalar) for of in (fire.fire_sums, fire.fire_mixing)))
        model.kernels.note(fire.fire_decision, block=threads)

    @property
    def largest_force(self) -> float:
        """The largest force on a free particle at the start of the last substep [N]."""
        return float(self._decision.numpy()[fire.LARGEST_FORCE])

    @property
    def strongest_force(self) -> float:
        """The largest force on a free particle so far [N]."""
        return float(self._decision.numpy()[fire.STRONGEST])

    @property
    def changing(self) -> list[wp.array]:
        """The arrays that substeps change: the parameters that the method adapts."""
        return [self._decision]

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch nothing; but since this method is overridden, each stage is a separate launch."""

    def end_substep(self, before: Instant, after: Instant, substep: int) -> None:
        """Launch the sums, the decision and the change of velocities: the first thread does all."""
        self.launcher.launch_parts(lambda part, _: self._launch(before, after) if part == 0 else None)

    def _launch(self, before: Instant, after: Instant) -> None:
        model, device, dt = self._model, self._model.device, self.steps.dt
        kinds, threads = (model.dim, model.scalar), self._sums.shape[1]
        inputs = [model.inverse_mass, before.v, after.v, dt]
        wp.launch(fire.fire_sums(*kinds), threads, inputs, [self._sums], device=device)
        inputs = [self._sums, dt]
        wp.launch(fire.fire_decision, threads, inputs, [self._decision], device=device, block_dim=threads)
        inputs = [model.inverse_mass, before.v, dt, self._decision]
        wp.launch(fire.fire_mixing(*kinds), model.particle_count, inputs, [after.x, after.v], device=device)
