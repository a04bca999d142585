"""Contact where there are no triangles: between grains, and ropes. The law is that of `evaluate`."""

import functools

import warp as wp

from ..basis import kernel, vector
from .contact_data import DEEPEST, BodyContactData, first_flag
from .cpu_partition import first_of_part, next_of_part, raise_to
from .force_sums import Units, exert_on_segments
from .lanes import FAST, bounds_of_blocks, chosen_of_lanes, least_of_lanes
from .law import contact_law
from .pairs import ALMOST, FAR, NONE, pairs, places, points
from .tunnelling import note_overrun


@functools.cache
def evaluate_segments_and_spheres(scalar: type, overlapping_at_start: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that adds up the forces of the contacts of points, where no facet is a triangle.

    Such bodies have no inside and no sides, and are many: so the threads that share a point (`lanes`) take bodies
    near it, each its own. `overlapping_at_start` is as for `evaluate_contact`.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)
    (place_of, place_on, _), (mobility_of, slip_before) = places(scalar), points(scalar)
    find_rule, thickness_of, _, stiffness_of = pairs(scalar, worlds)
    note, first_of, press = note_overrun(scalar), first_flag(scalar, worlds), contact_law(scalar)
    in_units, take_from, add_to = exert_on_segments(scalar)
    least_number, pick = least_of_lanes(int, lanes), chosen_of_lanes(scalar, lanes)
    zero, one, almost, far = scalar(0.0), scalar(1.0), scalar(ALMOST), scalar(FAR)

    @wp.func
    def share_of(x: wp.array(dtype=V), corner: wp.vec3i, p: V) -> scalar:
        """Return the share of the second end in the place on a segment that is nearest to p; 0 on a grain."""
        start = place_on(x, corner, V(one, zero, zero))
        along = place_on(x, corner, V(zero, one, zero)) - start
        squared = wp.length_sq(along)
        share = zero
        if squared > zero:
            share = wp.clamp(wp.dot(p - start, along) / squared, zero, one)
        return share

    @wp.func
    def evaluate_point(
        data: Data,
        p: int,
        lane: int,  # which of the threads that share the point this is
        h: scalar,
        behind: scalar,
        per_unit: wp.float64,
        buffer: wp.array(dtype=scalar),
        parts: int,
        flags: wp.array(dtype=float),
    ):
        n = data.neighbors.candidate_count[p]
        ends = data.surfaces.ends[p]
        s = data.surfaces.share[p]
        x = place_of(data.surfaces.x, ends, s)
        mine = data.surfaces.body[p]
        # Of the bodies that this thread finds in touch, the two with the least numbers.
        partner_0 = int(wp.static(NONE))
        partner_1 = int(wp.static(NONE))
        slip_0 = V()
        slip_1 = V()
        total = Units()  # of the forces on the point
        for first in range(lane, n, wp.static(lanes)):
            other = data.neighbors.candidate_body[p, first]
            begins = bool(True)  # here those of a body begin, which are side by side
            if first > 0:
                begins = data.neighbors.candidate_body[p, first - 1] != other
            if begins:
                best = far
                near = far
                facet = int(wp.static(NONE))
                t = scalar(0.0)
                for e in range(first, n):
                    if data.neighbors.candidate_body[p, e] != other:
                        break
                    if almost * data.neighbors.candidate_distance[p, e] <= near:
                        f = data.neighbors.candidates[p, e]
                        corner = data.surfaces.corner[f]
                        t_f = share_of(data.surfaces.x, corner, x)
                        squared = wp.length_sq(x - place_on(data.surfaces.x, corner, V(one - t_f, t_f, zero)))
                        if squared < best or (squared == best and f < facet):
                            best = squared
                            near = wp.sqrt(best) + buffer[0]
                            facet = f
                            t = t_f
                corner = data.surfaces.corner[facet % wp.static(NONE)]  # 0 where nothing is anywhere
                w = V(one - t, t, zero)
                rule = find_rule(data, mine, other)
                away = x - place_on(data.surfaces.x, corner, w)
                u = place_of(data.surfaces.v, ends, s) - place_on(data.surfaces.v, corner, w)
                gap = wp.sqrt(best)
                normal = V()
                if gap > zero:
                    normal = away / gap
                overlap = thickness_of(data, rule, mine, other) - gap
                if wp.static(overlapping_at_start):
                    overlap = overlap - data.history.initial_overlap[p]
                mobility = zero
                if overlap > zero:  # most that is listed does not touch: reading from memory is what takes time
                    mobility = mobility_of(data.surfaces.mobility, ends, s)
                    mobility += (
                        w[0] * w[0] * data.surfaces.mobility[corner[0]] + t * t * data.surfaces.mobility[corner[1]]
                    )
                u_n = wp.dot(u, normal)
                least = zero
                if mobility > zero:
                    k_n = stiffness_of(data, rule, mine, other)
                    # A point that was touching this body before may stick to it.
                    tangential_displacement = slip_before(
                        data.history.contact_body, data.history.tangential_displacement, p, other
                    )
                    zeta = data.rules.damping[rule]
                    mu = data.rules.friction[rule]
                    f_n, f_t, tangential_displacement, u_n, _slides = press(
                        k_n,
                        zeta,
                        mu,
                        data.surfaces.density[mine],
                        mobility,
                        overlap,
                        normal,
                        u,
                        tangential_displacement,
                        h,
                        behind,
                    )
                    by = per_unit
                    if wp.static(worlds):
                        by = wp.float64(1.0) / data.surfaces.unit[mine / data.surfaces.bodies_each]
                    units = in_units(f_n * normal + f_t, by)
                    take_from(data.surfaces.force, corner[0], corner[1], t, units, parts)
                    total += units
                    if wp.static(overlapping_at_start):
                        led = wp.min(data.history.initial_overlap[p], h * data.history.overlap_release_speed)
                        wp.atomic_add(data.history.done, p, wp.float64(k_n * overlap) * wp.float64(led))
                        least = least - data.history.initial_overlap[p]
                    at = first_of(data, mine) + wp.static(DEEPEST)
                    if float(overlap) > flags[at]:
                        raise_to(flags, at, float(overlap))
                    # The vertex of a point bears as much for each of its other points.
                    u_n += h * f_n * mobility / data.surfaces.density[mine]
                    if other < partner_0:
                        partner_1 = partner_0
                        slip_1 = slip_0
                        partner_0 = other
                        slip_0 = tangential_displacement
                    elif other < partner_1:
                        partner_1 = other
                        slip_1 = tangential_displacement
                if h > zero:
                    # Also what comes so fast that a substep takes it through has never been in touch.
                    note(data.tunnelling, p, facet, x, gap + h * u_n, least, -u_n)
        add_to(data.surfaces.force, ends, s, total, parts)
        for k in range(2):  # of those that all threads have found
            contact_body = least_number(partner_0)
            own = partner_0 == contact_body
            tangential_displacement = V(pick(own, slip_0[0]), pick(own, slip_0[1]), pick(own, slip_0[2]))
            if own:
                partner_0 = partner_1
                slip_0 = slip_1
                partner_1 = int(wp.static(NONE))
            if h > zero and lane == 0:
                data.history.tangential_displacement[k, p] = tangential_displacement
                data.history.contact_body[k, p] = contact_body
                if contact_body == wp.static(NONE):
                    data.history.tangential_displacement[k, p] = V()
                    data.history.contact_body[k, p] = -1
        if wp.static(overlapping_at_start):
            if lane == 0:
                data.history.initial_overlap[p] = wp.max(
                    zero, data.history.initial_overlap[p] - h * data.history.overlap_release_speed
                )

    def touch_points(
        data: Data,
        h: scalar,  # length of the substep that begins [s]; 0 where none does, and nothing may slip further
        behind: scalar,  # twice the time by which velocities lag behind positions [s]
        per_unit: wp.float64,  # of forces [1/N]; of worlds each has its own
        buffer: wp.array(dtype=scalar),  # by how much distances may have become less since rows were found [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # that threads of the CPU take
        flags: wp.array(dtype=float),
    ):
        k = first_of_part(wp.tid(), part) / wp.static(lanes)
        lane = wp.tid() % wp.static(lanes)
        while k < data.neighbors.active_count[0]:
            evaluate_point(data, data.neighbors.active_points[k], lane, h, behind, per_unit, buffer, parts, flags)
            k = next_of_part(k, threads / wp.static(lanes), parts)

    return kernel(touch_points, launch_bounds=bounds_of_blocks(scalar), module_options=FAST)
