"""The force law, and three routes by which a particle gets the sum of its connections' forces.

A route names a struct (`Forces`) of what its kernels read, and a function `force_at` that returns the force on a
particle. Scattered forces are evaluated beforehand, connection by connection (`evaluate`); gathered ones where
they are asked for. Positions are x − lost.x in compensated precision: what rounding took matters to short springs.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from .basis import vector
from .compensation import compensation
from .records import records

RSQRT = """
#if defined(__CUDA_ARCH__)
    {cuda}
#else
    return decltype(x)(1) / wp::sqrt(x);
#endif
"""
RSQRT_FLOAT = 'float r; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x)); return r;'
TINY = {wp.float32: 1.2e-38, wp.float64: 1e-300}
"""The square of a length that is nothing [m²]. Coincident particles have no axis, and so no force: (q)·0."""


@functools.cache
def inverse_root(scalar: type):
    """Compose 1/√x, by one instruction in float32 on the GPU (error 2 units in the last place)."""
    cuda = RSQRT_FLOAT if scalar is wp.float32 else "return rsqrt(x);"

    @wp.func_native(RSQRT.format(cuda=cuda))
    def rsqrt(x: scalar) -> scalar: ...

    return rsqrt


@functools.cache
def spring_damper(dim: int, scalar: type, damped: bool):
    """Compose the force density q of a connection: its force on its first particle is −q Δx (report eq. 7).

    F = (−k (|Δx| − l0) − b Δv·Δx̂) Δx̂ with Δx = x_i − x_j, Δv = v_i − v_j and Δx̂ = Δx/|Δx|; the second particle
    gets −F. Without `damped` the damper term is not compiled.
    """
    V = vector(dim, scalar)
    rsqrt = inverse_root(scalar)
    tiny = TINY[scalar]

    @wp.func
    def force_density(dx: V, dv: V, rest_length: scalar, stiffness: scalar, damping: scalar) -> scalar:
        inverse_length = rsqrt(wp.dot(dx, dx) + scalar(tiny))
        tension = -stiffness * rest_length  # but for k |Δx|, which is k in the density
        if wp.static(damped):
            tension += damping * (wp.dot(dv, dx) * inverse_length)
        return stiffness + tension * inverse_length

    return force_density


CONSTANTS = ("rest_length", "stiffness", "damping")
"""The constants of a connection."""
MOST_KINDS = 256
"""Kinds of connections that one byte tells apart."""
KIND_SHIFT = 24
"""Bits of a particle's number below the kind of a connection, where a slot holds both."""

TAKE = """
#if defined(__CUDA_ARCH__)
    return __ldcs(values.data + c);  // read once: it need not stay in the cache
#else
    return values.data[c];
#endif
"""


@functools.cache
def constants(scalar: type, storage: str):
    """Compose (Constants, take): where they lie, and `take(constants, c)`, those of connection or slot c.

    Storage is "one" (all connections have the same), "kinds" (a byte per connection, and a table of few different
    ones), "packed" (the same table, c being a kind) or "own" (three numbers per connection). `take` returns a
    vector, in the order of CONSTANTS.
    """
    Three = vector(3, scalar)
    load = records(3, scalar).load

    if storage == "one":

        @wp.struct
        class OneForAll:
            all: Three

        @wp.func
        def take_one(constants: OneForAll, c: int) -> Three:
            return constants.all

        return OneForAll, take_one
    if storage == "packed":

        @wp.struct
        class Table:
            table: wp.array(dtype=Three)

        @wp.func
        def take_listed(constants: Table, kind: int) -> Three:
            return load(constants.table, kind)

        return Table, take_listed
    if storage == "kinds":

        @wp.func_native(TAKE)
        def kind_of(values: wp.array(dtype=wp.uint8), c: int) -> wp.uint8: ...

        @wp.struct
        class Kinds:
            kind: wp.array(dtype=wp.uint8)
            table: wp.array(dtype=Three)

        @wp.func
        def take_kind(constants: Kinds, c: int) -> Three:
            return load(constants.table, int(kind_of(constants.kind, c)))

        return Kinds, take_kind

    @wp.func_native(TAKE)
    def number(values: wp.array(dtype=scalar), c: int) -> scalar: ...

    @wp.struct
    class Own:
        rest_length: wp.array(dtype=scalar)
        stiffness: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)

    @wp.func
    def take_own(constants: Own, c: int) -> Three:
        return Three(
            number(constants.rest_length, c), number(constants.stiffness, c), number(constants.damping, c)
        )

    return Own, take_own


