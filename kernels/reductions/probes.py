"""Sums over groups for probes, in float64. Each thread computes a partial sum; the order of additions is fixed."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fully_hashed, kernel, vector
from ..colliders.signed_distance import signed_distance, solids
from ..springs.cell_geometry import cell_geometry
from ..springs.cell_volumes import volume_law
from .measure import difference

COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))}
"""Components of a symmetric tensor, by dimension: xx, yy, zz, xy, xz, yz."""


class Sum(NamedTuple):
    """A sum over the members of a group."""

    Data: Any
    """Struct type of what the terms are computed from."""
    term: Any
    """wp.func (data, w, m) -> vector of the numbers of member m in world w."""
    columns: int
    """Number of these numbers."""
    largest: int = -1
    """Column of which the maximum is taken instead of the sum; −1 for none."""


@functools.cache
def sum_members(of: Sum):
    """Compose the kernel, over worlds and threads, that sums the terms of `count` members."""
    Data, term, columns, largest = of
    Columns = wp.types.vector(columns, wp.float64)

    @kernel
    def sum_terms(
        data: Data,
        count: int,
        # Out:
        partial: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, columns]
    ):
        w, thread = wp.tid()
        total = Columns()
        m = thread
        while m < count:
            one = term(data, w, m)
            if wp.static(largest >= 0):
                most = wp.max(total[largest], one[largest])
            total += one
            if wp.static(largest >= 0):
                total[largest] = most
            m += partial.shape[1]
        for k in range(wp.static(columns)):
            partial[w, thread, k] = total[k]

    return sum_terms


@functools.cache
def sum_of_group(dim: int, Vector: Any) -> Sum:
    """Return the sum of values of a group's particles with weights."""
    Wide = vector(dim, wp.float64)

    @wp.struct
    class GroupData:
        weight: wp.array2d(dtype=wp.float64)  # weight of each member, shape [rows, member_count]
        member: wp.array(dtype=int)  # particles of the group, shape [member_count]
        value: wp.array(dtype=Vector)  # value of each particle of all worlds
        lost: wp.array(dtype=Vector)  # compensation of these values, or empty
        stride: int  # particles from one world to the next

    @wp.func
    def weighted(data: GroupData, w: int, m: int) -> Wide:
        i = w * data.stride + data.member[m]
        value = Wide(data.value[i])
        if data.lost.shape[0] > 0:
            value -= Wide(data.lost[i])
        return data.weight[w % data.weight.shape[0], m] * value

    return Sum(GroupData, weighted, dim)


@functools.cache
def mean_of_function(dim: int, scalar: type, function: Any, width: int) -> Sum:
    """Return the mean of a function over a group's particles.

    The function is a wp.func (x, v, i) of a particle's position, velocity and index, float64 and corrected for
    rounding in compensated precision. It returns a vector of `width` numbers, or one number if `width` is 0.
    """
    V, Wide = vector(dim, scalar), vector(dim, wp.float64)
    columns = max(width, 1)
    Columns = wp.types.vector(columns, wp.float64)

    @wp.struct
    class MeanData:
        member: wp.array(dtype=int)  # particles of the group, shape [member_count]
        # State, of all worlds:
        x: wp.array(dtype=V)  # positions [m]
        v: wp.array(dtype=V)  # velocities [m/s]
        x_lost: wp.array(dtype=V)  # compensation of x, or empty; below, of v
        v_lost: wp.array(dtype=V)
        stride: int  # particles from one world to the next

    @wp.func
    def weighted(data: MeanData, w: int, m: int) -> Columns:
        at = w * data.stride + data.member[m]
        place = Wide(data.x[at])
        speed = Wide(data.v[at])
        if data.x_lost.shape[0] > 0:
            place = place - Wide(data.x_lost[at])
            speed = speed - Wide(data.v_lost[at])
        return wp.float64(1.0) / wp.float64(data.member.shape[0]) * Columns(function(place, speed, data.member[m]))

    return Sum(MeanData, weighted, columns)


