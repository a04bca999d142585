"""Bounds on a system's rates of oscillation and relaxation, in one pass (see `integrators.stability`)."""

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...bodies import LINEAR, System, is_uniform, stored
from ...runtime import in_turn
from ...world import Problem
from ..loads.forces import ForceField
from ..model.effect import Effect
from ..model.model import Model
from ..model.state import State
from ..springs.linearised import largest_rates, write_diagonal_blocks, zero_blocks
from ..stepping.assemble import Assembly, assemble

PARTS = {"NoneType": "springs", "AngleSprings": "angles", "CellVolumes": "cells"}
"""Words for parts of a scene; messages name others by their class."""
PLACES = 3
"""Places at which functions of one's own are looked at: the present, after half a frame, after a frame."""
OSCILLATION, RELAXATION = 0.08, 0.5
"""Longest substep under a function of one's own, times √|∂a/∂x| and times |∂a/∂v|: 79 to an oscillation.

A body may leave its fastest modes unresolved. Such a force is often all that is asked about: symplectic Euler's
energy is then right to 4 %, half of hω.
"""


class Rates(NamedTuple):
    """Rates of a linear system M x'' = −K x − B x', on which stability limits depend."""

    stiffness: float
    """Largest eigenvalue of M⁻¹K [1/s²]: a squared angular frequency."""
    damping: float
    """Largest eigenvalue of M⁻¹B [1/s]."""
    least_ratio: float
    """Smallest ratio of damping to stiffness of all springs [s]; inf if no spring has stiffness."""
    effect_stiffness: float = 0.0
    """Contribution of effects to `stiffness` [1/s²]; every method treats them explicitly."""
    effect_damping: float = 0.0
    """Contribution of effects to `damping` [1/s]."""
    own: float = 0.0
    """Substeps per second that resolve functions of one's own, and of time, whatever the method."""

    @classmethod
    def all_within(cls, several: Iterable["Rates"]) -> "Rates":
        """Return rates that bound those of all given worlds."""
        most = cls(*map(max, zip(*several, strict=True)))
        return most._replace(least_ratio=min(one.least_ratio for one in several))

    @property
    def damping_ratio(self) -> float:
        """Damping ratio ζ of the fastest mode, if K and B have the same modes: 1 is critical."""
        return self.damping / (2 * math.sqrt(self.stiffness)) if self.stiffness else math.inf


@in_turn
def rate_bounds(system: System, assembly: Assembly | None = None, state: State | None = None) -> Rates:
    """Return upper bounds of a system's rates, at the system's own state or at a given state on a device.

    The assembly is the system on a device with its effects. By default it is uploaded to the CPU in float64.
    """
    if assembly is None:
        assembly = assemble(Problem(system=system), device="cpu", precision="float64")
    state = State.from_system(system, assembly.model) if state is None else state
    return world_rates(assembly, state)[0]


@in_turn
def world_rates(assembly: Assembly, state: State) -> list[Rates]:
    """Return upper bounds of the rates of each world with different parameters."""
    model = assembly.model
    blocks = zero_blocks(model)
    write_diagonal_blocks(model, state.x, *blocks)
    bounds = _with_effects(assembly, state, blocks, assembly.all)
    own = own_rates(assembly, state)
    effects = np.zeros((model.different, 2))
    if acts_on_rates(assembly.all) and not model.in_worlds:
        effects = _with_effects(assembly, state, zero_blocks(model), assembly.all)
    return [
        Rates._make((*rates, _least_ratio(model, k), *effects[k], own[k]))
        for k, rates in enumerate(bounds.tolist())
    ]


def functions_of(assembly: Assembly) -> list[ForceField]:
    """Return the forces that are functions of one's own."""
    return [one for one in assembly.all if isinstance(one, ForceField)]


@in_turn
def own_rates(assembly: Assembly, state: State) -> list[float]:
    """Return `Rates.own` of each world with different parameters; what is not a number does not count."""
    functions, model = functions_of(assembly), assembly.model
    if not functions:
        return [0.0] * model.different
    blocks = zero_blocks(model)
    for one in functions:
        one.add_slopes(state.x, state.v, blocks[0], blocks[1], places=PLACES)
    found = largest_rates(model, *blocks)
    return np.fmax(np.fmax(np.sqrt(found[:, 0]) / OSCILLATION, found[:, 1] / RELAXATION), 0.0).tolist()


