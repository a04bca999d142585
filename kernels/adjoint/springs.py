"""The adjoint of spring forces: derivatives of a loss L with respect to positions, velocities and constants.

With φ_i = ∂L/∂F_i for particle i, a spring with the force F on i and −F on j adds (∂F/∂Δx)ᵀ (φ_i − φ_j) to
∂L/∂x_i, and subtracts it from ∂L/∂x_j; likewise for velocities. So the adjoint of a gather is a gather, without
atomics, and with sums in a fixed order.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..springs.dampers import LINEAR, damper_force, law_data, law_numbers
from ..springs.force_algorithm import velocity_of
from ..springs.gather import SLICE
from ..springs.lanes import sum_over_lanes
from ..springs.law import TINY, inverse_root
from ..springs.spring_laws import Laws, spring_stress
from .kick import AdjointData, kick_back


class Wanted(NamedTuple):
    """The constants of springs with respect to which derivatives are computed."""

    rest_length: bool = False
    stiffness: bool = False
    damping: bool = False
    strain: bool = False
    """The strain of actuators."""


@functools.cache
def projected_force(dim: int, scalar: type, laws: Laws):
    """Compose ψ·F for the force F of a spring on its first particle: its gradient is the adjoint of F.

    It is the law of `springs.law`, in operations that Warp can differentiate. `own` are rest length,
    stiffness and damping, `actuated` is the strain of an actuator, or 0.
    """
    V, Three, Numbers, (damper, spring, _) = vector(dim, scalar), vector(3, scalar), law_numbers(scalar), laws
    stress, resistance = spring_stress(scalar, spring or LINEAR), damper_force(scalar, laws)
    tiny = TINY[scalar]

    @wp.func
    def projected(dx: V, dv: V, psi: V, own: Three, actuated: scalar, law: Numbers) -> scalar:
        length = wp.sqrt(wp.dot(dx, dx) + scalar(tiny))
        strain = length / own[0] - scalar(1.0)
        pull = own[1] * (length - own[0])
        if wp.static(spring is not None):
            pull = own[1] * own[0] * stress(strain, law)
        if wp.static(damper is not None):
            pull += resistance(strain, wp.dot(dv, dx) / length, own[2], pull, law)
        pull -= own[1] * own[0] * actuated
        return -(pull / length) * wp.dot(psi, dx)

    return projected


@functools.cache
def linear_adjoint(dim: int, scalar: type, damped: bool):
    """Compose the gradient of `projected_force` of linear springs and dampers by hand: half the operations.

    It returns the derivatives by Δx, Δv, the constants and the strain of an actuator. With u = 1/|Δx| the force is
    −q Δx, q = k − (k l0 − b l') u, so ∂(ψ·F)/∂Δx = −q ψ − (ψ·Δx) ∂q/∂Δx.
    """
    V, Three, tiny, rsqrt = vector(dim, scalar), vector(3, scalar), TINY[scalar], inverse_root(scalar)

    @wp.func
    def adjoint(dx: V, dv: V, psi: V, own: Three, actuated: scalar):
        square = wp.dot(dx, dx)
        inverse = rsqrt(square + scalar(tiny))
        along = wp.dot(psi, dx) * inverse
        rest = own[0] * (scalar(1.0) + actuated)
        pull = own[1] * rest
        bent = along * inverse
        rate = scalar(0.0)
        by_dv = V()
        if wp.static(damped):
            rate = wp.dot(dv, dx) * inverse
            held = own[2] * rate
            by_dv = -(own[2] * bent) * dx
            q = own[1] - (pull - held) * inverse
            by_dx = -q * psi - (bent * inverse * (pull - held - held)) * dx - (own[2] * bent) * dv
        else:
            q = own[1] - pull * inverse
            by_dx = -q * psi - (bent * inverse * pull) * dx
        by_rest_length = along * own[1] * (scalar(1.0) + actuated)
        by_own = Three(by_rest_length, -along * (square * inverse - rest), -along * rate)
        return by_dx, by_dv, by_own, along * own[1] * own[0]

    return adjoint


class Neighbours(NamedTuple):
    """How the adjoint finds the springs of a particle."""

    Table: Any
    """Struct type of the table."""
    range_of: Any
    """wp.func (table, i) -> (first, step, last): the slots of particle i."""
    look: Any
    """wp.func (table, i, slot) -> (whether it holds a spring, its other particle, its entry among constants)."""
    spring_of: Any
    """wp.func (table, slot, c) -> rest length, stiffness and damping of entry c."""
    owns: Any
    """wp.func (table, i, slot, c) -> whether particle i writes the derivatives by entry c."""
    strain_of: Any = None
    """wp.func (table, stage, i, slot) -> the strain of an actuator; None without actuators."""


@functools.cache
def in_table(scalar: type, laws: Laws, in_worlds: bool) -> Neighbours:
    """Return neighbours that are found in a table, for every system (see `springs.gather`).

    In an ensemble the table is that of a world, and the particles of worlds are `stride` apart. The derivatives by
    constants have an entry for each spring of each world: w · connection_count + c.
    """
    Three, damped = vector(3, scalar), laws.damper is not None

    @wp.struct
    class Table:
        # Of a world:
        first: wp.array(dtype=int)
        other: wp.array(dtype=int)
        connection: wp.array(dtype=int)
        connections: wp.array(dtype=wp.vec2i)  # two particles each, shape [connection_count]
        column: wp.array(dtype=int)  # of `strain` for each connection, −1 without an actuator
        columns: int  # of a world; world w has those from w · columns on, mod the number of all
        strain: wp.array2d(dtype=scalar)  # of actuators, in each stage of a frame
        particle_count: int
        stride: int
        # Shared by all worlds, or concatenated by world:
        rest_length: wp.array(dtype=scalar)  # [m]
        stiffness: wp.array(dtype=scalar)  # [N/m]
        damping: wp.array(dtype=scalar)  # in the units of the law
        differs: wp.vec3i  # 0 for each of these three that is shared, else 1
        if not laws.linear:
            law: law_data(scalar, laws)
        if laws.several:
            number: wp.array(dtype=wp.uint8)  # of its law, shape [connection_count]

    @wp.func
    def world_of(table: Table, i: int) -> int:
        w = int(0)
        if wp.static(in_worlds):
            w = i / table.stride
        return w

    @wp.func
    def range_of(table: Table, i: int):
        own = i - world_of(table, i) * table.stride
        part = own / wp.static(SLICE)
        first = int(0)
        last = int(0)
        if own < table.particle_count:
            first = table.first[part] + own % wp.static(SLICE)
            last = table.first[part + 1]
        return first, wp.static(SLICE), last

    @wp.func
    def look(table: Table, i: int, slot: int):
        c = table.connection[slot]
        w = world_of(table, i)
        return c >= 0, w * table.stride + table.other[slot], w * table.connections.shape[0] + c

    @wp.func
    def spring_of(table: Table, slot: int, c: int) -> Three:
        at = wp.vec3i(c, c, c)
        if wp.static(in_worlds):
            own = table.connection[slot]
            at = wp.vec3i(own, own, own) + (c - own) * table.differs
        b = scalar(0.0)
        if wp.static(damped):
            b = table.damping[at[2]]
        return Three(table.rest_length[at[0]], table.stiffness[at[1]], b)

    @wp.func
    def owns(table: Table, i: int, slot: int, c: int) -> bool:
        return table.connections[table.connection[slot]][0] == i - world_of(table, i) * table.stride

    @wp.func
    def strain_of(table: Table, stage: int, i: int, slot: int) -> scalar:
        s = scalar(0.0)
        column = table.column[table.connection[slot]]
        if column >= 0:
            if wp.static(in_worlds):
                column += world_of(table, i) * table.columns % table.strain.shape[1]
            s = table.strain[stage, column]
        return s

    return Neighbours(Table, range_of, look, spring_of, owns, strain_of)


@functools.cache
def in_lattice(scalar: type, laws: Laws) -> Neighbours:
    """Return the neighbours in a uniform lattice, which need no table.

    The derivatives by constants have an entry for each direction from each particle: d · particle_count + i.
    """
    Three = vector(3, scalar)

    @wp.struct
    class Table:
        mask: wp.array(dtype=wp.uint32)  # neighbours of each particle, as bits
        offset: wp.array(dtype=int)  # to the neighbour of each bit, shape [2 directions]
        constants: wp.array(dtype=Three)  # rest length, stiffness and damping, shape [2 directions]
        if not laws.linear:
            law: law_numbers(scalar)

    @wp.func
    def range_of(table: Table, i: int):
        return 0, 1, table.offset.shape[0]

    @wp.func
    def look(table: Table, i: int, slot: int):
        exists = (table.mask[i] & (wp.uint32(1) << wp.uint32(slot))) != wp.uint32(0)
        return exists, i + table.offset[slot], slot * table.mask.shape[0] + i

    @wp.func
    def spring_of(table: Table, slot: int, c: int) -> Three:
        return table.constants[slot]

    @wp.func
    def owns(table: Table, i: int, slot: int, c: int) -> bool:
        return 2 * slot < table.offset.shape[0]

    return Neighbours(Table, range_of, look, spring_of, owns)


@functools.cache
def keeping(dim: int, scalar: type, wanted: Wanted):
    """Compose the function that adds a spring's derivatives to entry c of those by each wanted constant."""
    Data, Three = AdjointData(dim, scalar), vector(3, scalar)

    @wp.func
    def keep(data: Data, c: int, own: Three, strain: scalar):
        if wp.static(wanted.rest_length):
            data.by_rest_length[c] = data.by_rest_length[c] + own[0]
        if wp.static(wanted.stiffness):
            data.by_stiffness[c] = data.by_stiffness[c] + own[1]
        if wp.static(wanted.damping):
            data.by_damping[c] = data.by_damping[c] + own[2]
        if wp.static(wanted.strain):
            data.by_strain[c] = data.by_strain[c] + strain

    return keep


@functools.cache
def springs_adjoint(
    dim: int, scalar: type, laws: Laws, wanted: Wanted, neighbours: Neighbours, lanes: int, actuated: bool
):
    """Compose the kernel, over particles and their lanes, of the adjoint of spring forces.

    Each of n lanes takes every n-th neighbour (see `springs.lanes`). One particle of a spring writes the
    derivatives by its constants. In the same launch derivatives are propagated back through the kick and the drift
    of the substep before (`kick_back`).
    """
    V, Data, (load, store, _) = vector(dim, scalar), AdjointData(dim, scalar), records(dim, scalar)
    damped, own = laws.damper is not None, any(wanted)
    velocity = velocity_of(dim, scalar, damped)
    derive, projected = linear_adjoint(dim, scalar, damped), projected_force(dim, scalar, laws)
    keep, propagate = keeping(dim, scalar, wanted), kick_back(dim, scalar)
    sum_of_lanes = sum_over_lanes(dim, scalar, lanes)
    Table, range_of, look, spring_of, owns, strain_of = neighbours

    @kernel
    def add_springs_adjoint(
        data: Data,
        table: Table,
        stage: int,
        # State, at which the forces were evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # ∂L/∂F of each particle
        # The substep before, for `kick_back`; 0 for none:
        drift: scalar,
        kick: scalar,
        v_before: wp.array(dtype=V),
        phi_before: wp.array(dtype=V),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch, over lanes
    ):
        lane = wp.tid() % wp.static(lanes)
        i = begin + wp.tid() / wp.static(lanes)
        while i < end:
            x_i = load(x, i)
            phi_i = load(phi, i)
            v_i = velocity(v, i)
            sum_x = V()
            sum_v = V()
            slot, step, last = range_of(table, i)
            slot += lane * step
            while slot < last:
                exists, j, c = look(table, i, slot)
                if exists:
                    spring = spring_of(table, slot, c)
                    dv = v_i - velocity(v, j)
                    s = scalar(0.0)
                    if wp.static(actuated):
                        s = strain_of(table, stage, i, slot)
                    dx = x_i - load(x, j)
                    psi = phi_i - load(phi, j)
                    if wp.static(laws.linear):
                        by_dx, by_dv, by_own, by_s = derive(dx, dv, psi, spring, s)
                    else:
                        if wp.static(laws.several):
                            law = table.law[int(table.number[table.connection[slot]])]
                        else:
                            law = table.law
                        by_dx, by_dv, _psi, by_own, by_s, _law = wp.grad(projected)(dx, dv, psi, spring, s, law)
                    sum_x += by_dx
                    sum_v += by_dv
                    if wp.static(own):
                        if owns(table, i, slot, c):
                            keep(data, c, by_own, by_s)
                slot += wp.static(lanes) * step
            sum_x = sum_of_lanes(sum_x)
            sum_v = sum_of_lanes(sum_v)
            if lane == 0:
                back_x = load(data.by_x, i) + sum_x
                store(data.by_x, i, back_x)
                back = load(data.by_v, i) + sum_v + drift * back_x
                store(data.by_v, i, back)
                store(phi_before, i, propagate(data, i, kick, back, v_before, v))
            i += threads / wp.static(lanes)

    return add_springs_adjoint