@functools.cache
def wrench_on_obstacle(dim: int, scalar: type, kinds: tuple[str, ...], moving: bool) -> Sum:
    """Return the sum of the impulses of particles on an obstacle, then of their moments about its centre.

    Each particle has one impulse J from all obstacles. It counts for the obstacle that the particle touches. If it
    touches several, in a corner, J is divided between the two that press most, along their normals; what is left,
    friction, is divided in the same ratio. So the impulses on all obstacles add up to those on particles.
    """
    V, Wide, Solids = vector(dim, scalar), vector(dim, wp.float64), solids(dim, scalar)
    Turn, moments = wp.types.matrix((dim, dim), scalar), {1: 0, 2: 1, 3: 3}[dim]
    Columns, Result = wp.types.vector(dim + moments, wp.float64), wp.types.vector(dim + 1, scalar)
    distance_from = signed_distance(dim, scalar, kinds)

    class WrenchData:
        mass: wp.array(dtype=wp.float64)  # [kg], 0 if obstacles cannot move the particle, shape [particle_count]
        value: wp.array(dtype=Wide)  # impulse by all obstacles per mass [m/s], shape [particle_count]
        x: wp.array(dtype=V)  # positions [m]
        solids: Solids
        obstacle_count: int
        obstacle: int  # index of the one that is measured
        centre: V  # about which moments are taken, of the obstacle in its given pose [m]
        slack: scalar  # difference of distances up to which a particle touches several [m]
        if moving:
            # Poses, each of shape [rows, count], and the row that counts:
            turn: wp.array2d(dtype=Turn)
            shift: wp.array2d(dtype=V)
            row: int
        stride: int

    if moving:  # generated code needs another name
        WrenchData.__qualname__ = WrenchData.__qualname__.replace("Wrench", "MovingWrench")
    WrenchData = wp.struct(WrenchData)

    @wp.func
    def look(data: WrenchData, p: int, x: V) -> Result:
        if wp.static(moving):
            turn = data.turn[data.row, p]
            found = distance_from(data.solids, p, wp.transpose(turn) * (x - data.shift[data.row, p]))
            normal = V()
            for k in range(wp.static(dim)):
                normal[k] = found[k]
            normal = turn * normal
            for k in range(wp.static(dim)):
                found[k] = normal[k]
            return found
        return distance_from(data.solids, p, x)

    @wp.func
    def part_of(data: WrenchData, x: V, push: Wide) -> Wide:
        least = scalar(1.0e30)
        for p in range(data.obstacle_count):
            least = wp.min(least, look(data, p, x)[wp.static(dim)])
        first = int(-1)
        second = int(-1)
        b1 = wp.float64(0.0)
        b2 = wp.float64(0.0)
        n1 = Wide()
        n2 = Wide()
        for p in range(data.obstacle_count):
            found = look(data, p, x)
            if found[wp.static(dim)] <= least + data.slack:
                normal = Wide()
                for k in range(wp.static(dim)):
                    normal[k] = wp.float64(found[k])
                pressing = wp.dot(normal, push)
                if first < 0 or pressing > b1:
                    second = first
                    b2 = b1
                    n2 = n1
                    first = p
                    b1 = pressing
                    n1 = normal
                elif second < 0 or pressing > b2:
                    second = p
                    b2 = pressing
                    n2 = normal
        cosine = wp.dot(n1, n2)
        sine = wp.float64(1.0) - cosine * cosine
        by_first = wp.float64(1.0)
        by_second = wp.float64(0.0)
        if second >= 0 and sine > wp.float64(1.0e-6):
            by_first = wp.max(b1 - cosine * b2, wp.float64(0.0)) / sine
            by_second = wp.max(b2 - cosine * b1, wp.float64(0.0)) / sine
        if by_second <= wp.float64(0.0) or by_first <= wp.float64(0.0):
            if data.obstacle == first:
                return push
            return Wide()
        rest = (push - by_first * n1 - by_second * n2) / (by_first + by_second)
        if data.obstacle == first:
            return by_first * (n1 + rest)
        if data.obstacle == second:
            return by_second * (n2 + rest)
        return Wide()

    @wp.func
    def wrench(data: WrenchData, w: int, m: int) -> Columns:
        result = Columns()
        push = data.mass[m] * data.value[m]
        if wp.dot(push, push) > wp.float64(0.0):
            x = data.x[m]
            centre = data.centre
            if wp.static(moving):
                centre = data.turn[data.row, data.obstacle] * centre + data.shift[data.row, data.obstacle]
            on = -part_of(data, x, push)
            arm = Wide(x) - Wide(centre)
            for k in range(wp.static(dim)):
                result[k] = on[k]
            if wp.static(dim == 2):
                result[2] = arm[0] * on[1] - arm[1] * on[0]
            if wp.static(dim == 3):
                moment = wp.cross(arm, on)
                for k in range(3):
                    result[3 + k] = moment[k]
        return result

    return Sum(WrenchData, wrench, dim + moments)


@functools.cache
def sum_cell_stress(dim: int, scalar: type, solid: bool, flat: bool) -> Sum:
    """Return the sum of w' V P [J], then of the volumes V, over chosen cells.

    w' is minus a cell's pressure. P projects on the plane of a flat cell, and is the identity for a solid one.
    """
    V, components, corner_count = vector(dim, scalar), COMPONENTS[dim], 8 if solid else 4
    separation, law = difference(dim, scalar), volume_law(wp.float64)
    Rows, geometry, _turning = cell_geometry(dim, wp.float64, solid, flat)
    Columns = wp.types.vector(len(components) + 1, wp.float64)

    @wp.struct
    class CellStressData:
        corners: wp.array2d(dtype=int)  # particles of each chosen cell, shape [chosen_count, 8]; -1: none
        rest_volume: wp.array(dtype=wp.float64)  # [m³], or [m²]
        modulus: wp.array(dtype=wp.float64)  # [Pa], or [N/m]
        # State, of all worlds:
        value: wp.array(dtype=V)  # positions [m]
        lost: wp.array(dtype=V)  # compensation of positions [m], or empty
        stride: int  # particles from one world to the next

    @fully_hashed
    def stress(data: CellStressData, w: int, m: int) -> Columns:
        start = w * data.stride
        is_flat = data.corners[m, wp.static(corner_count - 1)] < 0 or wp.static(not solid)
        points = Rows()
        for k in range(wp.static(corner_count)):
            if data.corners[m, k] >= 0:
                point = separation(data.value, data.lost, start + data.corners[m, k], start + data.corners[m, 0])
                for d in range(wp.static(dim)):
                    points[k, d] = point[d]
        volume, _gradient = geometry(points, is_flat)
        _energy, slope, _curvature, _damping_fraction = law(data.modulus[m], volume / data.rest_volume[m])
        volume = wp.abs(volume)
        normal = wp.vec3d()
        if wp.static(flat and dim == 3):
            if is_flat:
                normal = wp.normalize(wp.cross(points[2] - points[0], points[3] - points[1]))
        result = Columns()
        for k in range(wp.static(len(components))):
            part = -normal[wp.static(components[k][0])] * normal[wp.static(components[k][1])]
            if wp.static(components[k][0] == components[k][1]):
                part += wp.float64(1.0)
            result[k] = slope * volume * part
        result[wp.static(len(components))] = volume
        return result

    return Sum(CellStressData, stress, len(components) + 1)
