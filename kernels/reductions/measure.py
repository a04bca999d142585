"""Measures of a state, in float64 whatever the precision of the simulation: sums, and the strain of everything.

The order of sums is fixed, so a measure of a state is the same each time.
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..springs import Law, damper_force
from .columns import COLUMNS, NONE
from .divergence import add_up, free_energies


@functools.cache
def difference(dim: int, scalar: type, compensated: bool):
    """Compose `separation(x, x_lost, i, j)`, x[i] − x[j]; with `compensated` true positions are x − x_lost."""
    V = vector(dim, scalar)

    @wp.func
    def separation(x: wp.array(dtype=V), x_lost: wp.array(dtype=V), i: int, j: int) -> wp.vec3d:
        dx = wp.vec3d()
        for k in range(wp.static(dim)):
            dx[k] = wp.float64(x[i][k]) - wp.float64(x[j][k])
            if wp.static(compensated):
                dx[k] -= wp.float64(x_lost[i][k]) - wp.float64(x_lost[j][k])
        return dx

    return separation


@functools.cache
def sum_up(dim: int, scalar: type, compensated: bool, law: Law, tears: bool, chosen: bool):
    """Compose the kernel that finds all that is asked of a state, in all of `columns`.

    With `compensated` true positions are x − x_lost where lengths are computed. With `tears` true connections that
    have neither stiffness nor damping are broken: their strain is nobody's; with `substep_history` true that of
    others too.
    """
    V, resistance, energies_of = vector(dim, scalar), damper_force(wp.float64, law), free_energies(dim, scalar)
    separation, add_up_columns = difference(dim, scalar, compensated), add_up(COLUMNS)
    load, Columns = records(dim, scalar).load, wp.types.vector(COLUMNS, wp.float64)

    def sum_up_state(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # l0 [m], shape [connection_count]
        stiffness: wp.array(dtype=scalar),  # k [N/m], shape [connection_count]
        damping: wp.array(dtype=scalar),  # b in the units of the law, shape [connection_count]
        counts: wp.array(dtype=wp.uint8),  # whether its strain does, shape [connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        x_lost: wp.array(dtype=V),  # what positions have lost by rounding [m], shape [particle_count]
        u: wp.array(dtype=V),  # velocities as the method has them [m/s], shape [particle_count]
        v: wp.array(dtype=V),  # those at the instant of the positions [m/s], shape [particle_count]
        work: wp.array(dtype=wp.float64),  # to be added up [J], shape [any]
        # Between:
        threads: int,  # how many there are
        blocks: wp.array2d(dtype=wp.float64),  # what each has found, shape [COLUMNS, block_count]
        done: wp.array(dtype=int),  # how many blocks are; 0 before and after; shape [1]
        # Out:
        found: wp.array(dtype=wp.float64),  # shape [COLUMNS]
    ):
        i = wp.tid()
        first = int(wp.static(NONE))
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        mean = wp.float64(0.0)
        swing = wp.float64(0.0)
        momenta = wp.vec3d()
        turns = wp.vec3d()
        while i < x.shape[0]:
            x_i = load(x, i)
            u_i = load(u, i)
            if not (wp.isfinite(x_i) and wp.isfinite(u_i)):
                first = wp.min(first, i)
            moves, falls = energies_of(inverse_mass[i], gravity, x_i, u_i)
            kinetic += moves
            potential += falls
            w = wp.float64(inverse_mass[i])
            if w > wp.float64(0.0):
                v_i = load(v, i)
                mass = wp.float64(1.0) / w
                position = wp.vec3d()
                momentum = wp.vec3d()
                square = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    position[k] = wp.float64(x_i[k])
                    momentum[k] = mass * wp.float64(v_i[k])
                    ahead = wp.float64(v_i[k]) - wp.float64(u_i[k])
                    square += ahead * ahead
                mean += wp.float64(0.5) * w * wp.dot(momentum, momentum)
                swing += wp.float64(0.5) * mass * square
                momenta += momentum
                turns += wp.cross(position, momentum)
            i += threads
        done_work = wp.float64(0.0)
        i = wp.tid()
        while i < work.shape[0]:
            done_work += work[i]
            i += threads
        c = wp.tid()
        elastic = wp.float64(0.0)
        dissipated = wp.float64(0.0)
        strain = wp.float64(0.0)
        while c < connections.shape[0]:
            i = connections[c][0]
            j = connections[c][1]
            rest = wp.float64(rest_length[c])
            dx = separation(x, x_lost, i, j)
            closing = wp.float64(0.0)
            for k in range(wp.static(dim)):
                closing += dx[k] * (wp.float64(v[i][k]) - wp.float64(v[j][k]))
            length = wp.length(dx)
            stretch = length - rest
            elastic += wp.float64(0.5) * wp.float64(stiffness[c]) * stretch * stretch
            if length > wp.float64(0.0):
                rate = closing / length
                dissipated += resistance(rate, wp.float64(damping[c])) * rate
            if wp.static(tears):
                if stiffness[c] == scalar(0.0) and damping[c] == scalar(0.0):
                    stretch = wp.float64(0.0)
            if wp.static(chosen):
                if counts[c] == wp.uint8(0):
                    stretch = wp.float64(0.0)
            strain = wp.max(strain, wp.abs(stretch) / rest)
            c += threads
        own = Columns(
            -wp.float64(first),
            strain,
            kinetic,
            potential,
            done_work,
            mean,
            swing,
            momenta[0],
            momenta[1],
            momenta[2],
            turns[0],
            turns[1],
            turns[2],
            elastic,
            dissipated,
        )
        add_up_columns(own, blocks, done, found)

    return kernel(sum_up_state, grid_stride=False)


@kernel
def fold(
    shares: wp.array2d(dtype=wp.float64),  # shape [thread_count, columns]
    largest: int,  # the column of which the largest is wanted, not the sum; -1: none
    first: int,  # the column of the rows that the first one goes to
    rows: wp.array2d(dtype=wp.float64),  # of each row a share, in an order that is the same each time
):
    """Sum the shares of many threads to a few rows, by a thread for each entry."""
    row, column = wp.tid()
    total = wp.float64(0.0)
    share = row
    while share < shares.shape[0]:
        if column == largest:
            total = wp.max(total, shares[share, column])
        else:
            total += shares[share, column]
        share += rows.shape[0]
    rows[row, first + column] = total


@kernel
def put_in_order(
    values: wp.array(dtype=wp.float32),  # in the order of the device, shape [connection_count]
    place: wp.array(dtype=int),  # where that of each goes, shape [connection_count]
    # Out:
    result: wp.array(dtype=wp.float32),  # shape [connection_count]
):
    """Write what connections have in another order."""
    c = wp.tid()
    result[place[c]] = values[c]


@functools.cache
def strain_each(dim: int, scalar: type, compensated: bool, sorted_anew: bool):
    """Compose the kernel, over connections, that writes length / rest length − 1.

    With `sorted_anew` true the device has connections in an order of its own, and the strain of its connection c
    is written at place[c].
    """
    V = vector(dim, scalar)
    separation = difference(dim, scalar, compensated)

    @kernel
    def strain_of_each(
        # Model:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # l0 [m], shape [connection_count]
        place: wp.array(dtype=int),  # where the strain of each goes, shape [connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        x_lost: wp.array(dtype=V),  # what positions have lost by rounding [m], shape [particle_count]
        # Out:
        strain: wp.array(dtype=scalar),  # shape [connection_count]
    ):
        c = wp.tid()
        length = wp.length(separation(x, x_lost, connections[c][0], connections[c][1]))
        at = c
        if wp.static(sorted_anew):
            at = place[c]
        strain[at] = scalar(length / wp.float64(rest_length[c]) - wp.float64(1.0))

    return strain_of_each
