"""Sums over groups, for sensors: in float64, by each thread a share, in an order that is the same each time."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from .measure import difference

SUM, LARGEST, COUNT = 0, 1, 2
"""Columns of what `sum_strain` gives: of strains, the largest of their sizes, and of how many."""
STRAIN_COLUMNS = 3


@functools.cache
def sum_of_group(dim: int, Vector: Any, compensated: bool):
    """Compose the kernel that sums what the particles of a group have, each by its weight."""

    @kernel
    def sum_over_group(
        member: wp.array(dtype=int),  # the particles of the group, shape [member_count]
        weight: wp.array(dtype=wp.float64),  # what each counts, shape [member_count]
        value: wp.array(dtype=Vector),  # shape [particle_count]
        compensation: wp.array(dtype=Vector),  # what these have lost by rounding, shape [particle_count]
        # Out:
        shares: wp.array2d(dtype=wp.float64),  # shape [thread_count, dim]
    ):
        share = wp.tid()
        total = wp.vec3d()
        m = share
        while m < member.shape[0]:
            for k in range(wp.static(dim)):
                one = wp.float64(value[member[m]][k])
                if wp.static(compensated):
                    one -= wp.float64(compensation[member[m]][k])
                total[k] += weight[m] * one
            m += shares.shape[0]
        for k in range(wp.static(dim)):
            shares[share, k] = total[k]

    return sum_over_group


@functools.cache
def sum_strain(dim: int, scalar: type, compensated: bool, tears: bool):
    """Compose the kernel that sums the strains of chosen connections, but for broken ones."""
    V = vector(dim, scalar)
    separation = difference(dim, scalar, compensated)

    @kernel
    def sum_strains(
        # Model:
        chosen: wp.array(dtype=int),  # which connections
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # [m], shape [connection_count]
        stiffness: wp.array(dtype=scalar),  # [N/m], shape [connection_count]
        damping: wp.array(dtype=scalar),  # in the units of the law, shape [connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        x_lost: wp.array(dtype=V),  # what positions have lost by rounding [m], shape [particle_count]
        # Out:
        shares: wp.array2d(dtype=wp.float64),  # shape [thread_count, STRAIN_COLUMNS]
    ):
        share = wp.tid()
        total = wp.float64(0.0)
        largest = wp.float64(0.0)
        count = wp.float64(0.0)
        m = share
        while m < chosen.shape[0]:
            c = chosen[m]
            whole = bool(True)
            if wp.static(tears):
                whole = stiffness[c] != scalar(0.0) or damping[c] != scalar(0.0)
            if whole:
                length = wp.length(separation(x, x_lost, connections[c][0], connections[c][1]))
                strain = length / wp.float64(rest_length[c]) - wp.float64(1.0)
                total += strain
                largest = wp.max(largest, wp.abs(strain))
                count += wp.float64(1.0)
            m += shares.shape[0]
        shares[share, wp.static(SUM)] = total
        shares[share, wp.static(LARGEST)] = largest
        shares[share, wp.static(COUNT)] = count

    return sum_strains
