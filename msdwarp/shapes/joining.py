"""Joining: connections between particles of two bodies, or of one."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import CONNECTION_FIELDS, LawKinds, System, joined, joined_laws, particles_meant

NOW = "now"
"""Value of `rest_length` that means the current distance."""
ROUNDING = 1e-9
"""Relative tolerance of a distance limit: 3 × 0.1 counts as within 0.3."""
_MOST_CELLS = 1 << 20
"""Maximal number of cells per axis in the search for near particles."""
_MOST_AT_ONCE = 1 << 22
"""Approximate number of distances that are computed together."""


def join(
    a: System,
    b: System | None = None,
    *,
    within: float | None = None,
    pairs: ArrayLike | None = None,
    on: tuple[Any, Any] = (None, None),
    stiffness: ArrayLike,
    damping: ArrayLike = 0.0,
    rest_length: ArrayLike | str = NOW,
) -> System:
    """Return two bodies as one system, with connections between them added at the end.

    The added connections are ordinary ones, included in energies, files, pictures and the stable step. Lattices
    keep the fast stencil; the added connections are in a small table beside it.

    Parameters
    ----------
    a, b
        The bodies; without `b`, particles of `a` are joined with each other, as along a seam.
    within
        Join each particle of one body with the nearest particle of the other, if that is within this distance [m].
        If several are equally near, the first is used.
    pairs
        Join these particles of a and b (or of a and a), shape [any, 2]; in place of `within`.
    on
        The particles of a and of b that `within` may join, each a group's name, indices or a mask; None is all.
        Without `b` both are required.
    stiffness
        Spring constants k [N/m], one or shape [pair_count].
    damping
        Damper constants b by the bodies' law of damping, [N s/m] if linear; one or shape [pair_count]. If the
        bodies have several laws of springs or dampers, those of the added connections are linear.
    rest_length
        Lengths at which the springs exert no force [m], one or shape [pair_count]; "now" uses the current
        distances.

    Raises
    ------
    ValueError
        If neither or both of `within` and `pairs` are given, no particles are near enough, a pair has the same
        particle twice or is out of range, a number is out of range, or particles coincide and `rest_length` is
        "now", so that a spring has no direction. Also if the bodies cannot be added: see `System`.
    """
    checks.instance("a", a, System, "box((3, 3, 3))")
    if b is not None:
        checks.instance("b", b, System, "box((3, 3, 3))")
    if (within is None) == (pairs is None):
        raise ValueError("within and pairs both select particles to join; one of them must be given")
    if not isinstance(on, tuple | list) or len(on) != 2:
        raise ValueError(
            f"on is {checks.repr_short(on)}; it must be two, of a and of b, such as ('left', 'right')"
        )
    system, behind = (a, 0) if b is None else (a + b, a.particle_count)
    if pairs is None:
        assert within is not None
        found = _near(a, b, checks.positive("within", within), on)
    else:
        if on[0] is not None or on[1] is not None:
            raise ValueError(
                f"on is {checks.repr_short(on)}; with pairs, which name particles, it must be left out"
            )
        found = _pairs(pairs, a.particle_count, a.particle_count if b is None else b.particle_count)
    connections = found + np.array([0, behind], dtype=np.int32)
    same = connections[:, 0] == connections[:, 1]
    if same.any():
        k = int(np.argmax(same))
        raise ValueError(f"pairs[{k}] is particle {connections[k, 0]} with itself; it must be two")
    if isinstance(rest_length, str):
        checks.one_of("rest_length", rest_length, [NOW, "a number above 0"])
        rest_length = _distances(system, connections, found)
    ties = System(
        position=system.position,
        connections=connections,
        rest_length=rest_length,
        stiffness=stiffness,
        damping=damping,
    )
    fields: dict[str, Any] = {
        name: joined(getattr(system, name), getattr(ties, name)) for name in CONNECTION_FIELDS
    }
    if system.original_length is system.rest_length:
        fields["original_length"] = fields["rest_length"]
    fields["connections"] = np.concatenate([system.connections, ties.connections])
    for name in ("spring", "damper"):
        if isinstance(law := getattr(system, name), LawKinds):
            fields[name] = joined_laws(law, system.connection_count, getattr(ties, name), ties.connection_count)
    return System.trusted(**(vars(system) | fields))


def _pairs(pairs: ArrayLike, of_a: int, of_b: int) -> NDArray[np.int32]:
    """Return the given pairs of particles as an array, shape [any, 2]; raise ValueError if one is invalid."""
    given = checks.indices("pairs", pairs, 2, max(of_a, of_b))
    if not len(given):
        raise ValueError("pairs is empty; it must name one pair at least")
    for end, count in enumerate((of_a, of_b)):
        checks.within(f"pairs[:, {end}]", given[:, end], checks.index_below(count))
    return given


def _distances(system: System, connections: NDArray[np.int32], found: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the distances of pairs [m]; raise ValueError if two particles coincide, so have no direction."""
    first, second = np.moveaxis(system.position[connections], 1, 0)
    together = (first == second).all(axis=1)
    if together.any():
        one, other = found[int(np.argmax(together))]
        raise ValueError(
            f"rest_length is 'now', but particles {one} and {other} lie in one place, where a spring has no "
            "direction and no length: put the bodies a little apart, or give a length above 0"
        )
    return np.linalg.norm(first - second, axis=1)


