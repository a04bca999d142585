"""Which facets are near a point: lists that hold until something has moved by half of their skin."""

import functools

import warp as wp

from ..basis import kernel, vector
from .pairs import bodies_in_rows, pairs, places
from .surfaces import HISTORY, LONGEST_ROW, Surfaces


@functools.cache
def box_facets(scalar: type):
    """Compose the kernel, over facets, that writes the box around each."""
    Data = Surfaces(scalar)

    @kernel
    def write_boxes(data: Data, lower: wp.array(dtype=wp.vec3), upper: wp.array(dtype=wp.vec3)):
        t = wp.tid()
        c = data.corner[t]
        a = wp.vec3(data.x[c[0]])
        b = wp.vec3(data.x[c[1]])
        d = wp.vec3(data.x[c[2]])
        lower[t] = wp.min(wp.min(a, b), d)
        upper[t] = wp.max(wp.max(a, b), d)

    return write_boxes


@functools.cache
def forget_boxes():
    """Compose the kernel, over bodies, that makes the boxes around them hold nothing."""

    @kernel
    def forget(low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3)):
        i = wp.tid()
        low[i] = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        high[i] = -low[i]

    return forget


@functools.cache
def box_bodies():
    """Compose the kernel, over chunks of facets of one body, that extends the box around the body."""

    @kernel
    def extend_boxes(
        chunk: wp.array(dtype=wp.vec3i),  # body, first facet, and the one behind the last, shape [chunk_count]
        lower: wp.array(dtype=wp.vec3),  # of facets
        upper: wp.array(dtype=wp.vec3),
        # In and out, shape [body_count]:
        low: wp.array(dtype=wp.vec3),
        high: wp.array(dtype=wp.vec3),
    ):
        c = chunk[wp.tid()]
        least = lower[c[1]]
        most = upper[c[1]]
        for t in range(c[1] + 1, c[2]):
            least = wp.min(least, lower[t])
            most = wp.max(most, upper[t])
        wp.atomic_min(low, c[0], least)
        wp.atomic_max(high, c[0], most)

    return extend_boxes


