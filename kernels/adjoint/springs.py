"""The adjoint of spring forces: what a change of each position, velocity and constant does to a loss.

With φ_i the derivative of the loss by the force on particle i, a spring between i and j with the force F on i, and
−F on j, adds (∂F/∂Δx)ᵀ (φ_i − φ_j) to the derivative by x_i, and minus that to the one by x_j; likewise for
velocities. So the adjoint of a gather is a gather: no atomics, and sums in a fixed order.
"""

import functools
from typing import NamedTuple

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..springs.dampers import LINEAR, damper_force
from ..springs.gather import SLICE
from ..springs.law import TINY, inverse_root
from ..springs.spring_laws import Laws, spring_stress


class Wanted(NamedTuple):
    """Which constants of springs a gradient is wanted by; others are not summed."""

    rest_length: bool = False
    stiffness: bool = False
    damping: bool = False
    strain: bool = False
    """Of actuators."""


@functools.cache
def projected_force(dim: int, scalar: type, laws: Laws):
    """Compose ψ·F for the force F of a spring on its first particle: its gradient is the adjoint of F.

    It is the law of `springs.law`, in operations that Warp can differentiate. `strain` is an actuator's, else 0.
    """
    V, (damper, spring) = vector(dim, scalar), laws
    stress = None if spring is None else spring_stress(scalar, spring)
    resistance, slack, own = damper_force(scalar, damper or LINEAR), laws.slacken, laws.own_damper
    tiny = TINY[scalar]

    @wp.func
    def projected(
        dx: V, dv: V, psi: V, rest_length: scalar, stiffness: scalar, damping: scalar, strain: scalar
    ) -> scalar:
        length = wp.sqrt(wp.dot(dx, dx) + scalar(tiny))
        pull = stiffness * (length - rest_length)
        if wp.static(spring is not None):
            pull = stiffness * rest_length * stress(length / rest_length - scalar(1.0))
        pull -= stiffness * rest_length * strain
        if wp.static(damper is not None):
            if wp.static(own is None):
                resisting = resistance(wp.dot(dv, dx) / length, damping)
            else:
                resisting = own(length / rest_length - scalar(1.0), wp.dot(dv, dx) / length, damping)
            if wp.static(slack):
                if length < rest_length:
                    resisting = scalar(0.0)
            pull += resisting
        return -(pull / length) * wp.dot(psi, dx)

    return projected


@functools.cache
def linear_adjoint(dim: int, scalar: type, damped: bool):
    """Compose the gradient of `projected_force` of the report's spring by hand: half the operations.

    It returns (∂/∂Δx, ∂/∂Δv, along, stretch, rate) with along = ψ·axis, from which those by the constants follow.
    With u = 1/|Δx| the force is −q Δx, q = k − (k l0 − b l') u, so ∂(ψ·F)/∂Δx = −q ψ − (ψ·Δx) ∂q/∂Δx.
    """
    V, tiny, rsqrt = vector(dim, scalar), TINY[scalar], inverse_root(scalar)

    @wp.func
    def adjoint(dx: V, dv: V, psi: V, rest_length: scalar, stiffness: scalar, damping: scalar, strain: scalar):
        square = wp.dot(dx, dx)
        inverse = rsqrt(square + scalar(tiny))
        along = wp.dot(psi, dx) * inverse
        rest = rest_length * (scalar(1.0) + strain)
        pull = stiffness * rest
        bent = along * inverse
        rate = scalar(0.0)
        by_dv = V()
        if wp.static(damped):
            rate = wp.dot(dv, dx) * inverse
            held = damping * rate
            by_dv = -(damping * bent) * dx
            q = stiffness - (pull - held) * inverse
            by_dx = -q * psi - (bent * inverse * (pull - held - held)) * dx - (damping * bent) * dv
        else:
            q = stiffness - pull * inverse
            by_dx = -q * psi - (bent * inverse * pull) * dx
        return by_dx, by_dv, along, square * inverse - rest, rate

    return adjoint


