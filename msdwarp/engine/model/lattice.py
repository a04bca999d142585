"""Find the lattices from which a system is cut, so that neighbours need no table.

A lattice's points are stored row after row along x. A point's neighbours in row (y, z) have indices around its own
index plus `shift`; a bit mask has the neighbours to which the point is connected. Connections in no lattice
direction, such as connections from `join`, are ties.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...bodies import TEARING_FIELDS, LawKinds, System, is_uniform, stored, uniform
from ...kernels.springs.constants import CONSTANTS, MOST_KINDS
from ...kernels.springs.lanes import MOST_NEIGHBOURS
from ...kernels.springs.stencil import COLUMN, stencil_rows


class Lattice(NamedTuple):
    """A system in terms of its lattices, as `msdwarp.kernels.springs.stencil` needs it."""

    steps: tuple[tuple[int, int, int], ...]
    """The directions: steps from a point to half of its neighbours."""
    mask: NDArray[np.uint32]
    """The neighbours to which each particle is connected, as bits, shape [particle_count]."""
    shift: NDArray[np.int32]
    """Offset to each row of neighbours, shape [row_count], or [row_count, particle_count] if it varies."""
    kind: NDArray[np.int32]
    """Row of `constants` for each particle, shape [particle_count]; all 0 if there is one kind."""
    constants: dict[str, NDArray[np.float64]]
    """Rest length, stiffness and damping, each of shape [1, direction_count] if the lattice is `uniform`.

    Otherwise [kind_count, 2 direction_count]: of each neighbour, in the order of the mask's bits.
    """
    ties: NDArray[np.int32]
    """The connections that follow no direction, shape [tie_count]; see `msdwarp.engine.springs.extra_springs`."""

    def numbers(self, system: System) -> NDArray[np.int32]:
        """Return the index of the connection from each particle in each direction, −1 for none.

        `system` is the system of this lattice. Shape [direction_count, particle_count].
        """
        found = np.full((len(self.steps), system.particle_count), -1, dtype=np.int32)
        for body in system.directions:
            for name, part in body.items():
                chosen = np.arange(system.connection_count, dtype=np.int32)[part]
                found[self.steps.index(step_of(name)), system.connections[chosen, 0]] = chosen
        return found

    def neighbours(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Return offsets and constants of neighbours, in the order of summation, if all particles have one shift.

        Shapes [neighbour_count] and [kind_count, neighbour_count, 3]; constants are in the order of CONSTANTS.
        """
        _, rows = stencil_rows(self.steps)
        each = [(int(self.shift[r]) + one.along, one.number) for r, row in enumerate(rows) for one in row]
        offset, number = np.array(each, dtype=np.int32).T
        number %= self.constants["stiffness"].shape[1]
        return offset, np.stack([self.constants[name][:, number] for name in CONSTANTS], axis=-1)

    @property
    def uniform(self) -> bool:
        """Whether all particles have the same shifts and constants."""
        return self.shift.ndim == 1 and len(self.constants["stiffness"]) == 1

    @property
    def rimmed(self) -> bool:
        """Whether all particles have the same shifts, but second neighbours other constants at a rim."""
        return self.shift.ndim == 1 and not self.uniform and max(map(max, self.steps)) > 1

    @property
    def stride(self) -> int:
        """Index distance from a layer to the next if layers are evenly spaced; else 0."""
        if not self.uniform:
            return 0
        rows, _ = stencil_rows(self.steps)
        axis = 1 if any(z for _, z in rows) else 0
        shift = dict(zip(rows, map(int, self.shift), strict=True))
        stride = shift.get((0, 1) if axis else (1, 0), 0)
        within = (shift.get((y, 0) if axis else (0, 0), 0) for y, _ in rows)
        layered = all(shift[row] == own + row[axis] * stride for row, own in zip(rows, within, strict=True))
        return stride if layered else 0

    @property
    def margin(self) -> int:
        """Number of entries before the first and after the last particle that kernels read without using them."""
        return 2 + (2 + COLUMN) * (self.reach - 2)

    @property
    def reach(self) -> int:
        """The `margin` for kernels with a thread per particle instead of per column."""
        return 2 + (int(np.abs(self.shift).max()) if self.shift.ndim == 1 else 0)


class NotALattice(ValueError):
    """Raised if a system is not cut from lattices, or constants vary too much within a direction of a body."""


def step_of(name: str) -> tuple[int, int, int]:
    """Return the step (x, y, z) of the lattice direction `name`: (1, −1, 0) for "x-y", (0, 2, 0) for "2y"."""
    step, sign, reach = [0, 0, 0], 1, 1
    for letter in name:
        if letter in "+-":
            sign = 1 if letter == "+" else -1
        elif letter == "2":
            reach = 2
        elif letter in "xyz":
            step["xyz".index(letter)] = sign * reach
            reach = 1
        else:
            raise NotALattice(f"direction {name!r} is none of a lattice")
    return step[0], step[1], step[2]