class Route(NamedTuple):
    """The device side of a route."""

    Forces: Any
    """Struct type of what the functions read."""
    force_at: Any
    """wp.func (forces, lost, x, v, i) -> force on particle i [N]."""
    evaluate: Any = None
    """wp.func (forces, lost, x, v, c) that adds the force of connection c beforehand, where there is one."""
    column_forces: Any = None
    """wp.func (forces, lost, x, v, i) -> forces on the particles i + d stride, as the rows d of a matrix."""
    block: int = 256
    """Threads in a block over particles."""
    bounds: tuple[int, int] | None = None
    """Threads in a block, and blocks that a multiprocessor shall hold; it limits registers (`wp.kernel`)."""
    grid_stride: bool | None = None
    """Whether threads may take several particles (`wp.kernel`): False needs less, but made stencils slower."""


@functools.cache
def difference(dim: int, scalar: type, compensated: bool):
    """Compose x_i − x_j for the position x_i of particle i, without its lost part, and particle j."""
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.func
    def apart(lost: Lost, x: wp.array(dtype=V), x_i: V, i: int, j: int) -> V:
        dx = x_i - load(x, j)
        if wp.static(compensated):
            dx = dx - (load(lost.x, i) - load(lost.x, j))
        return dx

    return apart


PAIR = """
#if defined(__CUDA_ARCH__)
    const int2 ends = reinterpret_cast<const int2*>(connections.data)[c];
    return {ends.x, ends.y};
#else
    return connections.data[c];
#endif
"""


@wp.func_native(PAIR)
def ends_of(connections: wp.array(dtype=wp.vec2i), c: int) -> wp.vec2i:
    """Return the two particles of connection c."""
    ...


@functools.cache
def scatter(dim: int, scalar: type, damped: bool, compensated: bool, storage: str) -> Route:
    """Compose the route by connections: each adds its force to one end and subtracts it from the other.

    The report's Algorithm 3. The force of a connection is computed once, and atomics settle who adds first.
    Taking a force sets its place to zero for the next evaluation.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load, store, add = records(dim, scalar)
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damped)
    Constants, take = constants(scalar, storage)

    @wp.struct
    class Scattered:
        f: wp.array(dtype=V)
        connections: wp.array(dtype=wp.vec2i)
        constants: Constants

    @wp.func
    def evaluate(forces: Scattered, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), c: int):
        ends = ends_of(forces.connections, c)
        i = ends[0]
        j = ends[1]
        dx = apart(lost, x, load(x, i), i, j)
        dv = V()
        if wp.static(damped):
            dv = load(v, i) - load(v, j)
        own = take(forces.constants, c)
        force = -force_density(dx, dv, own[0], own[1], own[2]) * dx
        add(forces.f, i, force)
        add(forces.f, j, -force)

    @wp.func
    def force_at(forces: Scattered, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        f = load(forces.f, i)
        store(forces.f, i, V())
        return f

    return Route(Scattered, force_at, evaluate, block=1024, bounds=(1024, 1), grid_stride=False)


SLICE = 32
"""Particles side by side in the table of neighbours: as many as the GPU's threads that go together."""
CHUNK = 4
"""Slots that are read together, so that a thread waits for memory once for all of them."""
NEIGHBOURS = f"""
    wp::vec_t<{CHUNK}, wp::int32> others;
    for (int n = 0; n < {CHUNK}; ++n) {{
#if defined(__CUDA_ARCH__)
        others[n] = __ldcs(other.data + slot + n * {SLICE});  // read once: it need not stay in the cache
#else
        others[n] = other.data[slot + n * {SLICE}];
#endif
    }}
    return others;
"""


