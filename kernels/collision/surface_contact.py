"""Contact of facets with obstacles, whose edges or corners may enter between particles.

Contact of particles alone misses an obstacle's edge or corner between them, and a solid smaller than the spacing.
So each facet is sampled at a grid of points that includes its corners. Each sample at depth δ in the obstacle is a
spring of energy k δ²/2; their sum approximates an integral over the facet. The spring pushes the corners along the
gradient n of the obstacle's signed distance, with the weights of the sample. For the whole facet, with the
velocity u of the δ-weighted mean sample,

    f_n = max(0, |Σ k δ n| − b_n u·n)

and friction as between bodies, at the point of the obstacle that the facet's shell touches, see `law`.

A deep sample in a thin obstacle may be nearer to the far side. So the plane of the side where the facet entered is
stored. δ is the depth below this plane, at most twice the distance from the nearest side, so that forces do not
jump at entry and exit.

Solids are convex: the whole solid is behind its tangent plane at the point nearest to a facet's centre. A facet in
front of this plane is skipped. So is a facet that lies flat on a face: contact of its particles suffices.
"""

import functools

import warp as wp

from ..basis import fast_kernel, vector
from ..colliders.signed_distance import signed_distance
from .contact_data import HISTORY
from .force_sums import exert_force
from .law import TANGENTIAL, friction, triangles
from .surface_contact_data import QUADRATURE_POINTS, SurfaceContactData

CAP = 2.0
"""Limit of the depth below the entry side, as a multiple of the distance from the nearest side."""


