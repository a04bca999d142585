"""Sums over groups for probes, in float64. Each thread computes a partial sum; the order of additions is fixed."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..springs.cell_geometry import cell_geometry
from ..springs.cell_volumes import volume_law
from .measure import difference

SUM, LARGEST, COUNT = 0, 1, 2
"""Columns of `sum_strain`: sum of strains, largest absolute strain, number of connections."""
STRAIN_COLUMNS = 3
COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))}
"""Components of a symmetric tensor, by dimension: xx, yy, zz, xy, xz, yz."""


@functools.cache
def sum_of_group(dim: int, Vector: Any, compensated: bool):
    """Compose the kernel, over worlds and threads, that sums values of a group's particles with weights."""

    @kernel
    def sum_over_group(
        weight: wp.array2d(dtype=wp.float64),  # weight of each member, shape [rows, member_count]
        member: wp.array(dtype=int),  # particles of the group, shape [member_count]
        value: wp.array(dtype=Vector),  # value of each particle of all worlds
        compensation: wp.array(dtype=Vector),  # compensation of these values
        stride: int,  # particles from one world to the next
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
    """Compose the kernel, over worlds and threads, that sums a function over a group's particles.

    The function is a wp.func (x, v, i) of a particle's position, velocity and index, float64 and corrected for
    rounding in compensated precision. It returns a vector of `width` numbers, or one number if `width` is 0.
    """
    V, Wide = vector(dim, scalar), vector(dim, wp.float64)
    columns = max(width, 1)

    @kernel
    def mean_of_each(
        member: wp.array(dtype=int),  # particles of the group, shape [member_count]
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        v: wp.array(dtype=V),  # velocities [m/s]
        x_lost: wp.array(dtype=V),  # compensation of x; below, of v
        v_lost: wp.array(dtype=V),
        stride: int,  # particles from one world to the next
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
        stride: int,  # particles from one world to the next
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


@functools.cache
def sum_virial(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over worlds and threads, that sums weight · tension · length · n nᵀ of connections."""
    V, components = vector(dim, scalar), COMPONENTS[dim]
    separation = difference(dim, scalar, compensated)

    @kernel
    def sum_virials(
        # Model, row w mod (number of rows) for world w:
        rest_length: wp.array2d(dtype=scalar),  # [m], shape [rows, connection_count]
        stiffness: wp.array2d(dtype=scalar),  # [N/m], shape [rows, connection_count]
        # The same in all worlds:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        weight: wp.array(dtype=wp.float64),  # fraction of each chosen connection that is counted
        chosen: wp.array(dtype=int),  # indices of connections
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        x_lost: wp.array(dtype=V),  # compensation of positions [m]
        stride: int,  # particles from one world to the next
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, len(COMPONENTS)]
    ):
        w, share = wp.tid()
        start = w * stride
        for k in range(wp.static(len(components))):
            shares[w, share, k] = wp.float64(0.0)
        m = share
        while m < chosen.shape[0]:
            c = chosen[m]
            apart = separation(x, x_lost, start + connections[c][0], start + connections[c][1])
            length = wp.length(apart)
            rest = wp.float64(rest_length[w % rest_length.shape[0], c])
            density = wp.float64(stiffness[w % stiffness.shape[0], c]) * (length - rest) * weight[m]
            if length > wp.float64(0.0):
                density /= length
            for k in range(wp.static(len(components))):
                product = apart[wp.static(components[k][0])] * apart[wp.static(components[k][1])]
                shares[w, share, k] = shares[w, share, k] + density * product
            m += shares.shape[1]

    return sum_virials


@functools.cache
def sum_cell_stress(dim: int, scalar: type, compensated: bool, solid: bool, flat: bool):
    """Compose the kernel, over worlds and threads, that sums w' V P [J] and volumes V over chosen cells.

    w' is minus a cell's pressure. P projects on the plane of a flat cell, and is the identity for a solid one.
    """
    V, components, corner_count = vector(dim, scalar), COMPONENTS[dim], 8 if solid else 4
    separation, law = difference(dim, scalar, compensated), volume_law(wp.float64)
    Rows, geometry, _turning = cell_geometry(dim, wp.float64, solid, flat)

    @kernel
    def sum_cell_stresses(
        corners: wp.array2d(dtype=int),  # particles of each chosen cell, shape [chosen_count, 8]; -1: none
        rest_volume: wp.array(dtype=wp.float64),  # [m³], or [m²]
        modulus: wp.array(dtype=wp.float64),  # [Pa], or [N/m]
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        x_lost: wp.array(dtype=V),  # compensation of positions [m]
        stride: int,  # particles from one world to the next
        # Out:
        shares: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, len(COMPONENTS) + 1]
    ):
        w, share = wp.tid()
        start = w * stride
        for k in range(wp.static(len(components) + 1)):
            shares[w, share, k] = wp.float64(0.0)
        m = share
        while m < corners.shape[0]:
            is_flat = corners[m, wp.static(corner_count - 1)] < 0 or wp.static(not solid)
            points = Rows()
            for k in range(wp.static(corner_count)):
                if corners[m, k] >= 0:
                    point = separation(x, x_lost, start + corners[m, k], start + corners[m, 0])
                    for d in range(wp.static(dim)):
                        points[k, d] = point[d]
            volume, _gradient = geometry(points, is_flat)
            _energy, slope, _curvature, _share = law(modulus[m], volume / rest_volume[m])
            volume = wp.abs(volume)
            normal = wp.vec3d()
            if wp.static(flat and dim == 3):
                if is_flat:
                    normal = wp.normalize(wp.cross(points[2] - points[0], points[3] - points[1]))
            for k in range(wp.static(len(components))):
                part = -normal[wp.static(components[k][0])] * normal[wp.static(components[k][1])]
                if wp.static(components[k][0] == components[k][1]):
                    part += wp.float64(1.0)
                shares[w, share, k] = shares[w, share, k] + slope * volume * part
            last = wp.static(len(components))
            shares[w, share, last] = shares[w, share, last] + volume
            m += shares.shape[1]

    return sum_cell_stresses
