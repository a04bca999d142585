"""Bounding boxes of facets and bodies, and the broad phase: which bodies are near each other."""

import functools

import warp as wp

from ..basis import kernel
from ..records import records
from .contact_data import MOST_BODY_PAIRS, BodyContactData, first_flag
from .lanes import least_of_lanes
from .pairs import pairs


@functools.cache
def clear_boxes():
    """Compose the kernel, over bodies, that empties their bounding boxes."""

    @kernel
    def forget(low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3), widest: wp.array(dtype=float)):
        i = wp.tid()
        low[i] = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        high[i] = -low[i]
        widest[i] = 0.0

    return forget


NEVER = 1e30
"""A speed that no point reaches [m/s]."""


@functools.cache
def box_facets(scalar: type, lanes: int, worlds: bool = False):
    """Compose the kernel, over pieces of bodies, that bounds facets and extends the bounds of their bodies.

    `lanes` threads share a piece.
    """
    Data, least_of = BodyContactData(scalar, worlds), least_of_lanes(wp.float32, lanes)
    load = records(3, scalar).load

    @wp.func
    def least_corner(x: wp.vec3) -> wp.vec3:
        return wp.vec3(least_of(x[0]), least_of(x[1]), least_of(x[2]))

    @kernel
    def write_boxes(
        data: Data,
        piece: wp.array(dtype=wp.vec3i),  # body, first facet, end of facets, shape [piece_count]
        # Out, shape [facet_count]:
        lower: wp.array(dtype=wp.vec3),
        upper: wp.array(dtype=wp.vec3),
        # In and out, shape [body_count]:
        low: wp.array(dtype=wp.vec3),
        high: wp.array(dtype=wp.vec3),
        widest: wp.array(dtype=float),  # longest side of any facet's box [m]
    ):
        part = piece[wp.tid() / wp.static(lanes)]
        least = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        most = -least
        side = float(0.0)
        for t in range(part[1] + wp.tid() % wp.static(lanes), part[2], wp.static(lanes)):
            c = data.surfaces.corner[t]
            a = wp.vec3(load(data.surfaces.x, c[0]))
            b = wp.vec3(load(data.surfaces.x, c[1]))
            d = wp.vec3(load(data.surfaces.x, c[2]))
            below = wp.min(wp.min(a, b), d)
            above = wp.max(wp.max(a, b), d)
            lower[t] = below
            upper[t] = above
            least = wp.min(least, below)
            most = wp.max(most, above)
            side = wp.max(side, wp.max(above - below))
        least = least_corner(least)
        most = -least_corner(-most)
        side = -least_of(-side)
        body = part[0]
        wider = side > widest[body]  # most threads find the body's box large enough
        for k in range(3):
            wider = wider or least[k] < low[body][k] or most[k] > high[body][k]
        if wider and wp.tid() % wp.static(lanes) == 0:
            wp.atomic_min(low, body, least)
            wp.atomic_max(high, body, most)
            wp.atomic_max(widest, body, side)

    return write_boxes


@functools.cache
def find_roots():
    """Compose the kernel, over bodies, that finds the root of each body's subtree in the tree of facets.

    Likewise for each world's subtree in the tree of bodies.
    """

    @kernel
    def find(tree: wp.uint64, root: wp.array(dtype=int)):
        i = wp.tid()
        root[i] = wp.bvh_get_group_root(tree, i)

    return find


@functools.cache
def box_neighbours(scalar: type, worlds: bool = False):
    """Compose the kernel, over bodies, that lists the bodies each may touch, and finds a box around all of these.

    A point outside this box touches none of them. Most points of a large body are outside: no further test.
    """
    Data, margin = BodyContactData(scalar, worlds), margin_of_boxes(scalar)
    find_rule, first_of = pairs(scalar, worlds)[0], first_flag(scalar, worlds)

    @kernel
    def extend_neighbours(
        data: Data,
        bodies: wp.uint64,  # tree of the boxes around bodies
        low: wp.array(dtype=wp.vec3),  # the boxes, shape [body_count]
        high: wp.array(dtype=wp.vec3),
        farthest: scalar,  # largest distance of any contact [m]
        buffer: wp.array(dtype=scalar),  # [m], shape [1]
        flags: wp.array(dtype=float),
        active_count: wp.array(dtype=int),
        # Out, shape [body_count]:
        least: wp.array(dtype=wp.vec3),
        most: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        if i == 0:  # reset the counters of the new search
            active_count[0] = 0
            data.neighbors.search_point_count[0] = 0
            for k in range(2):
                data.neighbors.speeds[k] = wp.vec3(wp.static(-NEVER), wp.static(-NEVER), wp.static(-NEVER))
        around = farthest + buffer[0]
        lower = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        upper = -lower
        wide = margin(low[i], high[i], around)
        if wp.static(worlds):
            own = data.neighbors.root_of_world[i / data.surfaces.bodies_each]
            near_bodies = wp.bvh_query_aabb(bodies, low[i] - wide, high[i] + wide, own)
        else:
            near_bodies = wp.bvh_query_aabb(bodies, low[i] - wide, high[i] + wide)
        j = int(0)
        count = int(0)
        while wp.bvh_query_next(near_bodies, j):
            if find_rule(data, i, j) >= 0:
                if count < data.neighbors.body_pairs.shape[1]:
                    data.neighbors.body_pairs[i, count] = j
                count += 1
                wide = margin(low[j], high[j], around)
                lower = wp.min(lower, low[j] - wide)
                upper = wp.max(upper, high[j] + wide)
        data.neighbors.body_pair_count[i] = wp.min(count, data.neighbors.body_pairs.shape[1])
        at = first_of(data, i) + wp.static(MOST_BODY_PAIRS)
        if count > int(flags[at]):
            wp.atomic_max(flags, at, float(count))
        least[i] = lower
        most[i] = upper

    return extend_neighbours


@functools.cache
def margin_of_boxes(scalar: type):
    """Compose (low, high, around) -> by how much a box is widened to hold all points within `around` of it [m].

    That is `around` and a bound on the rounding of float32.
    """

    @wp.func
    def margin(low: wp.vec3, high: wp.vec3, around: scalar) -> wp.vec3:
        reach = wp.float32(around)
        reach += wp.float32(2.0e-6) * (wp.length(wp.max(wp.abs(low), wp.abs(high))) + reach)
        return wp.vec3(reach, reach, reach)

    return margin
