"""Rates: how fast a system can oscillate and creep, bounded in one pass (see `integrators.stability`)."""

import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..bodies import LINEAR, System, is_uniform, stored
from ..kernels.reductions import largest_rate
from .linearised import write_diagonal_blocks
from .model import Model
from .state import State


class Rates(NamedTuple):
    """How fast a linear system M x'' = −K x − B x' can move; what stability limits depend on."""

    stiffness: float
    """Largest eigenvalue of M⁻¹K [1/s²]: a squared angular frequency."""
    damping: float
    """Largest eigenvalue of M⁻¹B [1/s]."""
    least_ratio: float
    """Least damping over stiffness of a spring [s]; inf where nothing is stiff."""

    @property
    def damping_ratio(self) -> float:
        """ζ of the fastest mode, where K and B share modes: 1 is critical."""
        return self.damping / (2 * math.sqrt(self.stiffness)) if self.stiffness else math.inf


def rate_bounds(system: System, model: Model | None = None, state: State | None = None) -> Rates:
    """Return upper bounds of a system's rates, as it stands or, on a device, in the given state.

    Parameters
    ----------
    system
        The system.
    model, state
        The system on a device; by default it is uploaded to the CPU in float64, as it stands.
    """
    if model is None:
        model = Model(system, device="cpu", precision="float64")
    state = State.of(system, model) if state is None else state
    bounds = _bounds(model, state)
    springs, dampers = system.stiffness, system.damping
    if is_uniform(springs) and is_uniform(dampers):
        springs, dampers = stored(springs), stored(dampers)
    stiff = springs > 0
    ratio = float(np.min(dampers[stiff] / springs[stiff])) if stiff.any() else math.inf
    if system.damper != LINEAR and math.isfinite(ratio):
        ratio = 0.0  # somewhere the slope of every other law is nothing, or almost
    return Rates(float(bounds[0]), float(bounds[1]), ratio)


def _bounds(model: Model, state: State) -> Any:
    Block: Any = wp.types.matrix((model.dim, model.dim), wp.float64)
    blocks = [wp.zeros(model.particle_count, dtype=Block, device=model.device) for _ in range(2)]
    write_diagonal_blocks(model, state.x, *blocks)
    for effect in model.effects:
        effect.add_blocks(state.x, *blocks)
    bounds = wp.zeros(2, dtype=wp.float64, device=model.device)
    wp.launch(
        largest_rate(model.dim, model.scalar),
        dim=model.particle_count,
        inputs=[model.inverse_mass, *blocks],
        outputs=[bounds],
        device=model.device,
    )
    return bounds.numpy()
