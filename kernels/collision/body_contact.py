"""The forces of contact between bodies: a spring and a damper along the normal, and friction that sticks.

For a point at x that overlaps a facet by δ, with the unit normal n out of the facet and the relative velocity u:

    f_n = max(0, k δ − b_n u·n)
    ξ is projected onto the plane of contact, ξ += h u_t, and limited to the length μ f_n / k_t
    f_t = −k_t ξ − b_t u_t, limited to μ f_n

The opposite force is divided among the facet's corners by the barycentric weights of the nearest point. Forces are
summed as integers in a small unit. Such sums do not depend on their order: runs repeat to the last bit, and the
forces between two bodies cancel exactly.
Reference: Cundall and Strack, A discrete numerical model for granular assemblies, Géotechnique 29 (1979).
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import wait_for_lanes
from ..records import table
from .contact_data import STORED, BodyContactData, Substep
from .force_sums import exert_force
from .history import displacements, memories
from .law import TANGENTIAL, contact_law, damping_limits
from .nearest_facet import facing, nearest_facets
from .neighbor_search import each_active_point
from .pairs import FAR, NONE, Pair, next_in_order, places, points


@functools.cache
def evaluate_contact(
    scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False, limited: bool = False
):
    """Compose the kernel that sums the contact forces of points; each point has `lanes` threads.

    If `limited`, dampers are limited by the number of contacts, from `count_contacts`. If bodies start inside each
    other (`overlapping_at_start`), only the excess over an allowed overlap counts. The allowance shrinks to 0, so
    that bodies are moved apart slowly and not thrown.
    """
    return _each_point(scalar, overlapping_at_start, False, lanes, worlds, limited)


@functools.cache
def contact_energy(
    scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False, limited: bool = False
):
    """Compose the kernel that computes the energy that contacts store [J] and the power they dissipate [W]."""
    return _each_point(scalar, overlapping_at_start, True, lanes, worlds, limited)


@functools.cache
def bearing(scalar: type, overlapping_at_start: bool, measuring: bool, lanes: int, worlds: bool, limited: bool):
    """Compose the function that adds the force of one contact to its vertices.

    It returns whether there is a force, the tangential displacement [m], and, if `measuring`, the stored energy
    [J] and the dissipated power [W].
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar, worlds), Substep(scalar)
    (Point, _, mobility_of), PointAndBody = points(scalar, worlds), Pair(scalar)
    Memory = memories(scalar, worlds)[0]
    Nearest = nearest_facets(scalar, lanes, worlds)[0]
    place_of, place_on, _ = places(scalar)
    press, record, per_unit_of = contact_law(scalar, overlapping_at_start, worlds)
    moved_along = displacements(scalar, worlds)[1]
    exert, number_of = exert_force(scalar, lanes), table(scalar)
    facing_of, load = facing(scalar, lanes), damping_limits(scalar, lanes)[1]
    zero, half, tangential, far = scalar(0.0), scalar(0.5), scalar(TANGENTIAL), scalar(FAR)

    @wp.func
    def bear(
        data: Data,
        point: Point,
        lane: int,
        pair: PointAndBody,
        nearest: Nearest,
        gap: scalar,  # [m]
        normal: V,
        past: Memory,  # contact history of the point
        step: Step,
        flags: wp.array(dtype=float),
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        moved = V()
        p = point.number
        # Slow memory is read early, even if no contact is found afterwards.
        v = data.surfaces.v
        u = place_of(v, point.ends, point.share) - place_on(v, nearest.corner, nearest.w)
        mobility = mobility_of(data.surfaces.mobility, point.ends, point.share)
        for k in range(3):
            mobility += nearest.w[k] * nearest.w[k] * number_of(data.surfaces.mobility, nearest.corner[k])
        overlap = pair.thickness - gap
        if wp.static(overlapping_at_start):
            overlap = overlap - data.history.initial_overlap[p]
        bears = overlap > zero and mobility > zero
        if bears:
            before = moved_along(past, pair.other)
            faces = scalar(1.0)
            if pair.closed != 0:
                faces = facing_of(
                    data.surfaces.first_facet,
                    data.surfaces.facet,
                    data.surfaces.corner,
                    data.surfaces.x,
                    point.ends,
                    normal,
                    data.surfaces.closed[pair.mine],
                    lane,
                )
            strongest = far
            if wp.static(limited):
                world = int(0)
                if wp.static(worlds):
                    world = pair.mine / data.surfaces.bodies_each
                strongest = data.surfaces.damping_limit[world] / load(
                    data.surfaces.first,
                    data.surfaces.particle,
                    data.surfaces.weight,
                    data.surfaces.touches,
                    data.surfaces.inverse_mass,
                    point.ends,
                    point.share,
                    nearest.corner,
                    nearest.w,
                    lane,
                )
            k_n, f_n, f_t, moved, u_n, slides = press(
                pair, mobility, overlap, normal, faces, strongest, u, before, step
            )
            if wp.static(measuring):
                k_t = tangential * k_n
                u_t = u - u_n * normal
                energy = wp.float64(half * (k_n * overlap * overlap + k_t * wp.dot(moved, moved)))
                heat = (k_n * overlap - f_n) * u_n - wp.dot(f_t, u_t)
                if not slides:
                    heat -= k_t * wp.dot(moved, u_t)
                power = wp.float64(heat)
            else:
                on = data.surfaces.force
                f = f_n * normal + f_t
                by = per_unit_of(data, pair.mine, step)
                exert(on, point.ends, point.share, nearest.corner, nearest.w, f, by, lane, step.parts)
                if lane == 0:
                    record(data, p, pair.mine, k_n, overlap, step, flags)
        return bears, moved, energy, power

    return bear


@functools.cache
def count_contacts(scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that counts the contacts of each particle, before `evaluate_contact`.

    For the first bodies near each point it stores the nearest facet, which `evaluate_contact` reads.
    """
    Data, Step = BodyContactData(scalar, worlds), Substep(scalar)
    place_on, point_of = places(scalar)[1], points(scalar, worlds)[1]
    _, find_nearest, separate = nearest_facets(scalar, lanes, worlds)
    count, Side = damping_limits(scalar, lanes)[0], wp.types.vector(4, scalar)
    zero, far = scalar(0.0), scalar(FAR)

    @wp.func
    def count_of_point(
        data: Data,
        p: int,
        lane: int,
        step: Step,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        point = point_of(data, p)
        first = int(0)
        slot = int(0)
        while first < data.neighbors.candidate_count[p]:
            pair = data.neighbors.pairs[point.body, data.neighbors.candidate_pair[p, first]]
            nearest = find_nearest(data, point, lane, pair, first, step.buffer)
            side = Side(zero, zero, zero, far)
            if nearest.squared < pair.reach * pair.reach:
                away = point.x - place_on(data.surfaces.x, nearest.corner, nearest.w)
                gap, normal = separate(data, point, lane, pair, nearest, away, step.buffer)
                side = Side(normal[0], normal[1], normal[2], gap)
                overlap = pair.thickness - gap
                if wp.static(overlapping_at_start):
                    overlap -= data.history.initial_overlap[p]
                if overlap > zero:
                    first_of, particle = data.surfaces.first, data.surfaces.particle
                    count(first_of, particle, data.surfaces.touches, point.ends, nearest.corner, nearest.w, lane)
            if lane == 0 and slot < wp.static(STORED):
                data.contacts.facet[slot, p] = nearest.facet
                data.contacts.until[slot, p] = nearest.until
                data.contacts.weights[slot, p] = nearest.w
                data.contacts.side[slot, p] = side
            first = nearest.until
            slot += 1

    return each_active_point(count_of_point, scalar, lanes, worlds)


def _each_point(
    scalar: type, overlapping_at_start: bool, measuring: bool, lanes: int, worlds: bool, limited: bool
):
    Data, Step = BodyContactData(scalar, worlds), Substep(scalar)
    place_on, point_of, held = places(scalar)[1], points(scalar, worlds)[1], displacements(scalar, worlds)[0]
    Nearest, find_nearest, separate = nearest_facets(scalar, lanes, worlds)
    bear = bearing(scalar, overlapping_at_start, measuring, lanes, worlds, limited)
    _, no_memory, remember, keep, shrink_overlap = memories(scalar, worlds)
    wait, corner_of = wait_for_lanes(lanes), table(wp.vec3i)
    V, zero, far, counted = vector(3, scalar), scalar(0.0), scalar(FAR), limited and not measuring

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
        slot = int(0)
        if wp.static(measuring):  # sums of floats depend on their order
            first = next_in_order(data.neighbors.candidate_pair, data.neighbors.body_pairs, p, point.body, n, -1)
        while first < n:
            # The facets of one body are adjacent in the row; the nearest one counts.
            pair = data.neighbors.pairs[point.body, data.neighbors.candidate_pair[p, first]]
            nearest = Nearest()
            gap = far
            normal = V()
            known = bool(False)
            if wp.static(counted):  # `count_contacts` has found it
                known = slot < wp.static(STORED)
                if known:
                    side = data.contacts.side[slot, p]
                    gap = side[3]
                    normal = V(side[0], side[1], side[2])
                    nearest.facet = data.contacts.facet[slot, p]
                    nearest.until = data.contacts.until[slot, p]
                    nearest.w = data.contacts.weights[slot, p]
                    nearest.corner = corner_of(data.surfaces.corner, nearest.facet % wp.static(NONE))
            if not known:
                nearest = find_nearest(data, point, lane, pair, first, step.buffer)
            away = point.x - place_on(data.surfaces.x, nearest.corner, nearest.w)
            if known:
                nearest.squared = far
                if nearest.facet != wp.static(NONE):
                    nearest.squared = wp.length_sq(away)
            slot += 1
            if nearest.squared < pair.reach * pair.reach:
                if not known:
                    gap, normal = separate(data, point, lane, pair, nearest, away, step.buffer)
                bears, moved, more, heat = bear(data, point, lane, pair, nearest, gap, normal, past, step, flags)
                if bears:
                    energy += more
                    power += heat
                    memory = remember(memory, pair.other, moved)
            first = nearest.until
            if wp.static(measuring):
                first = next_in_order(
                    data.neighbors.candidate_pair, data.neighbors.body_pairs, p, point.body, n, pair.other
                )
        wait()  # before the history is written, all threads of the point have read it
        if lane == 0:
            if wp.static(measuring):
                stored[p] = energy
                heated[p] = power
            else:
                if n > 0 and step.h > zero:
                    keep(data, p, memory)
                if wp.static(overlapping_at_start):
                    shrink_overlap(data, p, step.h)

    return each_active_point(evaluate_point, scalar, lanes, worlds, counts_time=not measuring)
