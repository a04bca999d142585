"""What is told of each world: means over groups, and energies, in float64, always in the same order."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import kernel, vector
from .measure import difference

KINETIC, ELASTIC, GRAVITATIONAL = 0, 1, 2
"""Columns of energies."""
ENERGY_COLUMNS = 3


class Weighed(NamedTuple):
    """What a mean is taken of; hashable."""

    function: Any
    """wp.func (x, v, i) of a particle's position [m], velocity [m/s], number: a float64, or a vector of such."""
    width: int
    """How many numbers it returns; 0 where that is one number, and no vector."""


@functools.cache
def mean_over_group(dim: int, scalar: type, compensated: bool, weighed: Weighed):
    """Compose the kernel, over worlds and lanes, that sums what a function tells of a group's particles.

    The function is given vectors of float64, in compensated precision without what rounding took.
    """
    V, Wide = vector(dim, scalar), vector(dim, wp.float64)
    function, width = weighed
    columns = max(width, 1)

    @kernel
    def mean_of_each(
        member: wp.array(dtype=int),  # the particles of the group, shape [member_count]
        weight: wp.array2d(dtype=wp.float64),  # what each counts, shape [rows, member_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], of all worlds
        v: wp.array(dtype=V),  # velocities [m/s], of all worlds
        x_lost: wp.array(dtype=V),  # what these have lost by rounding
        v_lost: wp.array(dtype=V),
        stride: int,  # from one world to the next, in particles
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [world_count, lane_count, columns]
    ):
        w, lane = wp.tid()
        for k in range(wp.static(columns)):
            shares[w, lane, k] = wp.float64(0.0)
        m = lane
        while m < member.shape[0]:
            at = w * stride + member[m]
            place = Wide(x[at])
            speed = Wide(v[at])
            if wp.static(compensated):
                place = place - Wide(x_lost[at])
                speed = speed - Wide(v_lost[at])
            own = weight[w % weight.shape[0], m]
            told = function(place, speed, member[m])
            if wp.static(width == 0):
                shares[w, lane, 0] = shares[w, lane, 0] + own * told
            else:
                for k in range(wp.static(columns)):
                    shares[w, lane, k] = shares[w, lane, k] + own * told[k]
            m += shares.shape[1]

    return mean_of_each


@functools.cache
def sum_energies(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over worlds and lanes, that sums kinetic, elastic and gravitational energies.

    Pinned particles have none.
    """
    V = vector(dim, scalar)
    separation = difference(dim, scalar, compensated)

    @kernel
    def energies_of_each(
        # Model, row w mod (number of rows) for world w:
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], 0 where pinned, shape [rows, particle_count]
        gravity: wp.array(dtype=V),  # [m/s²], shape [rows]
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array2d(dtype=scalar),  # l0 [m], shape [rows, connection_count]
        stiffness: wp.array2d(dtype=scalar),  # k [N/m], shape [rows, connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], of all worlds
        v: wp.array(dtype=V),  # velocities [m/s], of all worlds
        x_lost: wp.array(dtype=V),  # what positions have lost by rounding
        stride: int,  # from one world to the next, in particles
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # [J], shape [world_count, lane_count, 3]
    ):
        w, lane = wp.tid()
        start = w * stride
        g = gravity[w % gravity.shape[0]]
        half = wp.float64(0.5)
        kinetic = wp.float64(0.0)
        elastic = wp.float64(0.0)
        potential = wp.float64(0.0)
        i = lane
        while i < inverse_mass.shape[1]:
            m = wp.float64(inverse_mass[w % inverse_mass.shape[0], i])
            if m > wp.float64(0.0):
                square = wp.float64(0.0)
                fall = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    speed = wp.float64(v[start + i][k])
                    square += speed * speed
                    fall += wp.float64(g[k]) * wp.float64(x[start + i][k])
                kinetic += half * square / m
                potential -= fall / m
            i += shares.shape[1]
        c = lane
        while c < connections.shape[0]:
            length = wp.length(separation(x, x_lost, start + connections[c][0], start + connections[c][1]))
            stretch = length - wp.float64(rest_length[w % rest_length.shape[0], c])
            elastic += half * wp.float64(stiffness[w % stiffness.shape[0], c]) * stretch * stretch
            c += shares.shape[1]
        shares[w, lane, wp.static(KINETIC)] = kinetic
        shares[w, lane, wp.static(ELASTIC)] = elastic
        shares[w, lane, wp.static(GRAVITATIONAL)] = potential

    return energies_of_each


@kernel
def sum_lanes(
    shares: wp.array3d(dtype=wp.float64),  # shape [world_count, lane_count, columns]
    # Out:
    sums: wp.array2d(dtype=wp.float64),  # shape [world_count, columns]
):
    """Add up the shares of a world's lanes."""
    w, column = wp.tid()
    total = wp.float64(0.0)
    for lane in range(shares.shape[1]):
        total += shares[w, lane, column]
    sums[w, column] = total


@functools.cache
def moving(dim: int, what: str) -> Weighed:
    """Compose what is weighed of a particle: its "position" or its "velocity"."""
    Wide = vector(dim, wp.float64)
    speeds = what == "velocity"

    @wp.func
    def of_particle(x: Wide, v: Wide, i: int) -> Wide:
        if wp.static(speeds):
            return v
        return x

    return Weighed(of_particle, dim)