def _least_ratio(model: Model, world: int) -> float:
    """Return the smallest damping/stiffness ratio of unbroken springs [s]; inf if none has stiffness."""
    rows = [model.row_of(name) for name in ("stiffness", "damping")]
    springs, dampers = (values[world % len(values)] for values in rows)
    if is_uniform(springs) and is_uniform(dampers) and not model.system.tears:
        springs, dampers = stored(springs), stored(dampers)
    stiff = springs > 0
    if model.system.tears:
        stiff = stiff & ~model.system.broken
    if not stiff.any():
        return math.inf
    # Every nonlinear law has a slope of about 0 at some speed.
    return float(np.min(dampers[stiff] / springs[stiff])) if model.system.damper == LINEAR else 0.0


def resists(assembly: Assembly) -> bool:
    """Return whether rates depend on speeds of particles, because an effect resists motion."""
    return any(one.overrides("add_resistance") for one in assembly.all)


def acts_on_rates(effects: Sequence[Effect]) -> bool:
    """Return whether any effect contributes to the bounds."""
    return any(one.overrides("add_blocks", "add_resistance") for one in effects)


@in_turn
def rates_by_part(assembly: Assembly, state: State, world: int = 0) -> dict[str, Rates]:
    """Return the rates in a world if only the stiffness, or the damping, of springs or of one effect acted.

    Keys are words for the part, with the group of the particle at which the rate is largest.
    """
    model, found = assembly.model, dict[str, Rates]()
    mass = model.row_of("mass")[world % len(model.row_of("mass"))]
    for effect in (None, *assembly.all):
        blocks, kind = zero_blocks(model), type(effect).__name__
        if effect is None:
            write_diagonal_blocks(model, state.x, *blocks)
        rates = _with_effects(assembly, state, blocks, [effect] if effect else [])[world]
        word = PARTS.get(kind, re.sub("(?<=.)(?=[A-Z])", " ", kind).lower())
        for k, what in enumerate(("", "damping of the ")):
            if rates[k] > 0.0:
                first = np.argmax(np.trace(blocks[k].numpy()[world], axis1=1, axis2=2) / mass)
                of = next((f" of {name!r}" for name, some in model.system.groups.items() if first in some), "")
                both = np.where(np.arange(2) == k, rates, 0.0).tolist()
                ratio = math.inf if effect or k else _least_ratio(model, world)
                own = own_rates(assembly, state)[world] if isinstance(effect, ForceField) else 0.0
                found[what + word + of] = Rates(both[0], both[1], ratio, *(both if effect else ()), own=own)
    return found


def effect_stiffness(assembly: Assembly, state: State) -> NDArray[np.float64]:
    """Return the stiffness of effects for motion of single particles, summed [N/m], shape [different]."""
    blocks = zero_blocks(assembly.model)
    if acts_on_rates(assembly.all):
        _with_effects(assembly, state, blocks, assembly.all)
    return 0.5 * np.trace(blocks[0].numpy(), axis1=2, axis2=3).sum(axis=1)


def _with_effects(assembly: Assembly, state: State, blocks: Any, effects: Any) -> NDArray[np.float64]:
    """Add effects' parts to `blocks`; return bounds of eigenvalues of M⁻¹K and M⁻¹B, shape [different, 2]."""
    model, contact = assembly.model, assembly.body_contact if assembly.model.in_worlds else None
    others = [one for one in effects if one is not contact]
    for world in range(model.different if acts_on_rates(others) else 0):
        here = slice(world * model.stride, world * model.stride + model.particle_count)
        parts: Any = (state.x[here], state.v[here], *(one[world] for one in blocks))
        x, v, stiffness, damping = parts
        resistance = np.zeros(model.particle_count)
        for effect in others:
            effect.add_blocks(x, v, stiffness, damping, world)
            effect.add_resistance(x, v, resistance)
        if resistance.any():
            damping.assign(damping.numpy() + resistance[:, None, None] * np.eye(model.dim))
    if contact is not None and contact in effects:  # adds to all worlds in one call
        contact.add_blocks_of_worlds(blocks[0])
    return largest_rates(model, *blocks)
