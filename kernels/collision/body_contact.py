"""The forces of contact between bodies: a spring and a damper along the normal, and friction that sticks.

Bodies are shells around meshes that never cross, so distances have no sign. For a point that is nearer to a facet
than the thickness, by δ, with the unit vector n from the facet to the point and the relative velocity u:

    f_n = max(0, k δ − b u·n), b = α k δ / v; see `law`
    ξ is projected onto the plane of contact, ξ += h u_t, and limited to the length μ f_n / k_t
    f_t = −k_t ξ − b_t u_t, limited to μ f_n, at a point common to both bodies; see `law`

The opposite force is divided among the facet's corners by the barycentric weights of the nearest point. Forces are
summed as integers in a small unit. Such sums do not depend on their order: runs repeat to the last bit, and the
forces between two bodies cancel exactly.
Reference: Cundall and Strack, A discrete numerical model for granular assemblies, Géotechnique 29 (1979).
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import wait_for_lanes
from ..records import records, table
from .contact_data import BodyContactData, Substep
from .force_sums import exert_force
from .history import memories, recall
from .law import TANGENTIAL, contact_law, triangles
from .nearest_facet import nearest_facets
from .neighbor_search import each_active_point
from .pairs import ALMOST, DOUBT, NONE, ROUNDING, Pair, crowding, next_in_order, places, points, weights_on_host

FACING = 0.8
"""Least cosine between the normals of two surfaces for which a damper sees the approach to both, see `law`."""


@functools.cache
def bearing(scalar: type, overlapping_at_start: bool, measuring: bool, lanes: int, worlds: bool):
    """Compose the function that adds the force of one contact to its vertices.

    The function returns whether there is a force, the tangential displacement [m], the fastest approach in this
    contact [m/s], and, if `measuring`, the stored energy [J] and the dissipated power [W].
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar), Substep(scalar)
    (Point, _, mobility_of), PointAndBody = points(scalar), Pair(scalar)
    Memory = memories(scalar)[0]
    Nearest = nearest_facets(scalar, lanes, worlds)[0]
    place_of, place_on, _ = places(scalar)
    press, record, per_unit_of = contact_law(scalar, overlapping_at_start, worlds)
    moved_along = recall(scalar)[1]
    exert, number_of = exert_force(scalar, lanes), table(scalar)
    (_, triangle_of, turn_by), on_host = triangles(scalar), weights_on_host(scalar)
    damping_fraction = crowding(scalar)[0]
    zero, one, half, tangential = scalar(0.0), scalar(1.0), scalar(0.5), scalar(TANGENTIAL)

    @wp.func
    def bear(
        data: Data,
        point: Point,
        lane: int,
        pair: PointAndBody,
        nearest: Nearest,
        past: Memory,  # contact history of the point
        step: Step,
        flags: wp.array(dtype=float),
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        moved = V()
        fastest = zero
        p = point.number
        # Slow memory is read early and together, even if no contact is found afterwards.
        x = data.surfaces.x
        v = data.surfaces.v
        u = place_of(v, point.ends, point.fraction) - place_on(v, nearest.corner, nearest.w)
        mobility = mobility_of(data.surfaces.mobility, point.ends, point.fraction)
        of_facet = zero
        for k in range(3):
            of_facet += nearest.w[k] * nearest.w[k] * number_of(data.surfaces.mobility, nearest.corner[k])
        mobility += of_facet
        radius = data.surfaces.radius[pair.mine]
        other_radius = data.surfaces.radius[pair.other]
        two_sided = data.surfaces.solid[pair.mine] == 0
        mine = triangle_of(x, v, point.host, radius)
        other = triangle_of(x, v, nearest.corner, other_radius)
        damping = damping_fraction(data, point, wp.static(int(measuring)))
        gap = wp.sqrt(nearest.squared)
        overlap = pair.thickness - gap
        if wp.static(overlapping_at_start):
            overlap = overlap - data.history.initial_overlap[p]
        bears = overlap > zero and mobility > zero
        if bears:
            before, fastest_before = moved_along(past, pair.other)
            normal = V()
            if gap > zero:
                normal = nearest.away / gap
            own = wp.normalize(mine.normal)
            facing = wp.dot(own, normal)
            if two_sided and facing > zero:
                own = -own
                facing = -facing
            if facing > scalar(-FACING):
                own = V()
            arm = V()
            other_arm = V()
            u_c = u
            if pair.friction > zero:
                # Friction acts where the shells meet. A side that can take no couple has the point on itself.
                fraction = half
                if radius + other_radius > zero:
                    fraction = radius / (radius + other_radius)
                if mine.inverse == zero:
                    fraction = zero
                elif other.inverse == zero:
                    fraction = one
                arm = -fraction * gap * normal
                if other.inverse > zero:
                    other_arm = (one - fraction) * gap * normal
                u_c += wp.cross(turn_by(mine, mine.spin), arm)
                u_c -= wp.cross(turn_by(other, other.spin), other_arm)
            k_n, f_n, f_t, moved, fastest, u_n, u_t, slides = press(
                pair,
                point.density,
                damping,
                mobility,
                of_facet,
                overlap,
                normal,
                own,
                u,
                u_c,
                before,
                fastest_before,
                step,
            )
            if wp.static(measuring):
                k_t = tangential * k_n
                energy = wp.float64(half * (k_n * overlap * overlap + k_t * wp.dot(moved, moved)))
                heat = (k_n * overlap - f_n) * u_n - wp.dot(f_t, u_t)
                if not slides:
                    heat -= k_t * wp.dot(moved, u_t)
                power = wp.float64(heat)
            else:
                on = data.surfaces.force
                f = f_n * normal + f_t
                by = per_unit_of(data, pair.mine, step)
                w = on_host(point)
                exert(on, point.host, mine, f, w[1] * f, w[2] * f, wp.cross(arm, f_t), by, lane, step.parts)
                w = -nearest.w
                couple = wp.cross(f_t, other_arm)
                exert(on, nearest.corner, other, -f, w[1] * f, w[2] * f, couple, by, lane, step.parts)
                if lane == 0:
                    record(data, p, pair.mine, k_n, overlap, step, flags)
        return bears, moved, fastest, energy, power

    return bear


@functools.cache
def evaluate_contact(
    scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False, measuring: bool = False
):
    """Compose the kernel that sums the contact forces of points; each point has `lanes` threads.

    If `measuring`, it computes the energy that contacts store [J] and the power that they dissipate [W]. If shells
    of bodies overlap at the start (`overlapping_at_start`), only the excess over an allowed overlap counts. The
    allowance shrinks to 0, so that bodies are moved apart slowly and not thrown.
    """
    Data, Step = BodyContactData(scalar), Substep(scalar)
    point_of, held, load = points(scalar)[1], recall(scalar)[0], records(3, scalar).load
    _, candidate_at, find_nearest = nearest_facets(scalar, lanes, worlds)
    bear = bearing(scalar, overlapping_at_start, measuring, lanes, worlds)
    _, no_memory, remember, keep, shrink_overlap = memories(scalar)
    wait, count_touching, zero = wait_for_lanes(lanes), crowding(scalar)[1], scalar(0.0)

    @wp.func
    def evaluate_point(
        data: Data,
        p: int,
        lane: int,  # index among the threads of the point
        step: Step,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        memory = no_memory()
        past = held(data, p)  # read early: on a GPU the latencies of such reads overlap
        point = point_of(data, p)
        n = data.neighbors.candidate_count[p]
        first = int(0)
        if wp.static(measuring):  # sums of floats depend on their order
            first = next_in_order(data.neighbors.candidate_pair, data.neighbors.body_pairs, p, point.body, n, -1)
        leading = candidate_at(data, p, first)
        candidate = candidate_at(data, p, first + lane)
        while first < n:
            # The facets of one body are adjacent in the row; the nearest one counts.
            pair = data.neighbors.pairs[point.body, leading.place]
            a = load(data.surfaces.x, candidate.facet[0])
            b = load(data.surfaces.x, candidate.facet[1])
            c = load(data.surfaces.x, candidate.facet[2])
            # The first facet in the list was the nearest: if the bodies have not come so near, none touches.
            paths = data.neighbors.moved[point.body] + data.neighbors.moved[pair.other]
            if wp.static(not measuring):
                doubt = scalar(wp.static(ROUNDING[scalar])) * wp.length(point.x)
                if scalar(ALMOST) * leading.distance - scalar(paths) - doubt > pair.thickness:
                    if data.neighbors.candidate_pair[p, n - 1] == pair.place:
                        break
            shrunk = scalar(paths) + scalar(DOUBT) * step.buffer
            nearest = find_nearest(data, point, n, lane, first, candidate, a, b, c, pair, shrunk)
            if nearest.squared < pair.thickness * pair.thickness:
                bears, moved, fastest, more, heat = bear(data, point, lane, pair, nearest, past, step, flags)
                if bears:
                    energy += more
                    power += heat
                    memory = remember(memory, pair.other, moved, fastest)
            first = nearest.until
            if wp.static(measuring):
                first = next_in_order(
                    data.neighbors.candidate_pair, data.neighbors.body_pairs, p, point.body, n, pair.other
                )
            leading = candidate_at(data, p, first)
            candidate = candidate_at(data, p, first + lane)
        wait()  # before the history is written, all threads of the point have read it
        if lane == 0:
            if wp.static(measuring):
                stored[p] = energy
                heated[p] = power
            else:
                # A later stage keeps only what has met since the substep began: it sees the fastest approach.
                if n > 0 and (step.h > zero or past.body_0 < 0):
                    keep(data, p, memory)
                    if memory.body_0 < wp.static(NONE):
                        count_touching(data, point, step.parts)
                if wp.static(overlapping_at_start):
                    shrink_overlap(data, p, step.h)

    return each_active_point(evaluate_point, scalar, lanes, counts_time=not measuring)
