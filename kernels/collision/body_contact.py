"""The forces of contact between bodies: a spring and a damper along the normal, and friction that sticks.

For a point at x that overlaps a facet by δ, with the unit normal n out of the facet and the relative velocity u:

    f_n = max(0, k δ − b_n u·n)
    ξ is turned into the plane of contact, ξ += h u_t, and shortened to at most μ f_n / k_t
    f_t = −k_t ξ − b_t u_t, shortened to at most μ f_n

The facet's corners take the opposite force by the weights of the nearest point. Forces are summed as whole numbers
of a small unit: such sums do not depend on their order, so that runs repeat to the last bit, and what two exert on
each other cancels exactly.
Reference: Cundall and Strack, A discrete numerical model for granular assemblies, Géotechnique 29 (1979).
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from .contact_data import DEEPEST, HISTORY, BodyContactData, first_flag
from .cpu_partition import first_of_part, next_of_part, raise_to
from .force_sums import exert_force
from .friction import TANGENTIAL
from .lanes import FAST, bounds_of_blocks, chosen_of_lanes, least_of_lanes
from .law import contact_law
from .pairs import ALMOST, FAR, NONE, next_in_order, pairs, places, points, unit_normal
from .sheet_sides import STEEP, meets, remembered
from .tunnelling import note_overrun


@functools.cache
def evaluate_contact(scalar: type, overlapping_at_start: bool, sided: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that adds up the forces of the contacts of points. Its threads share those that are busy.

    So many of them (`lanes`) share each point.

    Where bodies start inside each other (`overlapping_at_start`), an overlap counts by what it exceeds one that is
    allowed, which shrinks to nothing: they are led apart, not thrown. Where there are sheets (`sided`), points
    remember on which side of them they are.
    """
    return _each_point(scalar, overlapping_at_start, sided, False, lanes, worlds)


@functools.cache
def contact_energy(scalar: type, overlapping_at_start: bool, sided: bool, lanes: int, worlds: bool = False):
    """Compose the kernel of what the contacts of points store [J] and turn to heat [W]."""
    return _each_point(scalar, overlapping_at_start, sided, True, lanes, worlds)


