"""The law of a contact: a spring and a damper along the normal, and friction that sticks; see `body_contact`."""

import functools

import warp as wp

from ..basis import vector
from .contact_data import DEEPEST, BodyContactData, Substep, first_flag
from .cpu_partition import raise_to
from .pairs import Pair, pairs

TANGENTIAL = 2.0 / 7.0
"""Ratio of tangential to normal stiffness (Cundall and Strack; for spheres Mindlin)."""


@functools.cache
def friction(scalar: type):
    """Compose the law of friction, (moved, u_t, k_t, b_t, most) -> (held, f_t, slides).

    `moved` is the tangential displacement [m], `u_t` the tangential velocity [m/s], k_t and b_t are the spring
    [N/m] and damper [N s/m], and `most` is Coulomb's limit μ f_n [N]. It returns the displacement after limiting,
    the force f_t = −k_t held − b_t u_t, shortened to the limit, and whether it was shortened: Cundall and Strack
    1979.
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
    """Compose (press, record, per_unit_of): the force of one contact, and statistics of active contacts.

    `press` returns the stiffness [N/m], the normal force [N], the tangential force [N], the new tangential
    displacement [m], the normal velocity of the point, positive when leaving [m/s], and whether it slides.
    `record` updates the deepest overlap and the work of depenetration. `per_unit_of` returns the units of force
    per newton: in an ensemble each world has its own.
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar, worlds), Substep(scalar)
    PointAndBody, zero, one = Pair(scalar), scalar(0.0), scalar(1.0)
    tangential, stick_or_slide = scalar(TANGENTIAL), friction(scalar)
    stiffness_of, first_of = pairs(scalar, worlds)[3], first_flag(scalar, worlds)

    @wp.func
    def press(
        data: Data,
        pair: PointAndBody,
        mobility: scalar,  # 1 / the reduced mass of both [1/kg]
        overlap: scalar,  # [m]
        normal: V,  # unit vector out of the facet
        faces: scalar,  # share of the damping
        u: V,  # velocity of the point relative to the facet [m/s]
        before: V,  # tangential displacement before this substep [m]
        step: Step,
    ):
        k_n = stiffness_of(data, pair.rule, pair.mine, pair.other)
        u_n = wp.dot(u, normal)
        u_t = u - u_n * normal
        # A point has a share of the stiffness, and the same share of the mass.
        root = wp.sqrt(data.surfaces.density[pair.mine] * k_n / mobility)
        # A pair has two contacts, a point on a facet each way: each has half of the damping.
        b_n = faces * scalar(2.0**0.5) * data.rules.damping[pair.rule] * root
        b_t = wp.sqrt(tangential) * b_n
        # If velocities lag, the damper acts on the mean of those before and after a substep.
        late = one / (one + step.behind * b_n * mobility)
        b_t = b_t / (one + step.behind * b_t * mobility)
        f_n = wp.max(zero, k_n * overlap - late * b_n * u_n)
        moved = before - wp.dot(before, normal) * normal + step.h * u_t
        most = faces * data.rules.friction[pair.rule] * f_n
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
