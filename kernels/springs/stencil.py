"""The stencil, a force algorithm for lattices: it computes the indices of neighbours, without a table."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fully_hashed, vector
from ..compensation import state_types
from ..records import records
from .dampers import law_numbers
from .force_algorithm import ForceAlgorithm, difference, velocity_of
from .fracture import Breaking
from .law import spring_damper
from .spring_laws import Laws


class Neighbour(NamedTuple):
    """A possible neighbour of a lattice point: its position in a row, and its mask bit."""

    along: int
    """Position in the row relative to the point: −1, 0 or 1; from −2 to 2 with second neighbours."""
    direction: int
    """Index of the lattice direction from the point to the neighbour, or from the neighbour to the point."""
    bit: int
    """Bit in the point's mask that is set if the two are connected."""

    @property
    def number(self) -> int:
        """The number of the bit: the direction, with as many as there are directions added to lead back."""
        return self.bit.bit_length() - 1


@functools.cache
def stencil_rows(steps: tuple[tuple[int, int, int], ...]) -> tuple[tuple[tuple[int, int], ...], list]:
    """Return (rows (y, z) around a lattice point that have neighbours, neighbours in each row).

    `steps` are the lattice's directions. Points along x are adjacent in memory, so a row needs only one offset.
    """
    found: dict[tuple[int, int], list[Neighbour]] = {}
    for d, (x, y, z) in enumerate(steps):
        found.setdefault((y, z), []).append(Neighbour(x, d, 1 << d))
        found.setdefault((-y, -z), []).append(Neighbour(-x, d, 1 << (d + len(steps))))
    rows = tuple(sorted(found, key=lambda row: row[::-1]))
    return rows, [sorted(found[row]) for row in rows]


@functools.cache
def after_breaking(kinds: tuple, uniform: bool, Forces: Any, breaking: Breaking):
    """Compose the force on particle i after testing `suspects`: springs longer than the common limit.

    Mask bits of springs that break are cleared, and `force`, which includes all suspects, is summed again without
    these springs. Since this is rare, the code is outside the loops that are unrolled for each neighbour. `kinds`
    are the first five arguments of `stencil`.
    """
    dim, scalar, laws, compensated, steps = kinds
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load, separation = records(dim, scalar).load, difference(dim, scalar, compensated)
    density, velocity = spring_damper(dim, scalar, laws), velocity_of(dim, scalar, laws.damper is not None)
    breaks = breaking.breaks
    Three, (_, neighbours) = vector(3, scalar), stencil_rows(steps)
    # (index of the bit, row, position in the row), in the order in which `stencil` sums forces.
    each = [(n.number, r, n.along) for r, ns in enumerate(neighbours) for n in ns]
    directions = len(steps)

    def table(column: int) -> str:
        return (
            f"static const int table[] = {{{', '.join(str(entry[column]) for entry in each)}}}; return table[k];"
        )

    @wp.func_native(table(0))
    def number_of(k: int) -> int: ...

    @wp.func_native(table(1))
    def row_of(k: int) -> int: ...

    @wp.func_native(table(2))
    def along_of(k: int) -> int: ...

    @wp.func
    def remaining_force(
        forces: Forces,
        compensation: Compensation,
        x: Vectors,
        v: Vectors,
        i: int,
        mask: wp.uint32,
        suspects: wp.uint32,
        force: V,
    ) -> V:
        x_i = load(x, i)
        v_i = velocity(v, i)
        remaining = mask
        total = V()
        k = int(0)
        while k < wp.static(2 * directions):
            number = number_of(k)
            bit = wp.uint32(1) << wp.uint32(number)
            if (mask & bit) != wp.uint32(0):
                d = number % wp.static(directions)
                if wp.static(uniform):
                    b = forces.breaking
                    j = i + b.offset[k]
                    own = Three(b.own[k, 0], b.own[k, 1], b.own[k, 2])
                else:
                    kind = forces.kind[i]
                    j = i + forces.shift[row_of(k), i] + along_of(k)
                    own = Three(
                        forces.rest_length[kind, number],
                        forces.stiffness[kind, number],
                        forces.damping[kind, number],
                    )
                dx = separation(compensation, x, x_i, i, j)
                if (suspects & bit) != wp.uint32(0):
                    first = i  # the first particle of the spring
                    if number >= wp.static(directions):
                        first = j
                    c = forces.breaking.number[d * forces.mask.shape[0] + first]
                    if breaks(forces.breaking, c, own[0], wp.dot(dx, dx)):
                        remaining = remaining & ~bit
                if (remaining & bit) != wp.uint32(0):
                    dv = v_i - velocity(v, j)
                    q = density(dx, dv, *own) if wp.static(laws.linear) else density(dx, dv, *own, forces.law)
                    total -= q * dx
            k += 1
        if remaining == mask:
            return force
        forces.mask[i] = remaining
        return total

    return remaining_force


