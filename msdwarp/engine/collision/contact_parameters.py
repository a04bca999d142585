"""What contact between bodies needs beforehand: rules by kinds of bodies, bounds of rates, chunks of facets."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, places_along_curve
from ...world import Contact
from ..model.model import Model

CONTACTS_OF_A_SPHERE = 32.0
"""With how many others a single particle is taken to be in contact at a time, in the bound of the rates.

About 6 would do for stability. With more than twice the substeps that these ask for, the restitution of a pair is
within 2 % of what was asked for at most moments of impact, and within 3 % at all.
"""
CONTACTS_OF_A_ROPE = 4.0
"""The same of a particle that hangs on others, in a rope or a heap."""
EDGE_FACTOR = 2.0
"""Mass that a point on an edge may stand for, by that of a vertex."""
NOTHING = 1e-30
"""Spacing of what has none, such as a single particle [m]."""
PIECE = 32
"""Facets that are boxed together, on a GPU by a warp."""
MORTON_BITS = 16
"""Cells along each axis in which places are sorted, as a power of 2."""

STORED = {
    "tangential_displacement": "slip",
    "contact_body": "partner",
    "contact_side": "seen",
    "initial_overlap": "allowed",
    "way": "way",
    "level": "level",
}
"""The names that arrays of the history of contact have in checkpoints: those of version 0.1."""


def harmonic_mean(a: Any, b: Any) -> Any:
    """Return 2ab/(a + b), the stiffness of a contact between bodies of these [N/m]; see `kernels.collision`."""
    return 2 * a * b / (a + b)


def given_stiffness(rules: Sequence[Contact], rule: NDArray[Any]) -> NDArray[np.float64]:
    """Return what is given for contacts by the numbers of their rules [N/m]; −1 where nothing is."""
    return np.array([*(-1.0 if one.stiffness is None else one.stiffness for one in rules), -1.0])[rule]


def stiffness_of_pairs(
    surfaces: TouchingSurfaces, rules: Sequence[Contact], rule: NDArray[Any], a: NDArray[Any], b: NDArray[Any]
) -> NDArray[np.float64]:
    """Return the stiffness of contacts between bodies a and b, by the numbers of their rules [N/m]."""
    given = given_stiffness(rules, rule)
    with np.errstate(invalid="ignore", divide="ignore"):
        own = harmonic_mean(surfaces.stiffness[a], surfaces.stiffness[b])
    return np.where(given < 0, own, given)


def led_apart(
    surfaces: TouchingSurfaces, bodies: tuple[int, int], deep: float, points: int, seconds: float
) -> str:
    """Return words about the two bodies that overlap most at the start, by so much [m]."""
    particles = [int(np.argmax(surfaces.body_of_particle == body)) for body in bodies]
    other = "itself" if bodies[0] == bodies[1] else f"that of particle {particles[1]}"
    return (
        f"the body of particle {particles[0]} starts {deep:.3g} m inside {other} "
        f"({points} points of surfaces start inside bodies): they are led apart within "
        f"{seconds} s, as far as they are no deeper than half a spacing; move them apart, or have them "
        "ignore each other by Contact(groups=..., exclude=True)"
    )


def contact_blocks(
    mass: NDArray[np.float64],
    surfaces: TouchingSurfaces,
    rules: Sequence[Contact],
    kind: NDArray[np.int32],
    rule: NDArray[np.int32],
    density: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what contacts add to the blocks of K [N/m] and B [N s/m] of each particle, as numbers.

    A contact of stiffness k and gradient g has the matrix k g gᵀ. By Gershgorin that is at most the diagonal
    matrix of k |g_i| Σ|g_j|, where Σ|g_j| = 2: a point's weights add up to 1, and those of the facet too. Blocks
    count half of it. All points of a surface are taken to be in contact at a time, and as many of others.
    """
    bodies = len(surfaces.closed)
    own, spacing = surfaces.stiffness, np.maximum(surfaces.spacing, NOTHING)
    stiff, reaction, ratio = (np.zeros(bodies) for _ in range(3))
    # Bodies of the same kind that are alike count once.
    table = np.stack([kind, own, spacing, surfaces.closed], axis=1)
    alike, number = np.unique(table, axis=0, return_inverse=True)
    number = number.reshape(-1)
    for a, (kind_a, k_a, s_a, _) in enumerate(alike):
        most = opposite = zeta = 0.0
        for kind_b, k_b, s_b, _ in alike:
            which = rule[int(kind_a), int(kind_b)]
            if which < 0:
                continue
            one = rules[which]
            k = one.stiffness if one.stiffness is not None else harmonic_mean(k_a, k_b)
            # How many points of the other may press where this one has one: grains lie a thickness apart.
            apart = s_b if s_b > NOTHING else (one.thickness or s_a)
            most, opposite = max(most, k), max(opposite, k * max(1.0, (s_a / apart) ** 2))
            zeta = max(zeta, 2**0.5 * one.damping_ratio)
        mine = number == a
        stiff[mine], reaction[mine], ratio[mine] = most, opposite, zeta
    body, ends, share = surfaces.body, surfaces.ends, surfaces.share
    vertices = len(surfaces.particle)
    weights = np.zeros(vertices)
    np.add.at(weights, ends[:, 0], 1 - share)
    np.add.at(weights, ends[:, 1], share)
    bare = np.bincount(body[surfaces.corner[:, 0]], minlength=bodies) > 0
    bare &= ~surfaces.closed & (surfaces.radius > 0.2 * spacing)
    contacts = np.where(surfaces.spacing == 0, CONTACTS_OF_A_SPHERE, np.where(bare, CONTACTS_OF_A_ROPE, 1.0))
    each = contacts[body] * (stiff + reaction)[body] * density[body] * weights
    mass = np.where(np.isfinite(mass), mass, 0.0)
    heavy = (surfaces.weight * mass[surfaces.particle]).sum(axis=1)
    k_point = np.maximum(stiff, reaction)[body]
    damped = contacts[body] * ratio[body] * density[body] * np.sqrt(EDGE_FACTOR * k_point * heavy) * 2 * weights
    stiffness, damping = np.zeros(len(mass)), np.zeros(len(mass))
    for total, values in ((stiffness, each), (damping, damped)):
        np.add.at(total, surfaces.particle, np.abs(surfaces.weight) * values[:, None])
    return stiffness, damping


