"""The law of a contact: a spring and a damper along the normal, and friction that sticks; see `body_contact`.

The damper grows with the overlap, b = α k δ / v with the fastest approach v (after Hunt and Crossley 1975); α
follows from the restitution (`Contact.hysteresis`). It is limited, so that it does not shorten the stable step.

The nearest points of two shells are a gap apart. Friction acts at one point that is common to both bodies, between
them, where the shells meet, so that contact exerts no moment on the two together. It moves with each body as if it
were fixed to the triangle below it. A force f at an arm a from a triangle is a force at the triangle and the
couple a × f, which forces at the three corners make: those of a rigid turn, t × ρ, with

    t = J⁻¹ (a × f),  J = Σ (ρ² 1 − ρ ρᵀ),

where ρ are the corners seen from their mean. The velocity at the arm's end is that of the triangle plus ω × a with
ω = J⁻¹ Σ ρ × u, the transposed relation: so the work of both is the same.
"""

import functools

import warp as wp

from ..basis import vector
from ..partition import raise_to
from ..records import records
from .contact_data import DEEPEST, BodyContactData, Pair, Substep, first_flag

TANGENTIAL = 2.0 / 7.0
"""Ratio of tangential to normal stiffness (Cundall and Strack; for spheres Mindlin)."""
LOWEST = 0.1
"""Over the radius of the shell, the root of Σ ρ² along the height of the lowest triangle that takes couples."""
MEMORY = 100.0
"""How long a contact remembers its fastest approach, over the time √(m/k) of a point.

An impact of two particles lasts 2 to 5, one of bodies longer. As it forgets the damper grows: two particles with a
restitution of 0.2 have 1.7 % less, with 0.5 0.8 % less."""


@functools.cache
def friction(scalar: type):
    """Compose the law of friction, (moved, u_t, k_t, b_t, most) -> (held, f_t, slides).

    `moved` is the tangential displacement [m], `u_t` the tangential velocity [m/s], k_t and b_t are the spring
    [N/m] and damper [N s/m], and `most` is Coulomb's limit μ f_n [N]. It returns the limited displacement `held`,
    the force f_t = −k_t held − b_t u_t, limited to `most`, and whether the force was limited (it slides).
    Reference: Cundall and Strack (1979).
    """
    V = vector(3, scalar)

    @wp.func
    def stick_or_slide(moved: V, u_t: V, k_t: scalar, b_t: scalar, most: scalar):
        held = moved
        stretched = k_t * wp.length(moved)
        if stretched > most:
            held = moved * (most / stretched)
        f_t = -k_t * held - b_t * u_t
        pull = wp.length(f_t)
        slides = pull > most
        if slides:
            f_t = f_t * (most / pull)
        return held, f_t, slides

    return stick_or_slide


