"""Loads whose force is a sum over elements of a few particles, such as pairs: each kind is one function.

`evaluate` is a wp.func (own, x, v) -> (forces on the element's particles [N], stored energy [J]), of the element's
numbers, and of positions and velocities in a row for each particle. An energy is counted from its least, as a run
diverges that has more kinetic energy than there was. Warp's derivatives are the adjoint and the bound of the step.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import position_of
from ..effect import ElementForce, ForceTerm, instant
from ..records import records


@functools.cache
def element_load(
    dim: int, scalar: type, compensated: bool, factory: Any, points: int, width: int, stores: bool
) -> tuple[ForceTerm, ElementForce, Any, Any]:
    """Compose (term, law, add_blocks, measure) of a kind of load; `factory` (dim, scalar) composes its `evaluate`.

    `points` and `width` are how many particles and numbers an element has; `stores`: the force is that of the
    energy. The kernel `add_blocks`, over elements, adds to the blocks of the stability bound; `measure`, over
    worlds and elements, writes each one's stored energy [J].
    """
    V, Own, Instant = vector(dim, scalar), vector(width, scalar), instant(dim, scalar, compensated)
    Rows, Wide = wp.types.matrix((points, dim), scalar), wp.types.matrix((points, dim), wp.float64)
    Block: Any = wp.types.matrix((dim, dim), wp.float64)
    load, position = records(dim, scalar).load, position_of(dim, scalar, compensated)
    evaluate, evaluate_wide, WideOwn = factory(dim, scalar), factory(dim, wp.float64), vector(width, wp.float64)

    @wp.struct
    class Elements:
        # Of each element:
        particle: wp.array2d(dtype=int)  # shape [element_count, points]
        own: wp.array(dtype=Own)  # shape [element_count]
        # By particle:
        first: wp.array(dtype=int)  # row starts of `entry`, shape [particle_count + 1]
        entry: wp.array(dtype=int)  # points · element + the particle's place in it

    @wp.func
    def sum_over_elements(data: Elements, now: Instant, i: int) -> V:
        total = V()
        for n in range(data.first[i], data.first[i + 1]):
            e = data.entry[n] / wp.static(points)
            x = Rows()
            v = Rows()
            for k in range(wp.static(points)):
                x[k] = position(now.compensation, now.x, data.particle[e, k])
                v[k] = load(now.v, data.particle[e, k])
            forces, _energy = evaluate(data.own[e], x, v)
            total += forces[data.entry[n] % wp.static(points)]
        return total

    @wp.func
    def projected(data: Elements, e: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows) -> scalar:
        forces, _energy = evaluate(data.own[e], x, v)
        along = scalar(0.0)
        for k in range(wp.static(points)):
            along += wp.dot(forces[k], phi[k])
        return along

    # By Gershgorin's theorem the sums of a row's magnitudes bound the eigenvalues of −∂F/∂x: at most √dim times.
    @kernel
    def add_element_blocks(
        data: Elements,
        rows: int,  # points · dim
        # State in, of one world:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # In and out, one block per particle, shape [particle_count]:
        stiffness: wp.array(dtype=Block),  # [N/m]
        damping: wp.array(dtype=Block),  # [N s/m]
    ):
        e = wp.tid()
        places = Rows()
        rates = Rows()
        for k in range(wp.static(points)):
            places[k] = x[data.particle[e, k]]
            rates[k] = v[data.particle[e, k]]
        for row in range(rows):
            k = row / wp.static(dim)
            d = row % wp.static(dim)
            phi = Rows()
            phi[k, d] = scalar(1.0)
            _data, _e, _t, _s, by_x, by_v, _phi = wp.grad(projected)(data, e, scalar(0.0), 0, places, rates, phi)
            stiff = Block()
            damped = Block()
            for j in range(wp.static(points)):
                for c in range(wp.static(dim)):
                    stiff[d, d] += wp.float64(0.5) * wp.abs(wp.float64(by_x[j, c]))
                    damped[d, d] += wp.float64(0.5) * wp.abs(wp.float64(by_v[j, c]))
            wp.atomic_add(stiffness, data.particle[e, k], stiff)
            wp.atomic_add(damping, data.particle[e, k], damped)

    @kernel
    def measure_elements(
        data: Elements,
        stride: int,  # particles from one world to the next
        # State in, of all worlds:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # Out, shape [worlds, element_count]:
        energy: wp.array2d(dtype=wp.float64),  # [J]
        power: wp.array2d(dtype=wp.float64),  # 0
    ):
        w, e = wp.tid()
        places = Wide()
        rates = Wide()
        for k in range(wp.static(points)):
            i = w * stride + data.particle[e, k]
            for c in range(wp.static(dim)):
                places[k, c] = wp.float64(x[i][c])
                rates[k, c] = wp.float64(v[i][c])
        _forces, stored = evaluate_wide(WideOwn(data.own[e]), places, rates)
        energy[w, e] = stored

    field = f"{factory.__module__.rpartition('.')[2]}_{factory.__name__}"
    term = ForceTerm(field, Elements, force=sum_over_elements, selective=True, works=not stores)
    law = ElementForce(projected=projected, points=points)
    return term, law, add_element_blocks, measure_elements