@functools.cache
def evaluate_surface(
    scalar: type, kinds: tuple[str, ...], moving: bool, overlapping_at_start: bool, measuring: bool
):
    """Compose the kernel of the forces of obstacles on facets; if `measuring`, of the energy [J] and power [W].

    Its threads divide the facets. If a facet starts inside an obstacle (`overlapping_at_start`), its depths count
    from an allowed depth, which shrinks to 0. Forces are added to those between bodies, as integers.
    """
    V, Data = vector(3, scalar), SurfaceContactData(scalar, moving)
    distance_from, stick_or_slide = signed_distance(3, scalar, kinds), friction(scalar)
    exert = exert_force(scalar, lanes=1)
    _, triangle_of, turn_by = triangles(scalar)
    zero, one, third, tangential = scalar(0.0), scalar(1.0), scalar(1.0 / 3.0), scalar(TANGENTIAL)

    @wp.func
    def place_of(data: Data, p: int, row: int, fraction: scalar, x: V) -> V:
        """Transform x to the frame of obstacle p, whose pose is a `fraction` of the way from `row` to the next."""
        if wp.static(moving):
            begun = wp.transpose(data.turn[row, p]) * (x - data.shift[row, p])
            if fraction > zero:
                ends = wp.transpose(data.turn[row + 1, p]) * (x - data.shift[row + 1, p])
                begun += fraction * (ends - begun)
            return begun
        return x

    @wp.func
    def turned(data: Data, p: int, row: int, fraction: scalar, normal: V) -> V:
        """Transform a direction from the frame of obstacle p to the frame of the scene."""
        if wp.static(moving):
            begun = data.turn[row, p] * normal
            if fraction > zero:
                begun += fraction * (data.turn[row + 1, p] * normal - begun)
            return begun
        return normal

    @wp.struct
    class Facet:
        number: int
        corner: wp.vec3i
        a: V  # positions of its corners [m]
        b: V
        c: V
        row: int  # row of the obstacles' poses at the substep's start
        fraction: scalar  # fraction of the substep that has passed
        begins: scalar  # depth beyond which samples are pushed out [m]

    @wp.struct
    class Inside:
        # The obstacle, the facet's tangential displacement, and its entry side if it is deep:
        solid: int
        moved: V
        side: V
        level: scalar
        # The force on each corner per stiffness [m], and sums over samples:
        f_a: V
        f_b: V
        f_c: V
        w: V  # weights of the corners, summed with the depth
        deep: scalar  # [m]
        squares: scalar  # sum of squared depths [m²]
        count: scalar
        most_deep: scalar  # [m]

    @wp.func
    def recall(data: Data, t: int, p: int) -> Inside:
        """Return the history of the contact of facet t with obstacle p, all 0 if they did not touch."""
        inside = Inside()
        inside.solid = p
        for e in range(wp.static(HISTORY)):
            if data.contact_body[e, t] == p:
                inside.moved = data.tangential_displacement[e, t]
                inside.side = data.side[e, t]
                inside.level = data.level[e, t]
        return inside

    @wp.func
    def add_places(data: Data, facet: Facet, before: Inside) -> Inside:
        """Return the history `before` with sums added over the samples of a facet that are inside the obstacle."""
        inside = before
        p = before.solid
        kept = wp.dot(before.side, before.side) > zero
        for s in range(wp.static(QUADRATURE_POINTS)):
            part = data.place[s]
            y = part[0] * facet.a + part[1] * facet.b + part[2] * facet.c
            y = place_of(data, p, facet.row, facet.fraction, y)
            found = distance_from(data.solids, p, y)
            depth = -found[3] - facet.begins
            if depth > zero:
                normal = V(found[0], found[1], found[2])
                if kept:
                    behind_side = inside.level - wp.dot(inside.side, y) - facet.begins
                    depth = scalar(wp.static(CAP)) * depth
                    normal = scalar(wp.static(CAP)) * normal
                    if behind_side < depth:
                        depth = wp.max(behind_side, zero)
                        normal = inside.side
                if depth > inside.most_deep:
                    inside.most_deep = depth
                    if not kept:
                        inside.side = normal
                        inside.level = wp.dot(normal, y) - found[3]
                normal = turned(data, p, facet.row, facet.fraction, normal)
                inside.f_a += (part[0] * depth) * normal
                inside.f_b += (part[1] * depth) * normal
                inside.f_c += (part[2] * depth) * normal
                inside.w += depth * part
                inside.deep += depth
                inside.squares += depth * depth
                inside.count += one
        return inside

    @wp.func
    def surface_velocity(data: Data, facet: Facet, p: int, at: V) -> V:
        """Return the velocity of obstacle p at a point [m/s]."""
        y = place_of(data, p, facet.row, facet.fraction, at)
        following = wp.min(facet.row + 1, data.speed.shape[0] - 1)  # a frame's last row has no next one
        return scalar(0.5) * (
            data.turning[facet.row, p] * y
            + data.speed[facet.row, p]
            + data.turning[following, p] * y
            + data.speed[following, p]
        )

    @wp.func
    def bear(data: Data, facet: Facet, before: Inside, h: scalar, most_rate: scalar, per_unit: wp.float64):
        """Exert the force of one contact between a facet and an obstacle.

        Return the new history, whether there is a force, the stored energy [J], the dissipated power [W], and the
        power of the obstacle's motion and of depenetration [W].
        """
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        done = wp.float64(0.0)
        inside = before
        p = inside.solid
        t = facet.number
        corner = facet.corner
        k = data.stiffness[t]
        k_t = tangential * scalar(wp.static(float(QUADRATURE_POINTS))) * k
        pushed = inside.f_a + inside.f_b + inside.f_c
        size = wp.length(pushed)
        w = inside.w
        mobility = zero
        if inside.deep > zero:
            w = w / inside.deep
            for j in range(3):
                mobility += w[j] * w[j] * data.mobility[corner[j]]
        bears = size > zero and mobility > zero
        if bears:
            normal = pushed / size
            arm = wp.min(zero, facet.begins + inside.squares / inside.deep) * normal
            triangle = triangle_of(data.x, data.v, corner, wp.max(zero, -data.slack[t]))
            u = w[0] * data.v[corner[0]] + w[1] * data.v[corner[1]] + w[2] * data.v[corner[2]]
            u += wp.cross(turn_by(triangle, triangle.spin), arm)
            surface = V()
            if wp.static(moving):
                at = w[0] * facet.a + w[1] * facet.b + w[2] * facet.c + arm
                surface = surface_velocity(data, facet, p, at)
                u = u - surface
            u_n = wp.dot(u, normal)
            u_t = u - u_n * normal
            # The samples inside have the same fraction of a vertex's mass as of the stiffness around it.
            b_n = scalar(2.0) * data.damping[p] * inside.count * k / wp.sqrt(data.whole[t] * mobility)
            # A particle has as many facets as its part of the stiffness tells.
            most_b = scalar(wp.static(float(QUADRATURE_POINTS))) * k / data.whole[t] * most_rate / mobility
            b_t = wp.min(wp.sqrt(tangential) * b_n, most_b)
            b_n = wp.min(b_n, most_b)
            f_n = wp.max(zero, k * size - b_n * u_n)
            moved = inside.moved - wp.dot(inside.moved, normal) * normal + h * u_t
            moved, f_t, slides = stick_or_slide(moved, u_t, k_t, b_t, data.friction[p] * f_n)
            if wp.static(measuring):
                energy = wp.float64(scalar(0.5) * (k * inside.squares + k_t * wp.dot(moved, moved)))
                heat = (k * size - f_n) * u_n - wp.dot(f_t, u_t)
                if not slides:
                    heat -= k_t * wp.dot(moved, u_t)
                power = wp.float64(heat)
            else:
                by = f_n / size
                f = f_n * normal + f_t
                f_b = by * inside.f_b + w[1] * f_t
                f_c = by * inside.f_c + w[2] * f_t
                exert(data.force, corner, triangle, f, f_b, f_c, wp.cross(arm, f_t), per_unit, 0, 1)
                if wp.static(moving):
                    done += wp.float64(wp.dot(f, surface))
                if wp.static(overlapping_at_start):
                    if data.initial_overlap[t] > zero:
                        done += wp.float64(k * inside.deep * data.overlap_release_speed)
            inside.moved = moved
            if inside.most_deep + data.slack[t] < data.thin[p]:
                inside.side = V()
        return inside, bears, energy, power, done

    @wp.func
    def keep(data: Data, t: int, e: int, inside: Inside):
        data.contact_body[e, t] = inside.solid
        data.tangential_displacement[e, t] = inside.moved
        data.side[e, t] = inside.side
        data.level[e, t] = inside.level

    @wp.func
    def evaluate_facet(
        data: Data,
        t: int,
        corner: wp.vec3i,
        a: V,
        b: V,
        c: V,
        row: int,
        fraction: scalar,
        h: scalar,  # length of the coming substep [s]; 0 for measurements, which change no history
        most_rate: scalar,  # of the dampers of a particle's facets [1/s]
        per_unit: wp.float64,  # units of force per newton [1/N]
        stored: wp.array(dtype=wp.float64),  # [J], shape [facet_count], if measuring
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        facet = Facet(t, corner, a, b, c, row, fraction, data.slack[t])
        if wp.static(overlapping_at_start):
            facet.begins += data.initial_overlap[t]
        middle = third * (a + b + c)
        energy = wp.float64(0.0)
        power = wp.float64(0.0)
        done = wp.float64(0.0)
        first = Inside()
        second = Inside()
        first.solid = -1
        second.solid = -1
        for o in range(data.solid.shape[0]):
            p = data.solid[o]
            found = distance_from(data.solids, p, place_of(data, p, row, fraction, middle))
            normal = turned(data, p, row, fraction, V(found[0], found[1], found[2]))
            ahead = wp.min(wp.dot(normal, a - middle), wp.dot(normal, b - middle))
            if found[3] + wp.min(ahead, wp.dot(normal, c - middle)) < -facet.begins:
                inside = add_places(data, facet, recall(data, t, p))
                inside, bears, more, heat, work = bear(data, facet, inside, h, most_rate, per_unit)
                energy += more
                power += heat
                done += work
                if bears and first.solid < 0:
                    first = inside
                elif bears and second.solid < 0:
                    second = inside
        if wp.static(measuring):
            stored[t] = energy
            heated[t] = power
        else:
            if h > zero:
                keep(data, t, 0, first)
                keep(data, t, 1, second)
            if wp.static(overlapping_at_start):
                data.initial_overlap[t] = wp.max(zero, data.initial_overlap[t] - h * data.overlap_release_speed)
            if wp.static(moving or overlapping_at_start):
                data.power[t] = done

    @fast_kernel
    def evaluate_facets(
        data: Data,
        row: int,
        fraction: scalar,
        h: scalar,
        most_rate: scalar,
        per_unit: wp.float64,
        threads: int,
        stored: wp.array(dtype=wp.float64),
        heated: wp.array(dtype=wp.float64),
    ):
        # Most facets are far from all obstacles. This is tested without a function call: on the CPU a call copies
        # `data`.
        t = wp.tid()
        while t < data.corner.shape[0]:
            corner = data.corner[t]
            a = data.x[corner[0]]
            b = data.x[corner[1]]
            c = data.x[corner[2]]
            middle = third * (a + b + c)
            far = wp.max(wp.length_sq(a - middle), wp.max(wp.length_sq(b - middle), wp.length_sq(c - middle)))
            far = wp.sqrt(far) + wp.max(zero, -data.slack[t])
            near = data.contact_body[0, t] >= 0
            if wp.static(overlapping_at_start):
                near = near or data.initial_overlap[t] > zero
            for o in range(data.solid.shape[0]):
                p = data.solid[o]
                y = middle
                if wp.static(moving):
                    y = wp.transpose(data.turn[row, p]) * (middle - data.shift[row, p])
                    if fraction > zero:
                        ends = wp.transpose(data.turn[row + 1, p]) * (middle - data.shift[row + 1, p])
                        y += fraction * (ends - y)
                low = data.lower[p]
                high = data.upper[p]
                if y[0] > low[0] - far and y[1] > low[1] - far and y[2] > low[2] - far:
                    if y[0] < high[0] + far and y[1] < high[1] + far and y[2] < high[2] + far:
                        near = True
            if near:
                evaluate_facet(data, t, corner, a, b, c, row, fraction, h, most_rate, per_unit, stored, heated)
            else:
                if wp.static((moving or overlapping_at_start) and not measuring):
                    data.power[t] = wp.float64(0.0)
            t += threads

    return evaluate_facets