@functools.cache
def derivatives(dim: int, scalar: type, laws: Laws):
    """Compose the derivatives of ψ·F of a spring, by Δx, Δv, rest length, stiffness, damping and strain."""
    V, (damper, spring) = vector(dim, scalar), laws
    plain = spring is None and damper in (None, LINEAR)
    projected, by_hand = projected_force(dim, scalar, laws), linear_adjoint(dim, scalar, damper is not None)

    @wp.func
    def derive(dx: V, dv: V, psi: V, rest_length: scalar, stiffness: scalar, damping: scalar, strain: scalar):
        if wp.static(plain):
            by_dx, by_dv, along, stretch, rate = by_hand(dx, dv, psi, rest_length, stiffness, damping, strain)
            by_rest_length = along * stiffness * (scalar(1.0) + strain)
            by_stiffness = -along * stretch
            by_damping = -along * rate
            by_strain = along * stiffness * rest_length
        else:
            by_dx, by_dv, _psi, by_rest_length, by_stiffness, by_damping, by_strain = wp.grad(projected)(
                dx, dv, psi, rest_length, stiffness, damping, strain
            )
        return by_dx, by_dv, by_rest_length, by_stiffness, by_damping, by_strain

    return derive


@functools.cache
def keeping(scalar: type, wanted: Wanted):
    """Compose the function that adds to the derivatives by entry c of the constants that are wanted."""
    Numbers = wp.array(dtype=scalar)

    @wp.func
    def keep(
        c: int,
        by_rest_length: scalar,
        by_stiffness: scalar,
        by_damping: scalar,
        rest_length: Numbers,
        stiffness: Numbers,
        damping: Numbers,
    ):
        if wp.static(wanted.rest_length):
            rest_length[c] = rest_length[c] + by_rest_length
        if wp.static(wanted.stiffness):
            stiffness[c] = stiffness[c] + by_stiffness
        if wp.static(wanted.damping):
            damping[c] = damping[c] + by_damping

    return keep