@functools.cache
def contact_law(scalar: type, overlapping_at_start: bool, worlds: bool):
    """Compose (press, record, per_unit_of): the force of one contact, and sums over active contacts.

    `press` returns, in this order: the stiffness [N/m]; the normal and the tangential force [N]; the new
    tangential displacement [m]; the fastest approach in this contact, the point's normal velocity, positive when
    leaving, and its tangential velocity [m/s]; and whether it slides. `record` updates the deepest overlap and the
    work of depenetration. `per_unit_of` returns the units of force per newton, which differ between the worlds of
    an ensemble.
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar), Substep(scalar)
    PointAndBody, zero, one = Pair(scalar), scalar(0.0), scalar(1.0)
    tangential, stick_or_slide = scalar(TANGENTIAL), friction(scalar)
    first_of = first_flag(scalar, worlds)

    @wp.func
    def press(
        pair: PointAndBody,
        density: scalar,  # of the stiffness of a vertex: that of the point
        fraction: scalar,  # of the point in the dampers of a vertex, see `crowding`
        mobility: scalar,  # 1 / reduced mass of point and facet [1/kg]
        of_facet: scalar,  # the part of the facet in it [1/kg]
        overlap: scalar,  # [m]
        normal: V,  # unit vector from the facet to the point
        own: V,  # unit normal of the point's surface, towards the facet; 0 if it has none
        u: V,  # velocity of the point relative to the facet [m/s]
        u_c: V,  # the same at the common point [m/s]
        before: V,  # tangential displacement before this substep [m]
        fastest_before: scalar,  # the fastest approach in this contact [m/s]
        step: Step,
    ):
        k_n = density * pair.stiffness
        u_n = wp.dot(u, normal)
        u_t = u_c - wp.dot(u_c, normal) * normal
        # A point that slides under an edge approaches it, but the surfaces do not approach each other: the damper
        # acts on what both surfaces see.
        seen = u_n
        if wp.length_sq(own) > zero:
            other = -wp.dot(u, own)
            if wp.abs(other) < wp.abs(seen):
                seen = other
            if other * u_n <= zero:
                seen = zero
        # The rate of all dampers at a vertex together is at most DAMPING / h: points that touch near it share it,
        # and so do those of a finer body that press on the facet.
        most_b = fraction * step.rate / (mobility + (pair.crowd - scalar(1.0)) * of_facet)
        forgets = step.h * wp.sqrt(k_n * mobility) / scalar(MEMORY)
        fastest = wp.max(-seen, fastest_before * (one - forgets))
        b_n = most_b
        if pair.hysteresis == zero:
            b_n = zero
        elif pair.hysteresis * k_n * overlap <= most_b * fastest:
            b_n = pair.hysteresis * k_n * overlap / fastest
        b_t = wp.min(scalar(2.0) * pair.damping * wp.sqrt(tangential * density * k_n / mobility), most_b)
        f_n = wp.max(zero, k_n * overlap - b_n * seen)
        moved = before - wp.dot(before, normal) * normal + step.h * u_t
        most = pair.friction * f_n
        held, f_t, slides = stick_or_slide(moved, u_t, tangential * k_n, b_t, most)
        return k_n, f_n, f_t, held, fastest, u_n, u_t, slides

    @wp.func
    def record(
        data: Data, p: int, mine: int, k_n: scalar, overlap: scalar, step: Step, flags: wp.array(dtype=float)
    ):
        if wp.static(overlapping_at_start):
            released = wp.min(data.history.initial_overlap[p], step.h * data.history.overlap_release_speed)
            wp.atomic_add(data.history.done, p, wp.float64(k_n * overlap) * wp.float64(released))
        at = first_of(data, mine) + wp.static(DEEPEST)
        if float(overlap) > flags[at]:
            raise_to(flags, at, float(overlap))

    @wp.func
    def per_unit_of(data: Data, mine: int, step: Step) -> wp.float64:
        found = step.per_unit
        if wp.static(worlds):
            found = wp.float64(1.0) / data.surfaces.unit[mine / data.surfaces.bodies_each]
        return found

    return press, record, per_unit_of


@functools.cache
def triangles(scalar: type):
    """Compose (Triangle, triangle_of, turn_by): rigid turns of a triangle, see the module's docstring.

    With the sides e and f from the first corner, and N = e × f, J⁻¹ c is
    ((2e − f)(e·c) + (2f − e)(f·c)) / N² + N (N·c) / (N² Σρ²).
    """
    V, load = vector(3, scalar), records(3, scalar).load
    zero, one, two, third = scalar(0.0), scalar(1.0), scalar(2.0), scalar(1.0 / 3.0)

    @wp.struct
    class Triangle:
        first: V  # sides from the first corner to the others [m]
        second: V
        normal: V  # their cross product [m²], outward; 0 for a segment or a point
        inverse: scalar  # 1 / normal² [1/m⁴]; 0 if it takes no couple
        spread: scalar  # Σ ρ² of the corners [m²]
        spin: V  # Σ ρ × u for the velocities u of the corners [m²/s]

    @wp.func
    def triangle_of(x: wp.array(dtype=V), v: wp.array(dtype=V), corner: wp.vec3i, radius: scalar) -> Triangle:
        """Return a triangle of a shell of some radius [m].

        It takes no couple if it is a segment or a point. Nor does a triangle much lower than the radius: since the
        radius is the arm of the force, the forces that make the couple would be large.
        """
        a = load(x, corner[0])
        e = load(x, corner[1]) - a
        f = load(x, corner[2]) - a
        u = load(v, corner[1])
        w = load(v, corner[2])
        mean = third * (load(v, corner[0]) + u + w)
        normal = wp.where(corner[1] == corner[2], V(), wp.cross(e, f))
        square = wp.dot(normal, normal)
        spread = two * third * (wp.dot(e, e) + wp.dot(f, f) - wp.dot(e, f))
        high = third * square > scalar(wp.static(LOWEST * LOWEST)) * radius * radius * spread
        spin = wp.cross(e, u - mean) + wp.cross(f, w - mean)
        return Triangle(e, f, normal, wp.where(high, one / square, zero), spread, spin)

    @wp.func
    def turn_by(t: Triangle, couple: V) -> V:
        """Return the turn J⁻¹ c, whose forces t × ρ at the corners make the couple."""
        if t.inverse == zero:
            return V()
        along_e = wp.dot(t.first, couple)
        along_f = wp.dot(t.second, couple)
        turn = (two * along_e - along_f) * t.first + (two * along_f - along_e) * t.second
        return t.inverse * (turn + wp.dot(t.normal, couple) / t.spread * t.normal)

    return Triangle, triangle_of, turn_by
