"""Sums over groups for probes, in float64. Each thread sums a share; the order of additions is fixed."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from .measure import difference

SUM, LARGEST, COUNT = 0, 1, 2
"""Columns of `sum_strain`: the sum of strains, the largest absolute value, and the number of connections."""
STRAIN_COLUMNS = 3


@functools.cache
def sum_of_group(dim: int, Vector: Any, compensated: bool):
    """Compose the kernel, over worlds and threads, that sums values of a group's particles by their weights."""

    @kernel
    def sum_over_group(
        weight: wp.array2d(dtype=wp.float64),  # weight of each member, shape [rows, member_count]
        member: wp.array(dtype=int),  # the particles of the group, shape [member_count]
        value: wp.array(dtype=Vector),  # of the particles of all worlds
        compensation: wp.array(dtype=Vector),  # compensation of these
        stride: int,  # from one world to the next, in particles
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, dim]
    ):
        w, share = wp.tid()
        total = wp.vec3d()
        m = share
        while m < member.shape[0]:
            i = w * stride + member[m]
            for k in range(wp.static(dim)):
                one = wp.float64(value[i][k])
                if wp.static(compensated):
                    one -= wp.float64(compensation[i][k])
                total[k] += weight[w % weight.shape[0], m] * one
            m += shares.shape[1]
        for k in range(wp.static(dim)):
            shares[w, share, k] = total[k]

    return sum_over_group


@functools.cache
def mean_of_function(dim: int, scalar: type, compensated: bool, function: Any, width: int):
    """Compose the kernel, over worlds and threads, that sums a function of a group's particles.

    The function is a wp.func (x, v, i) of a particle's position, velocity and index. Its arguments are float64,
    corrected for rounding in compensated precision. It returns a vector of `width` numbers, or one number for 0.
    """
    V, Wide = vector(dim, scalar), vector(dim, wp.float64)
    columns = max(width, 1)

    @kernel
    def mean_of_each(
        member: wp.array(dtype=int),  # the particles of the group, shape [member_count]
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        v: wp.array(dtype=V),  # velocities [m/s]
        x_lost: wp.array(dtype=V),  # compensation of these
        v_lost: wp.array(dtype=V),
        stride: int,  # from one world to the next, in particles
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, columns]
    ):
        w, share = wp.tid()
        weight = wp.float64(1.0) / wp.float64(member.shape[0])
        for k in range(wp.static(columns)):
            shares[w, share, k] = wp.float64(0.0)
        m = share
        while m < member.shape[0]:
            at = w * stride + member[m]
            place = Wide(x[at])
            speed = Wide(v[at])
            if wp.static(compensated):
                place = place - Wide(x_lost[at])
                speed = speed - Wide(v_lost[at])
            result = function(place, speed, member[m])
            if wp.static(width == 0):
                shares[w, share, 0] = shares[w, share, 0] + weight * result
            else:
                for k in range(wp.static(columns)):
                    shares[w, share, k] = shares[w, share, k] + weight * result[k]
            m += shares.shape[1]

    return mean_of_each


@functools.cache
def sum_strain(dim: int, scalar: type, compensated: bool, tears: bool):
    """Compose the kernel, over worlds and threads, that sums the strains of chosen unbroken connections."""
    V = vector(dim, scalar)
    separation = difference(dim, scalar, compensated)

    @kernel
    def sum_strains(
        # Model, row w mod (number of rows) for world w:
        rest_length: wp.array2d(dtype=scalar),  # [m], shape [rows, connection_count]
        stiffness: wp.array2d(dtype=scalar),  # [N/m], shape [rows, connection_count]
        damping: wp.array2d(dtype=scalar),  # in the units of the law, shape [rows, connection_count]
        # The same in all worlds:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        chosen: wp.array(dtype=int),  # indices of connections
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        x_lost: wp.array(dtype=V),  # compensation of positions [m]
        stride: int,  # from one world to the next, in particles
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, STRAIN_COLUMNS]
    ):
        w, share = wp.tid()
        start = w * stride
        total = wp.float64(0.0)
        largest = wp.float64(0.0)
        count = wp.float64(0.0)
        m = share
        while m < chosen.shape[0]:
            c = chosen[m]
            whole = bool(True)
            if wp.static(tears):
                springs = stiffness[w % stiffness.shape[0], c] != scalar(0.0)
                whole = springs or damping[w % damping.shape[0], c] != scalar(0.0)
            if whole:
                length = wp.length(separation(x, x_lost, start + connections[c][0], start + connections[c][1]))
                strain = length / wp.float64(rest_length[w % rest_length.shape[0], c]) - wp.float64(1.0)
                total += strain
                largest = wp.max(largest, wp.abs(strain))
                count += wp.float64(1.0)
            m += shares.shape[1]
        shares[w, share, wp.static(SUM)] = total
        shares[w, share, wp.static(LARGEST)] = largest
        shares[w, share, wp.static(COUNT)] = count

    return sum_strains