def rules_by_kind(
    model: Model, surfaces: TouchingSurfaces, rules: Sequence[Contact]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the kind of each body, and by kinds the number of the rule that holds, −1 where none does.

    Bodies in the same groups of those that rules name are of one kind.
    """
    bodies, body = len(surfaces.closed), surfaces.body_of_particle
    names = sorted({name for one in rules for name in one.groups or ()})
    within = np.zeros((bodies, len(names)), dtype=bool)
    count = np.bincount(body, minlength=bodies)
    for k, name in enumerate(names):
        held = np.bincount(body[model.system.group(name)], minlength=bodies)
        if ((held > 0) & (held < count)).any():
            raise ValueError(
                f"contact.groups names {name!r}, which holds a part of a body; it must hold whole ones"
            )
        within[:, k] = held > 0
    kinds, kind = np.unique(within, axis=0, return_inverse=True)
    rule = np.full((len(kinds), len(kinds)), -1, dtype=np.int32)
    for number, one in enumerate(rules):
        value = -1 if one.exclude else number
        if one.groups is None:
            rule[:] = value
            continue
        a, b = (kinds[:, names.index(name)] for name in one.groups)
        rule[np.outer(a, b) | np.outer(b, a)] = value
    return kind.reshape(-1).astype(np.int32), rule


def pieces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return pieces of at most PIECE facets of one body each: its body, the first, and the one behind the last."""
    begins = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    ends = np.append(begins[1:], len(owner))
    firsts = np.concatenate([np.arange(a, b, PIECE) for a, b in zip(begins, ends, strict=True)])
    lasts = np.minimum(firsts + PIECE, ends[np.searchsorted(begins, firsts, side="right") - 1])
    return np.stack([owner[firsts], firsts, lasts], axis=1).astype(np.int32)


def curve(body: NDArray[np.integer], place: NDArray[np.floating]) -> NDArray[np.int32]:
    """Return an order in which what is near each other in a body follows each other: a curve that fills space."""
    return np.lexsort([places_along_curve(place, MORTON_BITS), body]).astype(np.int32)


def check_stiffness(
    surfaces: TouchingSurfaces, rules: Sequence[Contact], kind: NDArray[np.int32], rule: NDArray[np.int32]
) -> None:
    """Raise ValueError for bodies that have no stiffness where none is given, and particles that have no size."""
    soft = surfaces.stiffness <= 0
    for number, one in enumerate(rules):
        meant = (rule == number).any(axis=1)[kind]
        if one.stiffness is None and (soft & meant).any():
            raise ValueError(
                f"contact.stiffness is None, but {int((soft & meant).sum())} of the bodies have no connections "
                "to take it from; it must be a number [N/m]"
            )
        grains = np.bincount(kind[(surfaces.spacing == 0) & meant], minlength=len(rule))
        several = (rule == number) & np.minimum.outer(grains, grains).astype(bool)
        np.fill_diagonal(several, np.diag(several) & (grains > 1))
        if one.thickness is None and several.any():
            raise ValueError(
                f"contact.thickness is None, but {int(grains.sum())} of the bodies are single particles, which "
                "have no size; it must be the distance at which they touch [m]"
            )


def hops_apart(
    surfaces: TouchingSurfaces, rules: Sequence[Contact], kind: NDArray[np.int32], rule: NDArray[np.int32]
) -> NDArray[np.int64]:
    """Return within how many edges of it nothing of a body touches a vertex, shape [body_count]."""
    own = rule[kind, kind]
    given = np.array([-1.0 if one.thickness is None else one.thickness for one in rules])[own]
    thickness = np.where(given < 0, 2.0 * surfaces.radius, given)
    within = np.array([one.self_contact for one in rules])[own] & (own >= 0)
    hops = np.zeros(len(own), dtype=np.int64)
    wide = within & (surfaces.spacing > 0)
    hops[wide] = 1.5 * thickness[wide] / surfaces.spacing[wide]
    return hops


def neighbourhoods(
    surfaces: TouchingSurfaces, hops: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the neighbours of each vertex begin, and these: itself, and who is few enough edges away.

    Parameters
    ----------
    surfaces
        What can touch.
    hops
        How many edges count of each body, shape [body_count].
    """
    count, corner = len(surfaces.particle), surfaces.corner
    edges = np.concatenate([corner[:, [k, k - 1]] for k in range(3)]).astype(np.int64)
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    degree = np.bincount(edges[:, 0], minlength=count)
    first = np.append(0, np.cumsum(degree))
    vertex = near = np.arange(count)
    for hop in range(1, int(hops.max(initial=0)) + 1):
        on = hops[surfaces.body[vertex]] >= hop
        further = degree[near[on]]
        begins = np.repeat(first[near[on]] - np.append(0, np.cumsum(further)[:-1]), further)
        added = edges[begins + np.arange(len(begins)), 1]
        both = np.concatenate([vertex, np.repeat(vertex[on], further)]), np.concatenate([near, added])
        vertex, near = np.divmod(np.unique(both[0] * count + both[1]), count)
    return np.append(0, np.cumsum(np.bincount(vertex, minlength=count))), near