@functools.cache
def gather(dim: int, scalar: type, damped: bool, compensated: bool, storage: str) -> Route:
    """Compose the route by particles: each sums the forces of its own connections, from a table of neighbours.

    The report's Algorithm 2. Every force is computed twice, nobody waits for anybody, and the order of sums is
    fixed. Slot s of particle i lies at first[i / 32] + 32 s + i mod 32, so that particles side by side read
    numbers side by side; slots that pad a slice of 32 to equal width name the particle itself, which exerts none.
    With "packed" constants a slot has the kind of the connection in the byte above the neighbour's number.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damped)
    Constants, take = constants(scalar, storage)
    packed = storage == "packed"

    Others = wp.types.vector(CHUNK, int)

    @wp.func_native(NEIGHBOURS)
    def neighbours(other: wp.array(dtype=int), slot: int) -> Others: ...

    @wp.struct
    class Gathered:
        first: wp.array(dtype=int)
        other: wp.array(dtype=int)
        constants: Constants

    @wp.func
    def force_at(forces: Gathered, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        x_i = load(x, i)
        v_i = V()
        dv = V()
        if wp.static(damped):
            v_i = load(v, i)
        force = V()
        part = i / wp.static(SLICE)
        slot = forces.first[part] + i % wp.static(SLICE)
        end = forces.first[part + 1]
        following = neighbours(forces.other, slot)
        while slot < end:
            others = following
            # Where the next neighbours are is asked for before these are dealt with, to wait less for memory.
            following = neighbours(forces.other, slot + wp.static(CHUNK * SLICE))
            for n in range(wp.static(CHUNK)):
                j = others[n]
                c = slot + wp.static(n * SLICE)
                if wp.static(packed):
                    c = (j >> wp.static(KIND_SHIFT)) & wp.static(MOST_KINDS - 1)
                    j = j & wp.static((1 << KIND_SHIFT) - 1)
                own = take(forces.constants, c)
                dx = apart(lost, x, x_i, i, j)
                if wp.static(damped):
                    dv = v_i - load(v, j)
                force -= force_density(dx, dv, own[0], own[1], own[2]) * dx
            slot += wp.static(CHUNK * SLICE)
        return force

    bounds = (256, 5) if scalar is wp.float32 else None
    return Route(Gathered, force_at, bounds=bounds, grid_stride=False)


class Neighbour(NamedTuple):
    """One of the neighbours that a lattice point may have."""

    along: int
    """Its place in its row, relative to the point: −1, 0 or 1."""
    direction: int
    """Which direction of the lattice leads there, or back."""
    bit: int
    """The bit of the point's mask that says that it is connected with it."""


@functools.cache
def stencil_rows(steps: tuple[tuple[int, int, int], ...]) -> tuple[tuple[tuple[int, int], ...], list]:
    """Return the rows (y, z) around a lattice point in which its neighbours lie, and the neighbours in each row.

    `steps` are the lattice's directions. Points along x lie side by side in memory, so a row is found once.
    """
    found: dict[tuple[int, int], list[Neighbour]] = {}
    for d, (x, y, z) in enumerate(steps):
        found.setdefault((y, z), []).append(Neighbour(x, d, 1 << d))
        found.setdefault((-y, -z), []).append(Neighbour(-x, d, 1 << (d + len(steps))))
    rows = tuple(sorted(found, key=lambda row: row[::-1]))
    return rows, [sorted(found[row]) for row in rows]


