"""Measures of a state, in float64 whatever the precision of the simulation: sums, and the strain of everything.

Every thread sums a share of its own, strided so that neighbours in memory are read together; the host adds the
shares. The order of sums is fixed, so a measure of a state is the same each time.
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..forces import Law, damper_force

KINETIC, POTENTIAL, MOMENTUM, ANGULAR_MOMENTUM = 0, 1, 2, 5
"""Columns of what `sum_particles` gives: one [J], one [J], three [kg m/s] and three [kg m²/s]."""
PARTICLE_COLUMNS = 8
ELASTIC, DISSIPATED, STRAIN = 0, 1, 2
"""Columns of what `sum_connections` gives: [J], [W] and a strain, which is the largest, not a sum."""
CONNECTION_COLUMNS = 3


@functools.cache
def sum_particles(dim: int, scalar: type):
    """Compose the kernel that sums over the particles that are not pinned."""
    V = vector(dim, scalar)

    @kernel
    def sum_over_particles(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        # Out:
        shares: wp.array2d(dtype=wp.float64),  # shape [thread_count, PARTICLE_COLUMNS]
    ):
        share = wp.tid()
        i = share
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        momenta = wp.vec3d()
        turns = wp.vec3d()
        while i < x.shape[0]:
            w = wp.float64(inverse_mass[i])
            if w > wp.float64(0.0):
                mass = wp.float64(1.0) / w
                position = wp.vec3d()
                momentum = wp.vec3d()
                fall = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    position[k] = wp.float64(x[i][k])
                    momentum[k] = mass * wp.float64(v[i][k])
                    fall += wp.float64(gravity[k]) * position[k]
                kinetic += wp.float64(0.5) * w * wp.dot(momentum, momentum)
                potential -= mass * fall
                momenta += momentum
                turns += wp.cross(position, momentum)
            i += shares.shape[0]
        shares[share, wp.static(KINETIC)] = kinetic
        shares[share, wp.static(POTENTIAL)] = potential
        for k in range(3):
            shares[share, wp.static(MOMENTUM) + k] = momenta[k]
            shares[share, wp.static(ANGULAR_MOMENTUM) + k] = turns[k]

    return sum_over_particles


@functools.cache
def sum_difference(dim: int, scalar: type):
    """Compose the kernel that sums ½ m |v − u|² over the particles that are not pinned."""
    V = vector(dim, scalar)

    @kernel
    def sum_differences(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        # State in:
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        u: wp.array(dtype=V),  # others [m/s], shape [particle_count]
        # Out:
        shares: wp.array2d(dtype=wp.float64),  # [J], shape [thread_count, 1]
    ):
        share = wp.tid()
        i = share
        total = wp.float64(0.0)
        while i < v.shape[0]:
            w = wp.float64(inverse_mass[i])
            if w > wp.float64(0.0):
                square = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    apart = wp.float64(v[i][k]) - wp.float64(u[i][k])
                    square += apart * apart
                total += wp.float64(0.5) * square / w
            i += shares.shape[0]
        shares[share, 0] = total

    return sum_differences


@functools.cache
def difference(dim: int, scalar: type, compensated: bool):
    """Compose `apart(x, x_lost, i, j)`, x[i] − x[j]; with `compensated` true positions are x − x_lost."""
    V = vector(dim, scalar)

    @wp.func
    def apart(x: wp.array(dtype=V), x_lost: wp.array(dtype=V), i: int, j: int) -> wp.vec3d:
        dx = wp.vec3d()
        for k in range(wp.static(dim)):
            dx[k] = wp.float64(x[i][k]) - wp.float64(x[j][k])
            if wp.static(compensated):
                dx[k] -= wp.float64(x_lost[i][k]) - wp.float64(x_lost[j][k])
        return dx

    return apart


@functools.cache
def sum_connections(dim: int, scalar: type, compensated: bool, law: Law, tears: bool = False):
    """Compose the kernel that sums over the connections; with `compensated` true positions are x − x_lost.

    With `tears` true those that have neither stiffness nor damping are broken: their strain is nobody's.
    """
    V, resistance = vector(dim, scalar), damper_force(wp.float64, law)
    apart = difference(dim, scalar, compensated)

    @kernel
    def sum_over_connections(
        # Model:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # l0 [m], shape [connection_count]
        stiffness: wp.array(dtype=scalar),  # k [N/m], shape [connection_count]
        damping: wp.array(dtype=scalar),  # b in the units of the law, shape [connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        x_lost: wp.array(dtype=V),  # what positions have lost by rounding [m], shape [particle_count]
        # Out:
        shares: wp.array2d(dtype=wp.float64),  # shape [thread_count, CONNECTION_COLUMNS]
    ):
        share = wp.tid()
        c = share
        half = wp.float64(0.5)
        elastic = wp.float64(0.0)
        dissipated = wp.float64(0.0)
        strain = wp.float64(0.0)
        while c < connections.shape[0]:
            i = connections[c][0]
            j = connections[c][1]
            rest = wp.float64(rest_length[c])
            dx = apart(x, x_lost, i, j)
            closing = wp.float64(0.0)
            for k in range(wp.static(dim)):
                closing += dx[k] * (wp.float64(v[i][k]) - wp.float64(v[j][k]))
            length = wp.length(dx)
            stretch = length - rest
            elastic += half * wp.float64(stiffness[c]) * stretch * stretch
            if length > wp.float64(0.0):
                rate = closing / length
                dissipated += resistance(rate, wp.float64(damping[c])) * rate
            if wp.static(tears):
                if stiffness[c] == scalar(0.0) and damping[c] == scalar(0.0):
                    stretch = wp.float64(0.0)
            strain = wp.max(strain, wp.abs(stretch) / rest)
            c += shares.shape[0]
        shares[share, wp.static(ELASTIC)] = elastic
        shares[share, wp.static(DISSIPATED)] = dissipated
        shares[share, wp.static(STRAIN)] = strain

    return sum_over_connections


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
def take(scalar: type):
    """Compose the kernel that copies some numbers."""

    @kernel
    def take_each(
        numbers: wp.array(dtype=scalar),
        index: wp.array(dtype=int),  # which, shape [count]
        # Out:
        taken: wp.array(dtype=scalar),  # shape [count]
    ):
        k = wp.tid()
        taken[k] = numbers[index[k]]

    return take_each


@functools.cache
def strain_each(dim: int, scalar: type, compensated: bool, sorted_anew: bool):
    """Compose the kernel, over connections, that writes length / rest length − 1.

    With `sorted_anew` true the device has connections in an order of its own, and the strain of its connection c
    is written at place[c].
    """
    V = vector(dim, scalar)
    apart = difference(dim, scalar, compensated)

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
        length = wp.length(apart(x, x_lost, connections[c][0], connections[c][1]))
        at = c
        if wp.static(sorted_anew):
            at = place[c]
        strain[at] = scalar(length / wp.float64(rest_length[c]) - wp.float64(1.0))

    return strain_of_each
