"""What is doubtful about how a system starts: deep in an obstacle, or where float32 cannot tell places apart."""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System, stored
from ..world import Collider
from .contact import LED_OUT_IN
from .depths import start_depths, touching
from .driving import Driving
from .model import Model
from .state import State
from .touching import Touching

COARSE = 1e-3
"""Distance of two neighbouring numbers over the shortest rest length from which on strains are rounded visibly."""


def starting_state(system: System, model: Model, carried: int, time: float, fps: float) -> State:
    """Return the state of a system at `time` [s], what is driven where its drive has it then.

    Parameters
    ----------
    system, model
        The system, and the same on its device.
    carried
        See `State`.
    time, fps
        When it starts [s], and frames per second.
    """
    state = State.of(system, model, carried)
    for effect in model.effects:
        effect.place(state, time, fps)
    return state


def doubt_start(model: Model, colliders: Sequence[Collider]) -> str | None:
    """Warn about what is doubtful about a start, as from two calls up; return words about what starts inside."""
    inside = start_inside(model.system, colliders, model.driven)
    displaced = [effect.displaced() for effect in model.effects if isinstance(effect, Driving)]
    overlapping = [effect.overlapping() for effect in model.effects if isinstance(effect, Touching)]
    for doubt in (inside, start_far(model), *displaced, *overlapping):
        if doubt:
            warnings.warn(doubt, checks.DoubtfulStart, stacklevel=3)
    return inside


def start_inside(
    system: System, colliders: Sequence[Collider], driven: NDArray[np.bool_] | None = None
) -> str | None:
    """Return words about the particle that starts deepest in an obstacle; None if none does but by touching it.

    Pinned particles may lie anywhere: they stay there, as do driven ones where they are put.
    """
    free = ~system.pinned if driven is None else ~(system.pinned | driven)
    if not colliders or not free.any():
        return None
    depths = start_depths(system.position[free], colliders)
    k = int(np.argmax(depths.max(axis=1)))
    allowed = touching(system)
    if depths[k].max() <= allowed:
        return None
    deepest = int(np.argmax(depths[k]))
    particle = int(np.flatnonzero(free)[deepest])
    count = int((depths.max(axis=0) > allowed).sum())
    others = f" (of {count} that start inside obstacles it is the deepest)" if count > 1 else ""
    tears = ", which may tear at its connections" if system.connection_count else ""
    return (
        f"particle {particle} starts {depths[k][deepest]:.3g} m inside colliders[{k}], a "
        f"{type(colliders[k]).__name__}{others}: unless it moves outwards by itself it is led out the nearest way "
        f"within {LED_OUT_IN} s{tears}; move the body or the obstacle apart, or pin what is meant to be inside"
    )


def start_far(model: Model) -> str | None:
    """Return words about a system so far from the origin that float32 rounds its strains; None where it is not."""
    system = model.system
    if model.precision != "float32" or not system.connection_count:
        return None  # compensated sums keep what rounding takes away
    most = float(max(system.position.max(), -system.position.min()))
    apart, shortest = float(np.spacing(np.float32(most))), float(stored(system.rest_length).min())
    if apart <= COARSE * shortest:
        return None
    return (
        f"the system reaches to {most:.3g} m from the origin, where numbers of float32 are {apart:.2g} m apart "
        f"and strains of its shortest connection, of {shortest:.3g} m, are rounded by {apart / shortest:.2g}: "
        "move it near the origin, or use precision='float64'"
    )
