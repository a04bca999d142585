"""The law of a contact: a spring and a damper along the normal, and friction that sticks; see `body_contact`."""

import functools

import warp as wp

from ..basis import vector
from ..partition import count_up, raise_to
from ..records import table
from ..springs.lanes import sum_over_lanes
from .contact_data import DEEPEST, BodyContactData, Pair, Substep, first_flag

TANGENTIAL = 2.0 / 7.0
"""Ratio of tangential to normal stiffness (Cundall and Strack; for spheres Mindlin)."""


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
def damping_limits(scalar: type, lanes: int):
    """Compose (count, load), which bound the damper of a contact, given all other contacts of its particles.

    With the gradient g of a contact, n_i the contacts of particle i, and its mass m_i, Cauchy's inequality says

        (g·v)² ≤ (Σ g_i² n_i/m_i) (Σ m_i v_i²/n_i),

    and the second sum, added up over all contacts, is Σ m_i v_i². So if each b ≤ c / Σ g_i² n_i/m_i, all dampers
    together have no rate above c. A particle in several vertices of a contact counts once for each. `count` adds a
    contact to its particles; `load` returns Σ g_i² n_i/m_i [1/kg]. The `lanes` threads of a point divide the five
    vertices. Both functions take arrays, since on the CPU a call would copy the whole data struct.
    """
    V, Sum, one, zero = vector(3, scalar), vector(1, scalar), scalar(1.0), scalar(0.0)
    sum_of, index_of, number_of = sum_over_lanes(1, scalar, lanes), table(int), table(scalar)

    @wp.func
    def count(
        first: wp.array(dtype=int),
        particle: wp.array(dtype=int),
        touches: wp.array(dtype=int),
        ends: wp.vec2i,
        corner: wp.vec3i,
        w: V,
        lane: int,
    ):
        for m in range(lane, 5, wp.static(lanes)):
            if (m != 1 or ends[0] != ends[1]) and (m < 2 or w[m - 2] != zero):
                vertex = ends[m % 2]
                if m >= 2:
                    vertex = corner[m - 2]
                for s in range(index_of(first, vertex), index_of(first, vertex + 1)):
                    count_up(touches, index_of(particle, s))

    @wp.func
    def load(
        first: wp.array(dtype=int),
        particle: wp.array(dtype=int),
        weight: wp.array(dtype=scalar),
        touches: wp.array(dtype=int),
        inverse_mass: wp.array(dtype=scalar),
        ends: wp.vec2i,
        share: scalar,
        corner: wp.vec3i,
        w: V,
        lane: int,
    ) -> scalar:
        total = zero
        for m in range(lane, 5, wp.static(lanes)):
            g = one
            vertex = ends[m % 2]
            if m >= 2:
                vertex = corner[m - 2]
                g = w[m - 2]
            elif ends[0] == ends[1]:
                g = scalar(1 - m)
            elif m == 0:
                g = one - share
            else:
                g = share
            if g != zero:
                for s in range(index_of(first, vertex), index_of(first, vertex + 1)):
                    i = index_of(particle, s)
                    g_i = g * number_of(weight, s)
                    total += g_i * g_i * scalar(touches[i]) * number_of(inverse_mass, i)
        return sum_of(Sum(total))[0]

    return count, load


@functools.cache
def contact_law(scalar: type, overlapping_at_start: bool, worlds: bool):
    """Compose (press, record, per_unit_of): the force of one contact, and sums over active contacts.

    `press` returns the stiffness [N/m], the normal force [N], the tangential force [N], the new tangential
    displacement [m], the normal velocity of the point, positive when leaving [m/s], and whether it slides.
    `record` updates the deepest overlap and the work of depenetration. `per_unit_of` returns the units of force
    per newton, which differ between the worlds of an ensemble.
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar, worlds), Substep(scalar)
    PointAndBody, zero, one = Pair(scalar), scalar(0.0), scalar(1.0)
    tangential, stick_or_slide = scalar(TANGENTIAL), friction(scalar)
    first_of = first_flag(scalar, worlds)

    @wp.func
    def press(
        pair: PointAndBody,
        mobility: scalar,  # 1 / reduced mass of point and facet [1/kg]
        overlap: scalar,  # [m]
        normal: V,  # unit vector out of the facet
        faces: scalar,  # fraction of the damping, see `facing`
        strongest: scalar,  # largest stable damping [N s/m]
        u: V,  # velocity of the point relative to the facet [m/s]
        before: V,  # tangential displacement before this substep [m]
        step: Step,
    ):
        k_n = pair.stiffness
        u_n = wp.dot(u, normal)
        u_t = u - u_n * normal
        # A point has a fraction of the stiffness, and the same fraction of the mass.
        root = wp.sqrt(pair.density * k_n / mobility)
        # Two bodies touch in two contacts, a point of each on a facet of the other: each has half of the damping.
        b_n = faces * scalar(2.0**0.5) * pair.damping * root
        b_t = wp.sqrt(tangential) * b_n
        # If velocities lag, the damper acts on the mean of those before and after a substep.
        b_n = wp.min(b_n / (one + step.behind * b_n * mobility), strongest)
        b_t = wp.min(b_t / (one + step.behind * b_t * mobility), strongest)
        f_n = wp.max(zero, k_n * overlap - b_n * u_n)
        moved = before - wp.dot(before, normal) * normal + step.h * u_t
        most = faces * pair.friction * f_n
        held, f_t, slides = stick_or_slide(moved, u_t, tangential * k_n, b_t, most)
        return k_n, f_n, f_t, held, u_n, slides

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