def _each_point(scalar: type, overlapping_at_start: bool, sided: bool, measuring: bool, lanes: int, worlds: bool):
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)
    (place_of, place_on, nearest_to), normal_of = places(scalar), unit_normal(scalar)
    find_rule, thickness_of, reach_of, stiffness_of = pairs(scalar, worlds)
    mobility_of, slip_before = points(scalar)
    note, first_of = note_overrun(scalar), first_flag(scalar, worlds)
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    pick, load = chosen_of_lanes(scalar, lanes), records(3, scalar).load
    zero, almost, far = scalar(0.0), scalar(ALMOST), scalar(FAR)
    tangential, press = scalar(TANGENTIAL), contact_law(scalar)
    exert, have_common, slip_on, steep = exert_force(scalar, lanes), meets(), remembered(scalar), scalar(STEEP)

    @wp.func
    def evaluate_point(
        data: Data,
        p: int,
        lane: int,  # which of the threads that share the point this is
        h: scalar,  # length of the substep that begins [s]; 0 where none does, and nothing may slip further
        behind: scalar,  # twice the time by which velocities lag behind positions [s]
        per_unit: wp.float64,  # of forces [1/N]; of worlds each has its own
        buffer: wp.array(dtype=scalar),  # by how much distances may have become less since rows were found [m]
        parts: int,  # that threads of the CPU take
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),  # [J], shape [point_count], where measured
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        n = data.neighbors.candidate_count[p]
        if n > 0:
            ends = data.surfaces.ends[p]
            s = data.surfaces.share[p]
            x = place_of(data.surfaces.x, ends, s)
            mine = data.surfaces.body[p]
            new_partner_0 = int(-1)
            new_partner_1 = int(-1)
            new_slip_0 = V()
            new_slip_1 = V()
            # Of a sheet: first what it is held on this side of, then whatever is opposite to that.
            new_seen_0 = int(0)
            new_seen_1 = int(0)
            away_0 = V()
            away_1 = V()
            turn = int(0)
            first = int(0)
            if wp.static(measuring):  # no whole numbers are summed: their order counts
                first = next_in_order(data.neighbors.candidate_body, p, n, -1)
            while first < n:
                # The facets of one body, which are side by side in the row: the nearest counts.
                other = data.neighbors.candidate_body[p, first]
                held = int(0)
                if wp.static(sided):
                    if turn < wp.static(HISTORY):
                        if data.history.contact_body[turn, p] == other:
                            held = data.history.contact_side[turn, p]
                        if held == 0:
                            turn += 1
                            continue
                rule = find_rule(data, mine, other)
                reach = reach_of(data, rule, mine, other)
                two_sided = bool(False)
                if wp.static(sided):
                    two_sided = data.surfaces.sided[other] != 0 and mine != other
                    if held != 0:
                        reach = wp.max(reach, data.surfaces.depth[other])
                best = far
                near = far
                facet = int(wp.static(NONE))
                entry = int(-1)
                w = V()
                until = int(n)
                for e in range(first + lane, n, wp.static(lanes)):
                    f = data.neighbors.candidates[
                        p, e
                    ]  # before anything is known of it: these three are read at once
                    listed = data.neighbors.candidate_distance[p, e]
                    if data.neighbors.candidate_body[p, e] != other:
                        until = e
                        break
                    if almost * listed <= near:
                        w_f = nearest_to(data.surfaces.x, data.surfaces.corner[f], x)
                        away = x - place_on(data.surfaces.x, data.surfaces.corner[f], w_f)
                        if wp.static(sided):
                            if wp.dot(away, away_0) > zero or wp.dot(away, away_1) > zero:
                                continue
                            if held != 0:
                                if not have_common(data.surfaces.corner, wp.abs(held) - 1, f):
                                    continue
                        if wp.dot(away, away) < best or (wp.dot(away, away) == best and f < facet):
                            best = wp.dot(away, away)
                            near = wp.sqrt(best) + buffer[0]
                            facet = f
                            entry = e
                            w = w_f
                w_own = w  # on the nearest of those that this thread has looked at
                if wp.static(lanes > 1):
                    until = least_number(until)
                    nearest = least_of(best)
                    if best > nearest:
                        facet = int(wp.static(NONE))
                    best = nearest
                    own = facet
                    facet = least_number(facet)
                    for k in range(3):
                        w[k] = pick(own == facet, w_own[k])
                corner = data.surfaces.corner[facet % wp.static(NONE)]  # 0 where nothing is anywhere
                if best < reach * reach:
                    # What is far in memory is read at once, also where it turns out that they do not touch.
                    u = place_of(data.surfaces.v, ends, s) - place_on(data.surfaces.v, corner, w)
                    mobility = mobility_of(data.surfaces.mobility, ends, s)
                    for k in range(3):
                        mobility += w[k] * w[k] * data.surfaces.mobility[corner[k]]
                    thickness = thickness_of(data, rule, mine, other)
                    normal = normal_of(data.surfaces.x, corner)
                    q = place_on(data.surfaces.x, corner, w)
                    side = wp.dot(x - q, normal)
                    closed = data.surfaces.closed[other] != 0 and mine != other
                    within = w[0] > zero and w[1] > zero and w[2] > zero
                    if (closed or two_sided) and not within:
                        # Of triangles around an edge or a corner the one that is seen most steeply tells the side.
                        tie = best * scalar(1.001) + scalar(1.0e-12) * wp.length_sq(
                            load(data.surfaces.x, corner[1]) - load(data.surfaces.x, corner[0])
                        )
                        near = wp.sqrt(tie) + buffer[0]
                        for e in range(first + lane, until, wp.static(lanes)):
                            f = data.neighbors.candidates[p, e]
                            if almost * data.neighbors.candidate_distance[p, e] <= near:
                                w_f = w_own
                                if e != entry:
                                    w_f = nearest_to(data.surfaces.x, data.surfaces.corner[f], x)
                                away = x - place_on(data.surfaces.x, data.surfaces.corner[f], w_f)
                                if wp.dot(away, away) <= tie and (closed or wp.dot(away, x - q) >= almost * best):
                                    seen = wp.dot(away, normal_of(data.surfaces.x, data.surfaces.corner[f]))
                                    steeper = wp.abs(seen) - wp.abs(side)
                                    if steeper > zero or (steeper == zero and seen > side):
                                        side = seen
                        if wp.static(lanes > 1):
                            if wp.abs(side) < -least_of(-wp.abs(side)):
                                side = -far
                            side = -least_of(-side)
                    gap = wp.sqrt(best)
                    if within and wp.length_sq(normal) > zero:
                        gap = wp.abs(side)
                        if side < zero:
                            normal = -normal
                    elif best > zero:
                        normal = (x - q) / gap
                    if closed and side < zero:
                        gap = -gap
                        normal = -normal
                    now = int(0)
                    if wp.static(sided):
                        if two_sided and side * side >= steep * best:
                            now = facet + 1
                            if side < zero:
                                now = -now
                            if (held < 0 and now > 0) or (held > 0 and now < 0):
                                now = -now  # it has come through
                                gap = -gap
                                normal = -normal
                    overlap = thickness - gap
                    if wp.static(overlapping_at_start):
                        overlap = overlap - data.history.initial_overlap[p]
                    if overlap > zero and mobility > zero:
                        k_n = stiffness_of(data, rule, mine, other)
                        # A point that was touching this body before may stick to it.
                        if wp.static(sided):
                            tangential_displacement = slip_on(
                                data.history.contact_body,
                                data.history.contact_side,
                                data.history.tangential_displacement,
                                p,
                                other,
                                held,
                            )
                        else:
                            tangential_displacement = slip_before(
                                data.history.contact_body, data.history.tangential_displacement, p, other
                            )
                        zeta = data.rules.damping[rule]
                        mu = data.rules.friction[rule]
                        f_n, f_t, tangential_displacement, u_n, slides = press(
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
                        if wp.static(measuring):
                            k_t = tangential * k_n
                            u_t = u - u_n * normal
                            energy += wp.float64(
                                scalar(0.5)
                                * (
                                    k_n * overlap * overlap
                                    + k_t * wp.dot(tangential_displacement, tangential_displacement)
                                )
                            )
                            compensation = (k_n * overlap - f_n) * u_n - wp.dot(f_t, u_t)
                            if not slides:
                                compensation -= k_t * wp.dot(tangential_displacement, u_t)
                            power += wp.float64(compensation)
                        else:
                            if wp.static(worlds):
                                by = wp.float64(1.0) / data.surfaces.unit[mine / data.surfaces.bodies_each]
                                exert(data.surfaces.force, ends, s, corner, w, f_n * normal + f_t, by, lane, parts)
                            else:
                                exert(
                                    data.surfaces.force,
                                    ends,
                                    s,
                                    corner,
                                    w,
                                    f_n * normal + f_t,
                                    per_unit,
                                    lane,
                                    parts,
                                )
                            if lane == 0:
                                if wp.static(overlapping_at_start):
                                    led = wp.min(
                                        data.history.initial_overlap[p], h * data.history.overlap_release_speed
                                    )
                                    data.history.done[p] = data.history.done[p] + wp.float64(
                                        k_n * overlap
                                    ) * wp.float64(led)
                                at = first_of(data, mine) + wp.static(DEEPEST)
                                if float(overlap) > flags[at]:
                                    raise_to(flags, at, float(overlap))
                                if h > zero:
                                    # The vertex of a point bears as much for each of its other points.
                                    u_n += h * f_n * mobility / data.surfaces.density[mine]
                                    least = zero
                                    if closed:
                                        least = -reach
                                    elif now != 0:  # from now on it is known where it came from
                                        least = -wp.max(reach, data.surfaces.depth[other])
                                    if wp.static(overlapping_at_start):
                                        least = least - data.history.initial_overlap[p]
                                    note(data.tunnelling, p, facet, x, gap + h * u_n, least, -u_n)
                        # Of more than two bodies those two are remembered whose numbers are least.
                        if new_partner_0 < 0 or other < new_partner_0:
                            new_partner_1 = new_partner_0
                            new_slip_1 = new_slip_0
                            new_seen_1 = new_seen_0
                            new_partner_0 = other
                            new_slip_0 = tangential_displacement
                            new_seen_0 = now
                        elif new_partner_1 < 0 or other < new_partner_1:
                            new_partner_1 = other
                            new_slip_1 = tangential_displacement
                            new_seen_1 = now
                        if turn == 0:
                            away_0 = x - q
                        else:
                            away_1 = x - q
                elif h > zero and lane == 0 and best < far and held == 0:
                    # What comes so fast that a substep takes it through has never been in touch.
                    q = place_on(data.surfaces.x, corner, w)
                    gap = wp.sqrt(best)
                    u = place_of(data.surfaces.v, ends, s) - place_on(data.surfaces.v, corner, w)
                    u_n = wp.dot(u, x - q) / gap
                    least = zero
                    if data.surfaces.closed[other] != 0 and mine != other:
                        least = -reach
                        if wp.dot(x - q, normal_of(data.surfaces.x, corner)) < zero:
                            u_n = zero  # it is within, and lost already
                    note(data.tunnelling, p, facet, x, gap + h * u_n, least, -u_n)
                turn += 1
                if wp.static(not sided) or turn > wp.static(HISTORY):
                    first = until
                    if wp.static(measuring):
                        first = next_in_order(data.neighbors.candidate_body, p, n, other)
                    turn = int(0)
                    away_0 = V()
                    away_1 = V()
            if wp.static(not measuring):
                if h > zero and lane == 0:
                    data.history.contact_body[0, p] = new_partner_0
                    data.history.contact_body[1, p] = new_partner_1
                    data.history.tangential_displacement[0, p] = new_slip_0
                    data.history.tangential_displacement[1, p] = new_slip_1
                    if wp.static(sided):
                        data.history.contact_side[0, p] = new_seen_0
                        data.history.contact_side[1, p] = new_seen_1
        if wp.static(overlapping_at_start and not measuring):
            if lane == 0:
                data.history.initial_overlap[p] = wp.max(
                    zero, data.history.initial_overlap[p] - h * data.history.overlap_release_speed
                )
        if wp.static(measuring):
            if lane == 0:
                stored[p] = energy
                heated[p] = power

    def touch_points(
        data: Data,
        h: scalar,
        behind: scalar,
        per_unit: wp.float64,
        buffer: wp.array(dtype=scalar),
        threads: int,
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        k = first_of_part(wp.tid(), part) / wp.static(lanes)
        lane = wp.tid() % wp.static(lanes)
        while k < data.neighbors.active_count[0]:
            evaluate_point(
                data,
                data.neighbors.active_points[k],
                lane,
                h,
                behind,
                per_unit,
                buffer,
                parts,
                flags,
                stored,
                heated,
            )
            k = next_of_part(k, threads / wp.static(lanes), parts)

    return kernel(touch_points, launch_bounds=bounds_of_blocks(scalar), module_options=FAST)
