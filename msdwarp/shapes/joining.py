"""Bodies joined to each other, or to themselves, by connections between their particles."""

import itertools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import CONNECTION_FIELDS, System, joined, selected

NOW = "now"
"""The rest length that is the present distance."""
ROUNDING = 1e-9
"""By so much, relatively, a distance may be above the one given: 3 × 0.1 is no more than 0.3."""
_MOST_CELLS = 1 << 20
"""Cells along an axis in which particles are looked for, at most."""
_MOST_AT_ONCE = 1 << 22
"""Distances that are computed together, about."""


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

    These are ordinary connections, included in energies, files, pictures and the stable step. Lattices keep the
    fast stencil algorithm; the added connections are in a small extra table.

    Parameters
    ----------
    a, b
        The bodies; without `b`, particles of `a` are joined with each other, as along a seam.
    within
        Join each particle of one body with the nearest particle of the other, if that is within this distance [m].
        If several are equally near, the first is used.
    pairs
        Join these particles of a and b (or of a and a), shape [any, 2]; instead of `within`.
    on
        The particles of a and of b that `within` may join, each the name of a group, indices or a mask; None is
        all. Without `b` both are required.
    stiffness
        Spring constants k [N/m], one or shape [pair_count].
    damping
        Damper constants b by the bodies' law of damping, [N s/m] if that is linear; one or shape [pair_count].
    rest_length
        Lengths at which the springs exert no force [m], one or shape [pair_count]; "now" uses the current
        distances.

    Raises
    ------
    ValueError
        If neither or both of `within` and `pairs` are given, no particles are near enough, a pair has the same
        particle twice or is out of range, a number is out of range, or particles coincide and `rest_length` is
        "now", so that the spring has no direction. Also if the bodies cannot be added: see `System`.
    """
    checks.instance("a", a, System, "box((3, 3, 3))")
    if b is not None:
        checks.instance("b", b, System, "box((3, 3, 3))")
    if (within is None) == (pairs is None):
        raise ValueError("within and pairs are two ways to say which particles are joined; one must be given")
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
    _check_two(connections)
    if isinstance(rest_length, str):
        checks.one_of("rest_length", rest_length, [NOW, "a number above 0"])
        _check_apart(system, connections, found)
        rest_length = np.linalg.norm(np.subtract(*np.moveaxis(system.position[connections], 1, 0)), axis=1)
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
    return System.trusted(**(vars(system) | fields))


def _pairs(pairs: ArrayLike, of_a: int, of_b: int) -> NDArray[np.int32]:
    """Return pairs as they are given, checked."""
    given = checks.indices("pairs", pairs, 2, max(of_a, of_b))
    if not len(given):
        raise ValueError("pairs is empty; it must name one pair at least")
    for end, count in enumerate((of_a, of_b)):
        holds, allowed = checks.index_below(count)
        checks.every(f"pairs[:, {end}]", given[:, end], holds(given[:, end]), allowed)
    return given


def _check_two(connections: NDArray[np.int32]) -> None:
    """Raise ValueError for a particle that would be joined with itself."""
    same = connections[:, 0] == connections[:, 1]
    if same.any():
        k = int(np.argmax(same))
        raise ValueError(f"pairs[{k}] is particle {connections[k, 0]} with itself; it must be two")


def _check_apart(system: System, connections: NDArray[np.int32], found: NDArray[np.int32]) -> None:
    """Raise ValueError for particles that lie in one place, where a connection has no direction."""
    first, second = np.moveaxis(system.position[connections], 1, 0)
    together = (first == second).all(axis=1)
    if together.any():
        one, other = found[int(np.argmax(together))]
        raise ValueError(
            f"rest_length is 'now', but particles {one} and {other} lie in one place, where a spring has no "
            "direction and no length: put the bodies a little apart, or give a length above 0"
        )


def _near(a: System, b: System | None, within: float, on: tuple[Any, Any]) -> NDArray[np.int32]:
    """Return the pairs of particles that are nearest to each other, from either side, in order."""
    if not isinstance(on, tuple | list) or len(on) != 2:
        raise ValueError(
            f"on is {checks.repr_short(on)}; it must be two, of a and of b, such as ('left', 'right')"
        )
    bodies = (a, a if b is None else b)
    one, other = (
        np.flatnonzero(_chosen(f"on[{k}]", body, which))
        for k, (body, which) in enumerate(zip(bodies, on, strict=True))
    )
    if b is None and len(np.intersect1d(one, other)):
        raise ValueError("on must name two parts of a body that is joined with itself, with no particle in both")
    x, y = a.position[one], bodies[1].position[other]
    there, back = nearest(x, y, within), nearest(y, x, within)
    forth = np.flatnonzero(there >= 0)
    backwards = np.flatnonzero(back >= 0)
    pairs = np.concatenate(
        [np.stack([forth, there[forth]], axis=1), np.stack([back[backwards], backwards], axis=1)]
    )
    if not len(pairs):
        raise ValueError(f"within is {within:g} m; no particle of one body is that near to one of the other")
    pairs = np.unique(pairs, axis=0)
    return np.stack([one[pairs[:, 0]], other[pairs[:, 1]]], axis=1).astype(np.int32)


def _chosen(name: str, body: System, which: Any) -> NDArray[np.bool_]:
    """Return which particles of a body are meant."""
    if which is None:
        return np.ones(body.particle_count, dtype=bool)
    if isinstance(which, str):
        return body.group(which, name)
    return selected(name, which, body.particle_count)


def nearest(x: NDArray[np.float64], y: NDArray[np.float64], within: float) -> NDArray[np.int64]:
    """Return which of the points y [m] is nearest to each of x, shape [x_count]; −1 where none is within reach.

    Points y are sorted into cells as large as the reach, so that what is near lies in a cell beside; along the
    last coordinate cells lie one behind the other, and three of them are one range of points.
    """
    found = np.full(len(x), -1)
    reach = within * (1 + ROUNDING)
    if not len(x) or not len(y):
        return found
    low = y.min(axis=0) - reach
    high = y.max(axis=0) + reach
    close = np.flatnonzero(((x >= low) & (x <= high)).all(axis=1))
    edge = np.maximum(reach, (high - low) / _MOST_CELLS)
    cells = np.floor((high - low) / edge).astype(np.int64) + 3  # one beyond either end
    cell_of_y = np.floor((y - low) / edge).astype(np.int64) + 1
    order = np.argsort(_key(cell_of_y, cells), kind="stable")
    keys = _key(cell_of_y, cells)[order]
    aside = list(itertools.product((-1, 0, 1), repeat=x.shape[1] - 1))
    chunk = max(1, _MOST_AT_ONCE // max(1, len(aside) * _most_in_a_cell(keys)))
    for start in range(0, len(close), chunk):
        some = close[start : start + chunk]
        cell = np.floor((x[some] - low) / edge).astype(np.int64) + 1
        best = np.full(len(some), np.inf)
        for step in aside:
            near = cell + np.array([*step, 0])
            first = np.searchsorted(keys, _key(near - _last(near), cells), side="left")
            end = np.searchsorted(keys, _key(near + _last(near), cells), side="right")
            _take_nearer(x[some], y, order, first, end, best, found, some)
        found[some[best > reach * reach]] = -1
    return found


def _last(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a step of one cell along the last coordinate."""
    return np.eye(cell.shape[1], dtype=np.int64)[-1]


