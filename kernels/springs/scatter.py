"""The scatter algorithm: each spring adds its force to its two particles."""

import functools

import warp as wp

from ..compensation import state_types
from ..records import records
from .constants import constants
from .dampers import law_data
from .force_algorithm import ForceAlgorithm, difference, ends_of, velocity_of
from .fracture import Breaking
from .law import spring_damper
from .spring_laws import Laws


@functools.cache
def scatter(
    dim: int, scalar: type, laws: Laws, compensated: bool, storage: str, breaking: Breaking | None = None
) -> ForceAlgorithm:
    """Compose the scatter algorithm: each spring adds its force to one end and subtracts it from the other.

    This is Algorithm 3 of the 2014 report. Each force is computed once. Additions are atomic, in any order.
    Reading a particle's force resets it to zero for the next evaluation. A broken spring is made to connect its
    first particle to itself, so that it adds nothing.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load, store, add = records(dim, scalar)
    separation, density = difference(dim, scalar, compensated), spring_damper(dim, scalar, laws)
    Constants, take = constants(scalar, storage, laws.several)
    velocity, tears = velocity_of(dim, scalar, laws.damper is not None), breaking is not None
    Breaks, is_suspect, breaks = breaking or (None, None, None)

    @wp.struct
    class Scattered:
        f: wp.array(dtype=V)  # sums of forces [N], shape [particle_count]
        connections: wp.array(dtype=wp.vec2i)  # two particles each, shape [connection_count]
        constants: Constants  # of springs
        if not laws.linear:
            law: law_data(scalar, laws)
        if tears:
            breaking: Breaks

    @wp.func
    def evaluate(forces: Scattered, compensation: Compensation, x: Vectors, v: Vectors, c: int):
        ends = ends_of(forces.connections, c)
        i = ends[0]
        j = ends[1]
        dx = separation(compensation, x, load(x, i), i, j)
        dv = velocity(v, i) - velocity(v, j)
        own = take(forces.constants, c)
        if wp.static(tears):
            if is_suspect(forces.breaking, own[0], wp.dot(dx, dx)):
                if breaks(forces.breaking, c, own[0], wp.dot(dx, dx)):
                    forces.connections[c] = wp.vec2i(i, i)
                    dx = V()
        q = density(dx, dv, *own) if wp.static(laws.linear) else density(dx, dv, *own, forces.law)
        force = -q * dx
        add(forces.f, i, force)
        add(forces.f, j, -force)

    @wp.func
    def force_at(forces: Scattered, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
        f = load(forces.f, i)
        store(forces.f, i, V())
        return f

    return ForceAlgorithm(
        Scattered, force_at, evaluate, block=1024, bounds=(1024, 1), tears=tears, grid_stride=False
    )
