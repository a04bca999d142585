"""Rates: how fast a system can oscillate and creep, bounded in one pass (see `integrators.stability`)."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...bodies import LINEAR, System, is_uniform, stored
from ...kernels.reductions import largest_rate
from ...runtime import in_turn
from ..model.effect import Effect
from ..model.model import Model
from ..model.state import State
from ..springs.linearised import write_diagonal_blocks
from ..stepping.assemble import Assembly, assemble


class Rates(NamedTuple):
    """How fast a linear system M x'' = −K x − B x' can move; what stability limits depend on."""

    stiffness: float
    """Largest eigenvalue of M⁻¹K [1/s²]: a squared angular frequency."""
    damping: float
    """Largest eigenvalue of M⁻¹B [1/s]."""
    least_ratio: float
    """Least damping over stiffness of a spring [s]; inf where nothing is stiff."""
    effect_stiffness: float = 0.0
    """The part of `stiffness` that effects add, which act explicitly in every method [1/s²]."""
    effect_damping: float = 0.0
    """The same of `damping` [1/s]."""

    @property
    def damping_ratio(self) -> float:
        """ζ of the fastest mode, where K and B share modes: 1 is critical."""
        return self.damping / (2 * math.sqrt(self.stiffness)) if self.stiffness else math.inf


@in_turn
def rate_bounds(system: System, assembly: Assembly | None = None, state: State | None = None) -> Rates:
    """Return upper bounds of a system's rates, as it stands or, on a device, in the given state.

    Parameters
    ----------
    system
        The system.
    assembly, state
        The system on a device, with what acts on it; by default it is uploaded to the CPU in float64.
    """
    if assembly is None:
        assembly = assemble(system, device="cpu", precision="float64")
    state = State.from_system(system, assembly.model) if state is None else state
    bounds = _bounds(assembly, state)
    springs, dampers = system.stiffness, system.damping
    if is_uniform(springs) and is_uniform(dampers):
        springs, dampers = stored(springs), stored(dampers)
    stiff = springs > 0
    if system.tears:  # what is broken is none
        stiff = stiff & ~system.broken
        springs, dampers = np.broadcast_to(springs, stiff.shape), np.broadcast_to(dampers, stiff.shape)
    ratio = float(np.min(dampers[stiff] / springs[stiff])) if stiff.any() else math.inf
    if system.damper != LINEAR and math.isfinite(ratio):
        ratio = 0.0  # somewhere the slope of every other law is nothing, or almost
    return Rates(bounds[0], bounds[1], ratio, *_effect_bounds(assembly, state))


def resists(assembly: Assembly) -> bool:
    """Return whether rates depend on how fast particles move: whether any effect resists their motion."""
    return any(type(one).add_resistance is not Effect.add_resistance for one in assembly.all)


def _blocks(model: Model) -> list[wp.array]:
    """Return zeros for the diagonal blocks of K and B, float64 matrices of shape [particle_count]."""
    Block: Any = wp.types.matrix((model.dim, model.dim), wp.float64)
    return [wp.zeros(model.particle_count, dtype=Block, device=model.device) for _ in range(2)]


def _bounds(assembly: Assembly, state: State) -> tuple[float, float]:
    """Return bounds of the largest eigenvalues of M⁻¹K and M⁻¹B, with what effects add."""
    model = assembly.model
    blocks = _blocks(model)
    write_diagonal_blocks(model, state.x, *blocks)
    add_effects(model, assembly.all, state.x, state.v, blocks)
    return _largest(model, blocks)


def add_effects(
    model: Model, effects: Sequence[Effect], x: wp.array, v: wp.array, blocks: list[wp.array], world: int = 0
) -> None:
    """Add what effects hold particles of a world with, and how they resist their motion."""
    for effect in effects:
        effect.add_blocks(x, blocks[0], blocks[1], world)
    resisting = [one for one in effects if type(one).add_resistance is not Effect.add_resistance]
    if resisting:
        total = np.zeros(model.particle_count)
        for effect in resisting:
            effect.add_resistance(x, v, total)
        blocks[1].assign(blocks[1].numpy() + total[:, None, None] * np.eye(model.dim))


def acts_on_rates(effects: Sequence[Effect]) -> bool:
    """Tell whether any effect adds to the bounds."""
    overridden = ("add_blocks", "add_resistance")
    return any(getattr(type(one), name) is not getattr(Effect, name) for one in effects for name in overridden)


def _effect_bounds(assembly: Assembly, state: State) -> tuple[float, float]:
    """Return the same of what effects add alone."""
    if not acts_on_rates(assembly.all):
        return 0.0, 0.0
    blocks = _blocks(assembly.model)
    add_effects(assembly.model, assembly.all, state.x, state.v, blocks)
    return _largest(assembly.model, blocks)


def _largest(model: Model, blocks: list[wp.array]) -> tuple[float, float]:
    """Return twice the largest eigenvalue of a block over its particle's mass, for both kinds of blocks."""
    bounds = wp.zeros(2, dtype=wp.float64, device=model.device)
    wp.launch(
        largest_rate(model.dim, model.scalar),
        dim=model.particle_count,
        inputs=[model.inverse_mass, *blocks],
        outputs=[bounds],
        device=model.device,
    )
    stiffness, damping = map(float, bounds.numpy())
    return stiffness, damping