def _key(cell: NDArray[np.int64], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number for each cell; those of cells side by side along the last coordinate follow each other."""
    return np.asarray(np.ravel_multi_index(tuple(cell.T), tuple(map(int, cells)), mode="clip"))


def _most_in_a_cell(keys: NDArray[np.int64]) -> int:
    """Return how many points the fullest cell holds, times the three of a range."""
    return 3 * int(np.diff(np.flatnonzero(np.diff(keys, prepend=-1, append=-1))).max(initial=1))


def _take_nearer(
    x: NDArray,
    y: NDArray,
    order: NDArray,
    first: NDArray,
    end: NDArray,
    best: NDArray,
    found: NDArray,
    numbers: NDArray,
) -> None:
    """Look among the points order[first … end − 1] of each x for one that is nearer than the `best` so far."""
    count = end - first
    some = np.flatnonzero(count > 0)
    if not len(some):
        return
    count = count[some]
    begin = np.cumsum(count) - count
    place = np.arange(count.sum()) - np.repeat(begin - first[some], count)
    candidate = order[place]
    square = ((np.repeat(x[some], count, axis=0) - y[candidate]) ** 2).sum(axis=1)
    least = np.minimum.reduceat(square, begin)
    # Of several at the same distance the first.
    those = np.where(square == np.repeat(least, count), candidate, len(y))
    which = np.minimum.reduceat(those, begin)
    mine = numbers[some]
    nearer = (least < best[some]) | ((least == best[some]) & (which < found[mine]))
    best[some[nearer]] = least[nearer]
    found[mine[nearer]] = which[nearer]