@functools.cache
def gather_adjoint(dim: int, scalar: type, laws: Laws, wanted: Wanted, actuated: bool):
    """Compose the kernel, over particles, of the adjoint of spring forces, by a table of neighbours.

    The constants' derivatives are written by the first particle of a spring. Those by strains of actuators are
    sums over their springs, by atomics.
    """
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)
    damped, own = laws.damper is not None, any(wanted)
    derive, keep = derivatives(dim, scalar, laws), keeping(scalar, wanted)

    @wp.func
    def strain_of(column: wp.array(dtype=int), strain: wp.array2d(dtype=scalar), stage: int, c: int) -> scalar:
        s = scalar(0.0)
        if column[c] >= 0:
            s = strain[stage, column[c]]
        return s

    @wp.func
    def add_strain(
        column: wp.array(dtype=int), by_strain: wp.array2d(dtype=scalar), stage: int, c: int, by_s: scalar
    ):
        if wp.static(wanted.strain):
            if column[c] >= 0:
                wp.atomic_add(by_strain, stage, column[c], by_s)

    @kernel
    def add_gather_adjoint(
        # The table of neighbours, see `springs.gather`:
        first: wp.array(dtype=int),
        other: wp.array(dtype=int),
        connection: wp.array(dtype=int),
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # [m], shape [connection_count]
        stiffness: wp.array(dtype=scalar),  # [N/m]
        damping: wp.array(dtype=scalar),  # in the units of the law
        column: wp.array(dtype=int),  # of `strain` for each connection, −1 without an actuator
        strain: wp.array2d(dtype=scalar),  # of actuators, in each stage of a frame
        stage: int,
        by_strain: wp.array2d(dtype=scalar),  # derivatives, in and out
        # State, at which the forces were evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # derivative by the force on each particle
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_rest_length: wp.array(dtype=scalar),  # shape [connection_count]
        by_stiffness: wp.array(dtype=scalar),
        by_damping: wp.array(dtype=scalar),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        i = begin + wp.tid()
        while i < end:
            x_i = load(x, i)
            phi_i = load(phi, i)
            v_i = V()
            dv = V()
            if wp.static(damped):
                v_i = load(v, i)
            sum_x = V()
            sum_v = V()
            part = i / wp.static(SLICE)
            slot = first[part] + i % wp.static(SLICE)
            last = first[part + 1]
            while slot < last:
                c = connection[slot]
                if c >= 0:
                    j = other[slot]
                    if wp.static(damped):
                        dv = v_i - load(v, j)
                    b = scalar(0.0)
                    if wp.static(damped):
                        b = damping[c]
                    s = scalar(0.0)
                    if wp.static(actuated):
                        s = strain_of(column, strain, stage, c)
                    by_dx, by_dv, by_rest, by_k, by_b, by_s = derive(
                        x_i - load(x, j), dv, phi_i - load(phi, j), rest_length[c], stiffness[c], b, s
                    )
                    sum_x += by_dx
                    sum_v += by_dv
                    if wp.static(own):
                        if connections[c][0] == i:
                            keep(c, by_rest, by_k, by_b, by_rest_length, by_stiffness, by_damping)
                            add_strain(column, by_strain, stage, c, by_s)
                slot += wp.static(SLICE)
            store(by_x, i, load(by_x, i) + sum_x)
            if wp.static(damped):
                store(by_v, i, load(by_v, i) + sum_v)
            i += threads

    return add_gather_adjoint


@functools.cache
def stencil_adjoint(dim: int, scalar: type, laws: Laws, wanted: Wanted):
    """Compose the kernel of the same for a uniform lattice, whose neighbours need no table.

    The derivatives by constants have an entry for each direction from each particle: d · particle_count + i.
    """
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)
    damped, own = laws.damper is not None, any(wanted)
    derive, keep = derivatives(dim, scalar, laws), keeping(scalar, wanted)
    Three = vector(3, scalar)

    @kernel
    def add_stencil_adjoint(
        mask: wp.array(dtype=wp.uint32),  # neighbours of each particle, as bits
        offset: wp.array(dtype=int),  # to the neighbour of each bit, shape [2 directions]
        constants: wp.array(dtype=Three),  # rest length, stiffness and damping, shape [2 directions]
        # State, at which the forces were evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # derivative by the force on each particle
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_rest_length: wp.array(dtype=scalar),
        by_stiffness: wp.array(dtype=scalar),
        by_damping: wp.array(dtype=scalar),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        i = begin + wp.tid()
        while i < end:
            x_i = load(x, i)
            phi_i = load(phi, i)
            v_i = V()
            dv = V()
            if wp.static(damped):
                v_i = load(v, i)
            sum_x = V()
            sum_v = V()
            neighbours = mask[i]
            for k in range(offset.shape[0]):  # not unrolled: that takes a GPU three times as long
                if (neighbours & (wp.uint32(1) << wp.uint32(k))) != wp.uint32(0):
                    j = i + offset[k]
                    spring = constants[k]
                    if wp.static(damped):
                        dv = v_i - load(v, j)
                    dx = x_i - load(x, j)
                    psi = phi_i - load(phi, j)
                    by_dx, by_dv, by_rest, by_k, by_b, _strain = derive(
                        dx, dv, psi, spring[0], spring[1], spring[2], scalar(0.0)
                    )
                    sum_x += by_dx
                    sum_v += by_dv
                    if wp.static(own):
                        if 2 * k < offset.shape[0]:
                            c = k * x.shape[0] + i
                            keep(c, by_rest, by_k, by_b, by_rest_length, by_stiffness, by_damping)
            store(by_x, i, load(by_x, i) + sum_x)
            if wp.static(damped):
                store(by_v, i, load(by_v, i) + sum_v)
            i += threads

    return add_stencil_adjoint
