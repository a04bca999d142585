"""The force law, and routes by which a particle gets the sum of its connections' forces (see also `stencil`).

A route names a struct (`Forces`) of what its kernels read, and a function `force_at` that returns the force on a
particle. Scattered forces are evaluated beforehand, connection by connection (`evaluate`); gathered ones where
they are asked for. Positions are x − lost.x in compensated precision: what rounding took matters to short springs.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from .basis import vector
from .compensation import compensation
from .constants import KIND_SHIFT, MOST_KINDS, constants
from .dampers import LINEAR, Law, damper_force
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
def spring_damper(dim: int, scalar: type, damper: Law | None):
    """Compose the force density q of a connection: its force on its first particle is −q Δx (report eq. 7).

    F = (−k (|Δx| − l0) − b Δv·Δx̂) Δx̂ with Δx = x_i − x_j, Δv = v_i − v_j and Δx̂ = Δx/|Δx|; the second particle
    gets −F. Another law of damping takes the place of b Δv·Δx̂; without a damper that is not compiled.
    """
    V = vector(dim, scalar)
    linear, damped = damper == LINEAR, damper is not None
    resistance = damper_force(scalar, damper or LINEAR)
    rsqrt = inverse_root(scalar)
    tiny = TINY[scalar]

    @wp.func
    def force_density(dx: V, dv: V, rest_length: scalar, stiffness: scalar, damping: scalar) -> scalar:
        inverse_length = rsqrt(wp.dot(dx, dx) + scalar(tiny))
        tension = -stiffness * rest_length  # but for k |Δx|, which is k in the density
        if wp.static(linear):
            tension += damping * (wp.dot(dv, dx) * inverse_length)
        if wp.static(damped and not linear):
            tension += resistance(wp.dot(dv, dx) * inverse_length, damping)
        return stiffness + tension * inverse_length

    return force_density


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
def scatter(dim: int, scalar: type, damper: Law | None, compensated: bool, storage: str) -> Route:
    """Compose the route by connections: each adds its force to one end and subtracts it from the other.

    The report's Algorithm 3. The force of a connection is computed once, and atomics settle who adds first.
    Taking a force sets its place to zero for the next evaluation.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load, store, add = records(dim, scalar)
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damper)
    Constants, take = constants(scalar, storage)
    damped = damper is not None

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
def gather(dim: int, scalar: type, damper: Law | None, compensated: bool, storage: str) -> Route:
    """Compose the route by particles: each sums the forces of its own connections, from a table of neighbours.

    The report's Algorithm 2. Every force is computed twice, nobody waits for anybody, and the order of sums is
    fixed. Slot s of particle i lies at first[i / 32] + 32 s + i mod 32, so that particles side by side read
    numbers side by side; slots that pad a slice of 32 to equal width name the particle itself, which exerts none.
    With "packed" constants a slot has the kind of the connection in the byte above the neighbour's number.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damper)
    Constants, take = constants(scalar, storage)
    packed, damped = storage == "packed", damper is not None

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