@functools.cache
def stencil(dim: int, scalar: type, damped: bool, compensated: bool, steps: tuple, uniform: bool) -> Route:
    """Compose the gathering route for lattices, whose neighbours need no table.

    A mask of bits per particle says which of its neighbours it is connected with. In a `uniform` lattice each row
    of neighbours lies `shift` particles further on, the same for all, and a direction has one rest length,
    stiffness and damping; else shifts are by particle, and constants by particle's kind and direction.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damped)
    rows, neighbours = stencil_rows(steps)
    Shifts, Constants = wp.types.vector(len(rows), int), wp.types.vector(len(steps), scalar)
    most = max(map(len, neighbours))

    def field(r: int, n: int, name: str) -> int:
        return getattr(neighbours[r][n], name) if n < len(neighbours[r]) else 0

    @wp.struct
    class Lattice:
        mask: wp.array(dtype=wp.uint32)
        shift: Shifts
        stride: int
        rest_length: Constants
        stiffness: Constants
        damping: Constants

    @wp.struct
    class Lattices:
        mask: wp.array(dtype=wp.uint32)
        shift: wp.array2d(dtype=int)
        kind: wp.array(dtype=int)
        rest_length: wp.array2d(dtype=scalar)
        stiffness: wp.array2d(dtype=scalar)
        damping: wp.array2d(dtype=scalar)

    Forces = Lattice if uniform else Lattices

    @wp.func
    def force_at(forces: Forces, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        mask = forces.mask[i]
        x_i = load(x, i)
        v_i = V()
        dv = V()
        kind = int(0)
        if wp.static(damped):
            v_i = load(v, i)
        if wp.static(not uniform):
            kind = forces.kind[i]
        force = V()
        for r in range(wp.static(len(rows))):
            if wp.static(uniform):
                row = i + forces.shift[r]
            else:
                row = i + forces.shift[r, i]
            for n in range(wp.static(most)):
                if wp.static(n < len(neighbours[r])):
                    j = row + wp.static(field(r, n, "along"))
                    d = wp.static(field(r, n, "direction"))
                    dx = apart(lost, x, x_i, i, j)
                    if wp.static(damped):
                        dv = v_i - load(v, j)
                    if wp.static(uniform):
                        q = force_density(dx, dv, forces.rest_length[d], forces.stiffness[d], forces.damping[d])
                    else:
                        q = force_density(
                            dx,
                            dv,
                            forces.rest_length[kind, d],
                            forces.stiffness[kind, d],
                            forces.damping[kind, d],
                        )
                    # What is read of a missing neighbour may be any other particle's: it does not count.
                    if (mask & wp.uint32(wp.static(field(r, n, "bit")))) == wp.uint32(0):
                        q = scalar(0.0)
                    force -= q * dx
        return force

    columns = column_forces(dim, scalar, damped, compensated, steps, Lattice) if uniform else None
    # In float64 more threads would not find registers for columns.
    return Route(Forces, force_at, column_forces=columns, block=256 if scalar is wp.float32 else 128)


COLUMN = 2
"""Particles in a column whose neighbours are read together."""


@functools.cache
def column_forces(dim: int, scalar: type, damped: bool, compensated: bool, steps: tuple, Lattice: Any):
    """Compose the forces on a column of particles i + d stride, stride being the lattice's step to the next layer.

    The neighbours of a column lie in the layers −1 … COLUMN. What is read of one serves all particles of the
    column that it is a neighbour of: reading is what bounds a stencil. None where the lattice has no layers.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load
    force_density = spring_damper(dim, scalar, damped)
    rows, neighbours = stencil_rows(steps)
    axis = 1 if any(z for _, z in rows) else 0  # layers are along z, in a sheet along y
    inner = [row for row in rows if row[axis] == 0]
    if any(row[axis] and ((row[0], 0) if axis else (0, 0)) not in inner for row in rows) or len(rows) == 1:
        return None
    found = {(row, n.along): n for row, ns in zip(rows, neighbours, strict=True) for n in ns}
    Column = wp.types.matrix((COLUMN, dim), scalar)
    Masks = wp.types.vector(COLUMN, wp.uint32)

    def neighbour(r: int, p: int, a: int, d: int) -> Neighbour | None:
        """Return what the record at place a of inner row r in layer p − 1 is to particle d."""
        row = (inner[r][0], p - 1 - d) if axis else (p - 1 - d, 0)
        return found.get((row, a - 1))

    def is_read(r: int, p: int, a: int) -> bool:
        return any(neighbour(r, p, a, d) for d in range(COLUMN))

    def is_felt(r: int, p: int, a: int, d: int) -> bool:
        return neighbour(r, p, a, d) is not None

    def field(r: int, p: int, a: int, d: int, name: str) -> int:
        return getattr(neighbour(r, p, a, d), name, 0)

    @wp.func
    def forces_at(forces: Lattice, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> Column:
        own_x = Column()
        own_v = Column()
        own_lost = Column()
        total = Column()
        masks = Masks()
        for d in range(wp.static(COLUMN)):
            own = i + d * forces.stride
            own_x[d] = load(x, own)
            if wp.static(damped):
                own_v[d] = load(v, own)
            if wp.static(compensated):
                own_lost[d] = load(lost.x, own)
            if own < forces.mask.shape[0]:
                masks[d] = forces.mask[own]
        for p in range(wp.static(COLUMN + 2)):
            for r in range(wp.static(len(inner))):
                row = i + (p - 1) * forces.stride + forces.shift[wp.static(rows.index(inner[r]))]
                for a in range(3):
                    if wp.static(is_read(r, p, a)):
                        j = row + (a - 1)
                        x_j = load(x, j)
                        v_j = V()
                        lost_j = V()
                        if wp.static(damped):
                            v_j = load(v, j)
                        if wp.static(compensated):
                            lost_j = load(lost.x, j)
                        for d in range(wp.static(COLUMN)):
                            if wp.static(is_felt(r, p, a, d)):
                                n = wp.static(field(r, p, a, d, "direction"))
                                dx = own_x[d] - x_j
                                if wp.static(compensated):
                                    dx = dx - (own_lost[d] - lost_j)
                                l0 = forces.rest_length[n]
                                q = force_density(dx, own_v[d] - v_j, l0, forces.stiffness[n], forces.damping[n])
                                # What is read of a missing neighbour may be any other particle's.
                                if (masks[d] & wp.uint32(wp.static(field(r, p, a, d, "bit")))) == wp.uint32(0):
                                    q = scalar(0.0)
                                total[d] = total[d] - q * dx
        return total

    return forces_at