@functools.cache
def stencil(
    dim: int,
    scalar: type,
    laws: Laws,
    compensated: bool,
    steps: tuple,
    uniform: bool,
    breaking: Breaking | None = None,
) -> ForceAlgorithm:
    """Compose the stencil algorithm for lattices, which needs no table of neighbours.

    Each particle has a bit mask of its connected neighbours. In a `uniform` lattice the offset `shift` of each row
    of neighbours is equal for all particles, and each direction has one rest length, stiffness and damping.
    Otherwise each particle has shifts of its own, and constants by the particle's kind and the neighbour. If
    springs break, each particle clears bits of its own mask.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load
    separation, density = difference(dim, scalar, compensated), spring_damper(dim, scalar, laws)
    velocity, tears = velocity_of(dim, scalar, laws.damper is not None), breaking is not None
    Breaks, is_suspect, _ = breaking or (None, None, None)
    rows, neighbours = stencil_rows(steps)
    Shifts, Constants = wp.types.vector(len(rows), int), wp.types.vector(len(steps), scalar)
    most = max(map(len, neighbours))

    def field(r: int, n: int, name: str) -> int:
        return getattr(neighbours[r][n], name) if n < len(neighbours[r]) else 0

    @wp.struct
    class Lattice:
        mask: wp.array(dtype=wp.uint32)  # bits of existing neighbours, shape [particle_count]
        shift: Shifts  # index offset of each row of neighbours
        stride: int  # index offset to the next layer; 0 if layers are not evenly spaced
        # Of each direction:
        rest_length: Constants  # [m]
        stiffness: Constants  # [N/m]
        damping: Constants  # b in the units of the law
        if not laws.linear:
            law: law_numbers(scalar)
        if tears:
            breaking: Breaks

    @wp.struct
    class Lattices:
        mask: wp.array(dtype=wp.uint32)  # bits of existing neighbours, shape [particle_count]
        shift: wp.array2d(dtype=int)  # index offsets of rows of neighbours, shape [row_count, particle_count]
        kind: wp.array(dtype=int)  # kind of each particle, shape [particle_count]
        # Of each kind and neighbour, in the order of bits, shape [kind_count, 2 direction_count]:
        rest_length: wp.array2d(dtype=scalar)  # [m]
        stiffness: wp.array2d(dtype=scalar)  # [N/m]
        damping: wp.array2d(dtype=scalar)  # b in the units of the law
        if not laws.linear:
            law: law_numbers(scalar)
        if tears:
            breaking: Breaks

    Forces = Lattice if uniform else Lattices
    kinds = (dim, scalar, laws, compensated, steps)
    remaining_force = after_breaking(kinds, uniform, Forces, breaking) if tears else None

    @fully_hashed
    def force_at(forces: Forces, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
        mask = forces.mask[i]
        x_i = load(x, i)
        v_i = velocity(v, i)
        kind = int(0)
        if wp.static(not uniform):
            kind = forces.kind[i]
        force = V()
        if wp.static(tears):
            suspects = wp.uint32(0)
        for r in range(wp.static(len(rows))):
            if wp.static(uniform):
                row = i + forces.shift[r]
            else:
                row = i + forces.shift[r, i]
            for n in range(wp.static(most)):
                if wp.static(n < len(neighbours[r])):
                    j = row + wp.static(field(r, n, "along"))
                    d = wp.static(field(r, n, "direction" if uniform else "number"))
                    dx = separation(compensation, x, x_i, i, j)
                    dv = v_i - velocity(v, j)
                    if wp.static(uniform):
                        rest = forces.rest_length[d]
                        k = forces.stiffness[d]
                        b = forces.damping[d]
                    else:
                        rest = forces.rest_length[kind, d]
                        k = forces.stiffness[kind, d]
                        b = forces.damping[kind, d]
                    if wp.static(tears):
                        if is_suspect(forces.breaking, rest, wp.dot(dx, dx)):
                            suspects = suspects | wp.uint32(wp.static(field(r, n, "bit")))
                    if wp.static(laws.linear):
                        q = density(dx, dv, rest, k, b)
                    else:
                        q = density(dx, dv, rest, k, b, forces.law)
                    # Data read for a missing neighbour are discarded.
                    if (mask & wp.uint32(wp.static(field(r, n, "bit")))) == wp.uint32(0):
                        q = scalar(0.0)
                    force -= q * dx
        if wp.static(tears):
            if (suspects & mask) != wp.uint32(0):
                force = remaining_force(forces, compensation, x, v, i, mask, suspects, force)
        return force

    columns = column_forces(kinds, Lattice, breaking) if uniform else None
    # In float64 columns need too many registers for a higher number of threads.
    single = scalar is wp.float32
    # The rarely executed code for breaking must not take registers from the main loop.
    bounds, column_bounds = ((256, 4), (256, 3)) if tears and single else (None, None)
    return ForceAlgorithm(
        Forces,
        force_at,
        column_forces=columns,
        block=256 if single else 128,
        bounds=bounds,
        column_bounds=column_bounds,
        tears=tears,
        grid_stride=None if compensated else False,
    )


COLUMN = 2
"""Number of particles in a column; their neighbours are read together."""


@functools.cache
def column_forces(kinds: tuple, Lattice: Any, breaking: Breaking | None = None):
    """Compose the forces on a column of particles i + d stride, with `stride` the index offset between layers.

    Neighbours of a column are in layers −1 … COLUMN. Each is read once for all particles of the column, since
    memory reads limit the speed of a stencil. Return None if the lattice has no layers, or second neighbours,
    which would be outside these layers. `kinds` are the first five arguments of `stencil`.
    """
    dim, scalar, laws, compensated, steps = kinds
    if any(abs(s) > 1 for step in steps for s in step):
        return None
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load
    density, velocity = spring_damper(dim, scalar, laws), velocity_of(dim, scalar, laws.damper is not None)
    rows, neighbours = stencil_rows(steps)
    axis = 1 if any(z for _, z in rows) else 0  # layers are stacked along z; in a sheet along y
    inner = [row for row in rows if row[axis] == 0]
    if any(row[axis] and ((row[0], 0) if axis else (0, 0)) not in inner for row in rows) or len(rows) == 1:
        return None
    found = {(row, n.along): n for row, ns in zip(rows, neighbours, strict=True) for n in ns}
    Column = wp.types.matrix((COLUMN, dim), scalar)
    Masks = wp.types.vector(COLUMN, wp.uint32)
    tears = breaking is not None
    _, is_suspect, _ = breaking or (None, None, None)
    remaining_force = after_breaking(kinds, True, Lattice, breaking) if tears else None

    def neighbour(r: int, p: int, a: int, d: int) -> Neighbour | None:
        """Return the record at position a of row r in layer p − 1, as a neighbour of particle d, or None."""
        row = (inner[r][0], p - 1 - d) if axis else (p - 1 - d, 0)
        return found.get((row, a - 1))

    def is_read(r: int, p: int, a: int) -> bool:
        return any(neighbour(r, p, a, d) for d in range(COLUMN))

    def is_felt(r: int, p: int, a: int, d: int) -> bool:
        return neighbour(r, p, a, d) is not None

    def field(r: int, p: int, a: int, d: int, name: str) -> int:
        return getattr(neighbour(r, p, a, d), name, 0)

    @fully_hashed
    def forces_at(forces: Lattice, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> Column:
        own_x = Column()
        own_v = Column()
        own_lost = Column()
        total = Column()
        masks = Masks()
        if wp.static(tears):
            suspects = Masks()
        for d in range(wp.static(COLUMN)):
            own = i + d * forces.stride
            own_x[d] = load(x, own)
            own_v[d] = velocity(v, own)
            if wp.static(compensated):
                own_lost[d] = load(compensation.x, own)
            if own < forces.mask.shape[0]:
                masks[d] = forces.mask[own]
        for p in range(wp.static(COLUMN + 2)):
            for r in range(wp.static(len(inner))):
                row = i + (p - 1) * forces.stride + forces.shift[wp.static(rows.index(inner[r]))]
                for a in range(3):
                    if wp.static(is_read(r, p, a)):
                        j = row + (a - 1)
                        x_j = load(x, j)
                        v_j = velocity(v, j)
                        lost_j = V()
                        if wp.static(compensated):
                            lost_j = load(compensation.x, j)
                        for d in range(wp.static(COLUMN)):
                            if wp.static(is_felt(r, p, a, d)):
                                n = wp.static(field(r, p, a, d, "direction"))
                                dx = own_x[d] - x_j
                                if wp.static(compensated):
                                    dx = dx - (own_lost[d] - lost_j)
                                l0 = forces.rest_length[n]
                                if wp.static(tears):
                                    if is_suspect(forces.breaking, l0, wp.dot(dx, dx)):
                                        suspects[d] = suspects[d] | wp.uint32(wp.static(field(r, p, a, d, "bit")))
                                dv = own_v[d] - v_j
                                k = forces.stiffness[n]
                                b = forces.damping[n]
                                if wp.static(laws.linear):
                                    q = density(dx, dv, l0, k, b)
                                else:
                                    q = density(dx, dv, l0, k, b, forces.law)
                                # Data read for a missing neighbour are discarded.
                                if (masks[d] & wp.uint32(wp.static(field(r, p, a, d, "bit")))) == wp.uint32(0):
                                    q = scalar(0.0)
                                total[d] = total[d] - q * dx
        if wp.static(tears):
            for d in range(wp.static(COLUMN)):
                if (suspects[d] & masks[d]) != wp.uint32(0):
                    own = i + d * forces.stride
                    total[d] = remaining_force(forces, compensation, x, v, own, masks[d], suspects[d], total[d])
        return total

    return forces_at