class _Part(NamedTuple):
    """The connections of one body in one direction."""

    body: int
    direction: int
    along: int
    """Step along x."""
    there: int
    """Row of the second particle of a connection, as seen from the first."""
    back: int
    connections: slice


def find_lattice(system: System) -> Lattice:
    """Return the lattices of a system, found by its named directions, each of which is checked.

    Raises NotALattice if no connection is in a direction, if a direction's connections do not follow its step, or
    if its constants vary within a body; with second neighbours, if they vary in too many ways.
    """
    if isinstance(system.spring, LawKinds) or isinstance(system.damper, LawKinds):
        raise NotALattice("connections follow several laws")
    if system.yields:
        raise NotALattice("connections yield, and then each has a rest length of its own")
    names = list(dict.fromkeys(name for body in system.directions for name in body))
    if 2 * len(names) > MOST_NEIGHBOURS:
        raise NotALattice(f"there are {len(names)} directions, more than {MOST_NEIGHBOURS // 2}")
    steps = tuple(step_of(name) for name in names)
    rows, _ = stencil_rows(steps)
    count = system.connection_count
    parts = [
        _Part(
            b,
            names.index(name),
            step[0],
            rows.index(step[1:]),
            rows.index((-step[1], -step[2])),
            slice(*part.indices(count)),
        )
        for b, body in enumerate(system.directions)
        for name, part in body.items()
        for step in [step_of(name)]
    ]
    ties = _left_over([part for body in system.directions for part in body.values()], count)
    if (
        system.tears
        and len(ties)
        and not all(np.isinf(getattr(system, name)[ties]).all() for name in TEARING_FIELDS)
    ):
        raise NotALattice("a connection that is in none of its directions can break")
    shift = _common_shift(system, parts, len(rows))
    try:
        kinds, constants = _constants(system, parts, len(steps))
        kind = _kind_by_particle(system, parts, kinds)
        if shift is None or len(constants["stiffness"]) > 1:
            constants = {name: np.tile(values, 2) for name, values in constants.items()}
    except NotALattice:
        if max(map(max, steps)) < 2:  # sheets that resist bending have other constants along their rims
            raise
        kind, constants = _constants_by_neighbour(system, parts, len(steps))
    if shift is None:
        shift = _shift_by_particle(system, parts, len(rows))
    return Lattice(steps, _mask(system, parts, len(steps)), shift, kind, constants, ties)


def _left_over(slices: list[slice], count: int) -> NDArray[np.int32]:
    """Return the ties: connections in no direction of the lattice.

    Raise NotALattice if a connection is in two directions, or all connections are ties.
    """
    ties, end = [], 0
    for start, stop, step in sorted(part.indices(max(count, part.stop or 0)) for part in slices):
        if step != 1 or stop > count or (start < end and start < stop):
            raise NotALattice("directions are not slices of connections that each lie in one of them")
        ties.append(np.arange(end, start, dtype=np.int32))
        end = max(end, stop)
    ties.append(np.arange(end, count, dtype=np.int32))
    left_over = np.concatenate(ties)
    if not slices or len(left_over) == count > 0:
        raise NotALattice("no connection is in a direction of a lattice")
    return left_over


def _common_shift(system: System, parts: list[_Part], row_count: int) -> NDArray[np.int32] | None:
    """Return the index offset to each row of neighbours, shape [row_count]; None if particles differ."""
    shift: dict[int, int] = {}
    for part in parts:
        i, j = system.connections[part.connections].T
        if len(i):
            first = shift.setdefault(part.there, int(j[0] - i[0]) - part.along)
            if part.there == part.back and first != 0:
                return None
            shift[part.back] = -first
            if not (j - i == first + part.along).all():
                return None
    return np.array([shift.get(row, 0) for row in range(row_count)], dtype=np.int32)


def _shift_by_particle(system: System, parts: list[_Part], row_count: int) -> NDArray[np.int32]:
    """Return the index offset from each particle to each row of neighbours, shape [row_count, particle_count]."""
    shift = np.zeros((row_count, system.particle_count), dtype=np.int32)
    for check in (False, True):  # connections to one row must agree: the value written last must equal all others
        for part in parts:
            i, j = system.connections[part.connections].T
            offset = j - i - part.along
            if not check:
                shift[part.there, i], shift[part.back, j] = offset, -offset
            elif (shift[part.there, i] != offset).any() or (shift[part.back, j] != -offset).any():
                raise NotALattice("points of a row of the lattice do not lie side by side")
    return shift


def _mask(system: System, parts: list[_Part], direction_count: int) -> NDArray[np.uint32]:
    """Return the mask of each particle's neighbours: low bits for neighbours ahead, high bits for others."""
    mask = np.zeros(system.particle_count, dtype=np.uint32)
    expected = np.zeros(2 * direction_count, dtype=np.int64)
    for part in parts:
        for end, bit in enumerate((part.direction, part.direction + direction_count)):
            mask[system.connections[part.connections, end]] |= np.uint32(1 << bit)
            expected[bit] += part.connections.stop - part.connections.start
    found = [np.count_nonzero(mask & np.uint32(1 << bit)) for bit in range(2 * direction_count)]
    if not np.array_equal(found, expected):
        raise NotALattice("a particle has two connections in the same direction")
    return mask


