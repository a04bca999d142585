"""Checks of the start: depth in obstacles, and distances that float32 cannot resolve."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...bodies import System, pieces, stored
from ...world import Collider
from ..collision.colliders import DEPENETRATION_TIME
from ..collision.penetration_depth import start_depths, touching, ways_out
from ..loads.forces import ForceField
from ..model.effect import Steps
from ..model.model import Model
from ..model.stage_tables import StageTables
from ..model.state import State
from .assemble import Assembly

COARSE = 1e-3
"""Spacing of float32 numbers over the shortest rest length up to which the rounding of strains is negligible."""
SHORTEST, LONGEST = 1e-6, 1e3
"""Sizes of bodies that are taken as meant [m]."""
TORN = 2.0
"""A body would be torn if depenetration stretched a spring by more than this factor."""


def starting_state(system: System, assembly: Assembly, method_state: int, time: float, fps: float) -> State:
    """Return the state of a system at `time` [s], with driven particles at their prescribed positions.

    See `State` for `method_state`.
    """
    state = State.from_system(system, assembly.model, method_state)
    for effect in assembly.all:
        effect.place(state, time, fps)
        effect.steps = Steps(fps, 1)  # `begin` will know how many
        if isinstance(effect, StageTables | ForceField):  # stability bounds read the values of this time
            effect.hold(time)
    return state


def warn_of_start(assembly: Assembly, colliders: Sequence[Collider]) -> str | None:
    """Warn about a doubtful start; return a message about overlap with an obstacle or between bodies, or None.

    Raises ValueError if depenetration would tear a body.
    """
    model, obstacles, drives = assembly.model, assembly.colliders, assembly.drives
    inside = None
    if obstacles is not None and obstacles.overlap:
        free = np.isfinite(model.mass) & ~obstacles.spared
        if obstacles.leads_out:
            check_swallowed(model.system, colliders, free)
        radius = obstacles.radius
        inside = start_inside(model.system, colliders, free, radius, depenetrates=obstacles.leads_out)
    displaced = None if drives is None else drives.displaced()
    contacts = filter(None, (assembly.body_contact, assembly.surface_contact))
    overlapping = [effect.overlapping() for effect in contacts]
    for message in filter(None, (inside, start_far(model), displaced, *overlapping)):
        checks.warn(message, checks.StartWarning)
    if (message := other_units(model.system)) is not None:
        checks.warn(message, checks.UnitWarning)
    return next(filter(None, (inside, *overlapping)), None)


def start_inside(
    system: System,
    colliders: Sequence[Collider],
    free: NDArray[np.bool_],
    radius: NDArray[np.float64],
    *,
    depenetrates: bool,
) -> str | None:
    """Return a message about the particle that starts deepest in an obstacle; None if none is inside.

    Pinned and driven particles, which are not `free`, may be anywhere. The rule "report" has no depenetration.
    """
    if not colliders or not free.any():
        return None
    depths = start_depths(system.position[free], colliders, radius[free])
    k = int(np.argmax(depths.max(axis=1)))
    allowed = touching(system)
    if depths[k].max() <= allowed:
        return None
    deepest = int(np.argmax(depths[k]))
    particle = int(np.flatnonzero(free)[deepest])
    of = f", of radius {radius[particle]:.3g} m," if radius[particle] else ""
    count = int((depths.max(axis=0) > allowed).sum())
    others = f" (of {count} that start inside obstacles it is the deepest)" if count > 1 else ""
    tears = ", which may strain its connections" if system.connection_count else ""
    way = (
        f"moved out the shortest way within {DEPENETRATION_TIME} s"
        if depenetrates
        else "put onto the surface at once"
    )
    return (
        f"particle {particle}{of} starts {depths[k][deepest]:.3g} m inside colliders[{k}], a "
        f"{type(colliders[k]).__name__}{others}: if it does not move out by itself, it is {way}"
        f"{tears}; move the body or the obstacle apart, or pin what is meant to be inside"
    )


def check_swallowed(system: System, colliders: Sequence[Collider], free: NDArray[np.bool_]) -> None:
    """Raise ValueError for a body that starts wholly inside an obstacle and would be torn on the way out.

    Depenetration moves each particle out by its own shortest way. So in the middle of a box or wall the two halves
    of a body would leave on opposite sides.
    """
    if not system.connection_count:
        return
    depths = start_depths(system.position, colliders)
    piece = pieces(system.particle_count, system.connections)
    i, j = system.connections.T
    for k, collider in enumerate(colliders):
        outside = free & (depths[k] <= touching(system))
        swallowed = np.ones(system.particle_count, dtype=bool)
        swallowed[piece[outside]] = False
        (inner,) = np.nonzero(swallowed[piece[i]] & free[i] & free[j])
        if not len(inner):
            continue
        moved = system.position + ways_out(system.position, collider)
        apart, length = (np.linalg.norm(x[i[inner]] - x[j[inner]], axis=1) for x in (moved, system.position))
        worst = int(np.argmax(apart - TORN * length))
        if apart[worst] > TORN * length[worst]:
            body, ends = int(piece[i[inner[worst]]]), (int(i[inner[worst]]), int(j[inner[worst]]))
            raise ValueError(
                f"the body of particle {body} starts wholly inside colliders[{k}], a {type(collider).__name__}: "
                f"the nearest ways out of particles {ends[0]} and {ends[1]} lead {apart[worst]:.3g} m apart, "
                "which would tear it; it must start outside, or near one side of it, or be pinned"
            )


def caught(system: System, colliders: Sequence[Collider]) -> str | None:
    """Return a message about connected particles, one inside an obstacle, that leave it on opposite sides.

    None if there are none. Obstacles with a motion are not looked at, and pinned particles may be anywhere.
    """
    i, j = system.connections.T
    step = 1e-6 * max(1.0, float(np.abs(system.position).max()))
    for k, collider in enumerate(colliders):
        if collider.motion is not None:
            continue
        depth = start_depths(system.position, [collider])[0]
        deep = ~system.pinned & (depth > touching(system))
        inside = deep[i] | deep[j]
        if not inside.any():
            continue
        # Forward differences, which also have a direction halfway between two faces.
        steps = step * np.eye(system.dim)
        ways = np.stack([depth - start_depths(system.position + e, [collider])[0] for e in steps], axis=1)
        opposite = inside & (np.einsum("cd,cd->c", ways[i], ways[j]) < 0.0)
        if opposite.any():
            pair = system.connections[int(opposite.argmax())].tolist()
            return (
                f"the connected particles {pair} leave colliders[{k}], a {type(collider).__name__}, "
                "on opposite sides: the body is caught on it; the obstacle must be thicker, or come nearer by its "
                "motion"
            )
    return None


def other_units(system: System) -> str | None:
    """Return a message about a body so large or small that it is probably not in metres; None if there is none."""
    lengths = stored(system.rest_length)
    if not len(lengths):
        return None
    if np.ptp(system.position, axis=0).max() <= LONGEST and lengths.min() >= SHORTEST:
        return None  # without looking for bodies
    piece = pieces(system.particle_count, system.connections)
    low, high = np.full_like(system.position, np.inf), np.full_like(system.position, -np.inf)
    np.minimum.at(low, piece, system.position)
    np.maximum.at(high, piece, system.position)
    bodies = np.unique(piece[system.connections[:, 0]])
    size = (high - low)[bodies].max(axis=1)
    odd = np.flatnonzero((size < SHORTEST) | (size > LONGEST))
    if not len(odd):
        return None
    how = "; scale(0.001, about=(0, 0, 0)) converts a system from millimetres" if size[odd[0]] > LONGEST else ""
    return f"the body of particle {bodies[odd[0]]} is {size[odd[0]]:.3g} m long, and lengths are in metres{how}"


def start_far(model: Model) -> str | None:
    """Return a message about a system too far from the origin for float32 strains; None if it is near."""
    system = model.system
    if model.precision != "float32" or not system.connection_count:
        return None  # compensated sums add the rounding errors
    most = float(max(system.position.max(), -system.position.min()))
    apart, shortest = float(np.spacing(np.float32(most))), float(stored(system.rest_length).min())
    if apart <= COARSE * shortest:
        return None
    return (
        f"the system reaches to {most:.3g} m from the origin, where numbers of float32 are {apart:.2g} m apart "
        f"and strains of its shortest connection, of {shortest:.3g} m, are rounded by {apart / shortest:.2g}: "
        "move it near the origin, or use precision='float64'"
    )