def _near(a: System, b: System | None, within: float, on: tuple[Any, Any]) -> NDArray[np.int32]:
    """Return the pairs that join each particle with the nearest one of the other body, in order."""
    bodies = (a, a if b is None else b)
    one, other = (
        np.flatnonzero(particles_meant(f"on[{k}]", which, body))
        for k, (body, which) in enumerate(zip(bodies, on, strict=True))
    )
    if b is None and len(np.intersect1d(one, other)):
        raise ValueError("on must name two parts of a body that is joined with itself, with no particle in both")
    x, y = a.position[one], bodies[1].position[other]
    there, back = nearest(x, y, within), nearest(y, x, within)
    pairs = np.concatenate([np.c_[np.arange(len(x)), there], np.c_[back, np.arange(len(y))]])
    pairs = np.unique(pairs[(pairs >= 0).all(axis=1)], axis=0)
    if not len(pairs):
        raise ValueError(f"within is {within:g} m; no particle of one body is that near to one of the other")
    return np.stack([one[pairs[:, 0]], other[pairs[:, 1]]], axis=1).astype(np.int32)


def nearest(x: NDArray[np.float64], y: NDArray[np.float64], within: float) -> NDArray[np.int64]:
    """Return the index of the nearest point y [m] to each point x, shape [x_count]; −1 if all y are too far.

    Of several equally near points it is the first. Points y are sorted into cells of size `within`, so that near
    points are in adjacent cells. Cells along the last coordinate have successive numbers, so that three cells form
    one range.
    """
    found, least = np.full(len(x), -1), np.full(len(x), np.inf)
    reach = within * (1 + ROUNDING)
    if not len(x) or not len(y):
        return found
    low, high = y.min(axis=0) - reach, y.max(axis=0) + reach
    edge = np.maximum(reach, (high - low) / _MOST_CELLS)
    shape = tuple(np.floor((high - low) / edge).astype(np.int64) + 3)  # one more cell at each end

    def cells_of(points: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.floor((points - low) / edge).astype(np.int64) + 1

    def numbers_of(cells: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.asarray(np.ravel_multi_index(tuple(cells.T), shape, mode="clip"))

    number = numbers_of(cells_of(y))
    order = np.argsort(number, kind="stable")
    number = number[order]
    fullest = int(np.unique(number, return_counts=True)[1].max())
    close = np.flatnonzero(((x >= low) & (x <= high)).all(axis=1))
    chunk = max(1, _MOST_AT_ONCE // (3 ** x.shape[1] * fullest))
    for start in range(0, len(close), chunk):
        some = close[start : start + chunk]
        point, candidate = [], []
        for step in itertools.product((-1, 0, 1), repeat=x.shape[1] - 1):
            first, last = (numbers_of(cells_of(x[some]) + np.array([*step, along])) for along in (-1, 1))
            begin, end = np.searchsorted(number, first), np.searchsorted(number, last, side="right")
            count = np.maximum(end - begin, 0)
            point.append(np.repeat(some, count))
            candidate.append(order[np.arange(count.sum()) + np.repeat(begin - np.cumsum(count) + count, count)])
        mine, other = np.concatenate(point), np.concatenate(candidate)
        square = ((x[mine] - y[other]) ** 2).sum(axis=1)
        np.minimum.at(least, mine, square)
        best = (square == least[mine]) & (square <= reach * reach)
        found[mine[best]] = len(y)
        np.minimum.at(found, mine[best], other[best])
    return found
