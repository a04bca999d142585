"""The forces of contact between bodies: a spring and a damper along the normal, and friction that sticks.

For a point at x that overlaps a facet by δ, with the unit normal n out of the facet and the relative velocity u:

    f_n = max(0, k δ − b_n u·n)
    ξ is turned into the plane of contact, ξ += h u_t, and shortened to at most μ f_n / k_t
    f_t = −k_t ξ − b_t u_t, shortened to at most μ f_n

The facet's corners take the opposite force by the weights of the nearest point. Forces are summed as integers in a
small unit. Such sums do not depend on their order: runs repeat to the last bit, and the forces between two bodies
cancel exactly.
Reference: Cundall and Strack, A discrete numerical model for granular assemblies, Géotechnique 29 (1979).
"""

import functools

import warp as wp

from ..basis import vector
from .contact_data import BodyContactData, Substep
from .force_sums import exert_force
from .history import displacements, memories, note_tunnelling
from .lanes import each_active_point, wait_for_lanes
from .law import TANGENTIAL, contact_law
from .nearest_facet import facing, nearest_facets
from .pairs import FAR, Pair, next_in_order, pairs, places, points, unit_normal


@functools.cache
def evaluate_contact(scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that sums the contact forces of points; `lanes` of its threads share a point.

    Where bodies start inside each other (`overlapping_at_start`), only the excess over an allowed overlap counts.
    The allowance shrinks to 0, so that bodies are moved apart slowly and not thrown.
    """
    return _each_point(scalar, overlapping_at_start, False, lanes, worlds)


@functools.cache
def contact_energy(scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that computes the energy that contacts store [J] and the power they dissipate [W]."""
    return _each_point(scalar, overlapping_at_start, True, lanes, worlds)


@wp.func
def both_closed(closed: wp.array(dtype=int), mine: int, other: int) -> bool:
    """Tell whether both bodies are closed. Only such a pair can tunnel: `division_planes` keeps others apart."""
    return closed[mine] != 0 and closed[other] != 0


@functools.cache
def bearing(scalar: type, overlapping_at_start: bool, measuring: bool, lanes: int, worlds: bool):
    """Compose (bear, note_fast): the force of one contact, and a record of points that skip a facet in a substep.

    `bear` returns whether the contact exerts a force, its tangential displacement [m], and, if `measuring`, its
    stored energy [J] and dissipated power [W].
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar, worlds), Substep(scalar)
    (Point, _, mobility_of), PointAndBody = points(scalar, worlds), Pair(scalar)
    Nearest, _, separate = nearest_facets(scalar, lanes, worlds)
    (place_of, place_on, _), normal_of = places(scalar), unit_normal(scalar)
    press, record, per_unit_of = contact_law(scalar, overlapping_at_start, worlds)
    moved_along, note = displacements(scalar), note_tunnelling(scalar)
    thickness_of, exert = pairs(scalar, worlds)[1], exert_force(scalar, lanes)
    facing_of = facing(scalar, worlds)
    zero, half, tangential = scalar(0.0), scalar(0.5), scalar(TANGENTIAL)

    @wp.func
    def bear(
        data: Data,
        point: Point,
        lane: int,
        pair: PointAndBody,
        nearest: Nearest,
        away: V,
        step: Step,
        flags: wp.array(dtype=float),
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        moved = V()
        p = point.number
        # Distant memory is read early, even if there turns out to be no contact.
        v = data.surfaces.v
        u = place_of(v, point.ends, point.share) - place_on(v, nearest.corner, nearest.w)
        mobility = mobility_of(data.surfaces.mobility, point.ends, point.share)
        for k in range(3):
            mobility += nearest.w[k] * nearest.w[k] * data.surfaces.mobility[nearest.corner[k]]
        thickness = thickness_of(data, pair.rule, pair.mine, pair.other)
        gap, normal = separate(data, point, lane, pair, nearest, away, step.buffer)
        overlap = thickness - gap
        if wp.static(overlapping_at_start):
            overlap = overlap - data.history.initial_overlap[p]
        bears = overlap > zero and mobility > zero
        if bears:
            bodies = data.history.contact_body
            displacement = data.history.tangential_displacement
            before = moved_along(bodies, displacement, p, pair.other)
            faces = facing_of(data, point, pair.other, normal)
            k_n, f_n, f_t, moved, u_n, slides = press(
                data, pair, mobility, overlap, normal, faces, u, before, step
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
                if lane == 0 and step.h > zero and both_closed(data.surfaces.closed, pair.mine, pair.other):
                    # The vertex of a point has as much force from each of its other points.
                    u_n += step.h * f_n * mobility / data.surfaces.density[pair.mine]
                    least = zero
                    if data.surfaces.closed[pair.other] != 0 and pair.mine != pair.other:
                        least = -pair.reach
                    if wp.static(overlapping_at_start):
                        least = least - data.history.initial_overlap[p]
                    note(data.tunnelling, p, nearest.facet, point.x, gap + step.h * u_n, least, -u_n)
        return bears, moved, energy, power

    @wp.func
    def note_fast(data: Data, point: Point, pair: PointAndBody, nearest: Nearest, away: V, h: scalar):
        """Record a point that passes a facet within the substep without ever being in contact."""
        gap = wp.sqrt(nearest.squared)
        v = data.surfaces.v
        u = place_of(v, point.ends, point.share) - place_on(v, nearest.corner, nearest.w)
        u_n = wp.dot(u, away) / gap
        least = zero
        if data.surfaces.closed[pair.other] != 0 and pair.mine != pair.other:
            least = -pair.reach
            if wp.dot(away, normal_of(data.surfaces.x, nearest.corner)) < zero:
                u_n = zero  # already inside, too deep to be pushed out
        note(data.tunnelling, point.number, nearest.facet, point.x, gap + h * u_n, least, -u_n)

    return bear, note_fast


def _each_point(scalar: type, overlapping_at_start: bool, measuring: bool, lanes: int, worlds: bool):
    Data, Step = BodyContactData(scalar, worlds), Substep(scalar)
    place_on, (find_rule, _, reach_of, _) = places(scalar)[1], pairs(scalar, worlds)
    point_of, PointAndBody = points(scalar, worlds)[1], Pair(scalar)
    _, find_nearest, _ = nearest_facets(scalar, lanes, worlds)
    bear, note_fast = bearing(scalar, overlapping_at_start, measuring, lanes, worlds)
    _, no_memory, remember, keep, shrink_overlap = memories(scalar, worlds)
    wait = wait_for_lanes(lanes)
    zero, far = scalar(0.0), scalar(FAR)

    @wp.func
    def pair_of(data: Data, mine: int, other: int) -> PointAndBody:
        """Return the contact rule and its range for a point of body `mine` and the facets of body `other`."""
        pair = PointAndBody()
        pair.mine = mine
        pair.other = other
        pair.rule = find_rule(data, mine, other)
        pair.reach = reach_of(data, pair.rule, mine, other)
        return pair

    @wp.func
    def evaluate_point(
        data: Data,
        p: int,
        lane: int,  # index of this thread among those of the point
        step: Step,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        memory = no_memory()
        point = point_of(data, p)
        n = data.neighbors.candidate_count[p]
        first = int(0)
        if wp.static(measuring):  # sums of floats depend on their order
            first = next_in_order(data.neighbors.candidate_body, p, n, -1)
        while first < n:
            # The facets of one body are adjacent in the row; the nearest one counts.
            pair = pair_of(data, point.body, data.neighbors.candidate_body[p, first])
            nearest = find_nearest(data, point, lane, pair, first, step.buffer)
            away = point.x - place_on(data.surfaces.x, nearest.corner, nearest.w)
            if nearest.squared < pair.reach * pair.reach:
                bears, moved, more, heat = bear(data, point, lane, pair, nearest, away, step, flags)
                if bears:
                    energy += more
                    power += heat
                    memory = remember(memory, pair.other, moved)
            elif step.h > zero and lane == 0 and nearest.squared < far:
                if both_closed(data.surfaces.closed, pair.mine, pair.other):
                    note_fast(data, point, pair, nearest, away, step.h)
            first = nearest.until
            if wp.static(measuring):
                first = next_in_order(data.neighbors.candidate_body, p, n, pair.other)
        wait()  # the others have read the history, which is now written
        if lane == 0:
            if wp.static(measuring):
                stored[p] = energy
                heated[p] = power
            else:
                if n > 0 and step.h > zero:
                    keep(data, p, memory)
                if wp.static(overlapping_at_start):
                    shrink_overlap(data, p, step.h)

    return each_active_point(evaluate_point, scalar, lanes, worlds)