@functools.cache
def box_neighbours(scalar: type):
    """Compose the kernel, over bodies, that boxes where a point of each may be near what it touches.

    The box holds those of all bodies near by: most points of large bodies are outside, and done with at a glance.
    """
    Data = Surfaces(scalar)
    find_rule = pairs(scalar)[0]

    @wp.func
    def margin(low: wp.vec3, high: wp.vec3, around: scalar) -> wp.vec3:
        """Return by how much a box grows to hold all that is so near to it, whatever was rounded."""
        reach = wp.float32(around)
        reach += wp.float32(2.0e-6) * (wp.length(wp.max(wp.abs(low), wp.abs(high))) + reach)
        return wp.vec3(reach, reach, reach)

    @kernel
    def extend_neighbours(
        data: Data,
        bodies: wp.uint64,  # tree of the boxes around bodies
        low: wp.array(dtype=wp.vec3),  # these, shape [body_count]
        high: wp.array(dtype=wp.vec3),
        farthest: scalar,  # how far off a point may touch anything [m]
        skin: wp.array(dtype=scalar),  # [m], shape [1]
        busy_count: wp.array(dtype=int),
        # Out, shape [body_count]:
        least: wp.array(dtype=wp.vec3),
        most: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        if i == 0:
            busy_count[0] = 0  # of the search that begins
        around = farthest + skin[0]
        lower = wp.vec3(1.0e30, 1.0e30, 1.0e30)
        upper = -lower
        wide = margin(low[i], high[i], around)
        near_bodies = wp.bvh_query_aabb(bodies, low[i] - wide, high[i] + wide)
        j = int(0)
        while wp.bvh_query_next(near_bodies, j):
            if find_rule(data, i, j) >= 0:
                wide = margin(low[j], high[j], around)
                lower = wp.min(lower, low[j] - wide)
                upper = wp.max(upper, high[j] + wide)
        least[i] = lower
        most[i] = upper

    return extend_neighbours


@functools.cache
def find_rows(scalar: type):
    """Compose the kernel that lists the facets which each point may touch before lists are made anew.

    Its threads share the points.

    Of each body those stay that may come to be the nearest meanwhile. With each stands how far off it is, so that
    later most need not be looked at. What is left in and never touched changes nothing: neither the skin nor the
    order in which facets are found does.
    """
    Data = Surfaces(scalar)
    (place_of, place_on, nearest_to), (find_rule, _, reach_of, _) = places(scalar), pairs(scalar)
    next_body = bodies_in_rows(scalar)

    @wp.func
    def box_around(x: vector(3, scalar), around: scalar):
        """Return the corners of a box of float32 that holds all that is so near to x, whatever was rounded."""
        reach = wp.float32(around)
        reach += wp.float32(1.0e-6) * (wp.length(wp.vec3(x)) + reach)
        corner = wp.vec3(reach, reach, reach)
        return wp.vec3(x) - corner, wp.vec3(x) + corner

    @wp.func
    def is_near(first_near: wp.array(dtype=int), near: wp.array(dtype=int), vertex: int, corner: wp.vec3i) -> bool:
        """Tell whether a corner of a facet is among the neighbours of a vertex, which it never touches."""
        found = bool(False)
        for e in range(first_near[vertex], first_near[vertex + 1]):
            other = near[e]
            if other == corner[0] or other == corner[1] or other == corner[2]:
                found = True
        return found

    @wp.func
    def find_one(
        data: Data,
        p: int,
        bodies: wp.uint64,  # tree of the boxes around bodies
        facets: wp.uint64,  # tree of those around facets
        farthest: scalar,  # how far off a point may touch anything [m]
        skin: wp.array(dtype=scalar),  # [m], shape [1]
        flags: wp.array(dtype=float),
    ):
        ends = data.ends[p]
        x = place_of(data.x, ends, data.share[p])
        mine = data.body[p]
        count = int(0)
        room = data.row.shape[0]
        low, high = box_around(x, farthest + skin[0])
        near_bodies = wp.bvh_query_aabb(bodies, low, high)
        other = int(0)
        alone = bool(True)
        while alone and wp.bvh_query_next(near_bodies, other):
            alone = find_rule(data, mine, other) < 0
        if not alone:
            near_facets = wp.bvh_query_aabb(facets, low, high)
            facet = int(0)
            while wp.bvh_query_next(near_facets, facet):
                other = data.owner[facet]
                rule = find_rule(data, mine, other)
                if rule >= 0:
                    c = data.corner[facet]
                    reach = reach_of(data, rule, mine, other)
                    away = wp.length(x - place_on(data.x, c, nearest_to(data.x, c, x)))
                    if away < reach + skin[0]:
                        may = bool(True)
                        if mine == other:
                            may = not is_near(data.first_near, data.near, ends[0], c)
                            may = may and not is_near(data.first_near, data.near, ends[1], c)
                        if may:
                            if count < room:
                                data.row[count, p] = facet
                                data.whose[count, p] = other
                                data.away[count, p] = away
                            count += 1
        # Who is nearest of a body now stays so, but for those that are no further by twice what skins allow.
        listed = wp.min(count, room)
        other = int(-1)
        r = next_body(data.whose, data.away, p, listed, other)
        while r >= 0:
            other = data.whose[r, p]
            limit = scalar(1.01) * (data.away[r, p] + scalar(2.0) * skin[0])
            for e in range(listed):
                if data.whose[e, p] == other and data.away[e, p] > limit:
                    data.whose[e, p] = -1
            r = next_body(data.whose, data.away, p, listed, other)
        kept = int(0)
        for e in range(listed):
            if data.whose[e, p] >= 0:
                data.row[kept, p] = data.row[e, p]
                data.whose[kept, p] = data.whose[e, p]
                data.away[kept, p] = data.away[e, p]
                kept += 1
        data.length[p] = kept
        if count == 0:
            for k in range(wp.static(HISTORY)):
                data.partner[k, p] = -1
        if count > int(flags[wp.static(LONGEST_ROW)]):
            wp.atomic_max(flags, wp.static(LONGEST_ROW), float(count))

    @kernel
    def find(
        data: Data,
        bodies: wp.uint64,
        facets: wp.uint64,
        least: wp.array(dtype=wp.vec3),  # box outside of which no point of a body is near any, shape [body_count]
        most: wp.array(dtype=wp.vec3),
        farthest: scalar,
        skin: wp.array(dtype=scalar),
        threads: int,
        flags: wp.array(dtype=float),
    ):
        p = wp.tid()
        while p < data.length.shape[0]:
            x = wp.vec3(place_of(data.x, data.ends[p], data.share[p]))
            mine = data.body[p]
            if wp.min(x, least[mine]) == least[mine] and wp.max(x, most[mine]) == most[mine]:
                find_one(data, p, bodies, facets, farthest, skin, flags)
            else:
                data.length[p] = 0
                for k in range(wp.static(HISTORY)):
                    data.partner[k, p] = -1
            if data.length[p] > 0 or data.allowed[p] > scalar(0.0):
                data.busy[wp.atomic_add(data.busy_count, 0, 1)] = p
            p += threads

    return find