def _constants(
    system: System, parts: list[_Part], direction_count: int
) -> tuple[dict[int, int], dict[str, NDArray[np.float64]]]:
    """Return the kind of each body that is a lattice, and the constants of each kind by name.

    Each array of constants has shape [kind_count, direction_count].
    """
    bodies = np.zeros((len(system.directions), len(CONSTANTS), direction_count))
    for part in parts:
        for k, name in enumerate(CONSTANTS):
            values = getattr(system, name)[part.connections]
            if len(values):
                bodies[part.body, k, part.direction] = values[0]
                if (stored(values) != values[0]).any():
                    raise NotALattice(f"{name} differs among the connections of a direction")
    named = sorted({part.body for part in parts})  # bodies without directions have no constants
    kinds, kind = np.unique(bodies[named], axis=0, return_inverse=True)
    of_body = dict(zip(named, map(int, kind.ravel()), strict=True))
    return of_body, {name: kinds[:, k] for k, name in enumerate(CONSTANTS)}


def _kind_by_particle(system: System, parts: list[_Part], kinds: dict[int, int]) -> NDArray[np.int32]:
    """Return the kind of each particle's body, shape [particle_count]."""
    n = system.particle_count
    if len(set(kinds.values())) == 1:
        return uniform(np.int32(0), n)
    kind = np.zeros(n, dtype=np.int32)
    for check in (False, True):
        for part in parts:
            ends = system.connections[part.connections]
            if not check:
                kind[ends] = kinds[part.body]
            elif (kind[ends] != kinds[part.body]).any():
                raise NotALattice("bodies of different lattices share particles")
    return kind


def _constants_by_neighbour(
    system: System, parts: list[_Part], direction_count: int
) -> tuple[NDArray[np.int32], dict[str, NDArray[np.float64]]]:
    """Return the kind of each particle, and the constants of each kind by name, where they vary within a body.

    Each array of constants is as in `Lattice`.
    """
    found = find_kinds(system)
    if found is None:
        raise NotALattice(f"constants differ among the connections of a direction in more than {MOST_KINDS} ways")
    table, number = found
    each = np.zeros((system.particle_count, 2 * direction_count), dtype=np.uint8)
    for own in (False, True):
        for part in parts:
            ends = system.connections[part.connections]
            columns = [part.direction, part.direction + direction_count]
            if own:
                each[ends, columns] = number[part.connections, None]
            elif len(ends):  # of neighbours that are missing, so that kinds are few
                each[ends.reshape(-1, 1), columns] = np.bincount(number[part.connections]).argmax()
    kinds, kind = np.zeros((1, 0), dtype=int), np.zeros(system.particle_count, dtype=np.uint16)
    for values in each.T:
        pairs, kind = _number_pairs(kind, values, MOST_KINDS)
        if len(pairs) > MOST_KINDS:
            raise NotALattice(f"constants differ among neighbours in more than {MOST_KINDS} ways")
        kinds = np.column_stack([kinds[pairs[:, 0]], pairs[:, 1]])
    return kind.astype(np.int32), {name: table[kinds, k] for k, name in enumerate(CONSTANTS)}


def _number_pairs(a: NDArray, b: NDArray, count: int) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
    """Return the pairs (a, b) that occur, for b below `count`, shape [any, 2], and which of them each is."""
    code = a * np.uint16(count) + b
    found = np.flatnonzero(np.bincount(code))
    number = np.zeros(found[-1] + 1, dtype=np.uint16)
    number[found] = np.arange(len(found))
    return np.stack(np.divmod(found, count), axis=1), number[code]


def find_kinds(
    system: System, law: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.uint8]] | None:
    """Return the distinct sets of constants, shape [kind_count, 3], and the kind of each spring.

    Given the number of each connection's law it is a fourth constant.

    Return None if there are more kinds than a byte can number.
    """
    table, kind = np.zeros((1, 0)), np.zeros(system.connection_count, dtype=np.uint16)
    for values in (*(getattr(system, name) for name in CONSTANTS), *([] if law is None else [law])):
        if len(values) == 0 or is_uniform(values):
            table = np.insert(table, table.shape[1], values[0] if len(values) else 0.0, axis=1)
            continue
        different = np.unique(values[:: max(1, len(values) // 4096)])  # a sample usually has all kinds
        while True:
            if len(different) > MOST_KINDS:
                return None
            place = np.minimum(np.searchsorted(different, values), len(different) - 1).astype(np.uint16)
            missed = values[different[place] != values]
            if len(missed) == 0:
                break
            different = np.union1d(different, missed[: MOST_KINDS + 1])
        pairs, kind = _number_pairs(kind, place, len(different))
        if len(pairs) > MOST_KINDS:
            return None
        table = np.column_stack([table[pairs[:, 0]], different[pairs[:, 1]]])
    return table, kind.astype(np.uint8)
