"""Friction of contacts: a spring along the surface, which slides where it is stretched too far."""

import functools

import warp as wp

from ..basis import vector

TANGENTIAL = 2.0 / 7.0
"""Stiffness along the plane of contact by that along the normal (Cundall and Strack; of spheres by Mindlin)."""


@functools.cache
def friction(scalar: type):
    """Compose what friction does, (slip, u_t, k_t, b_t, most) -> (slip, f_t, slides).

    `tangential_displacement` is how far the contact was moved along the surface [m], `u_t` how fast it moves
    [m/s], k_t and b_t are its spring [N/m] and damper [N s/m], and `most` is Coulomb's limit μ f_n [N]. Returned
    are the slip that can be held, the force f_t = −k_t slip − b_t u_t, shortened to the limit, and whether it was:
    Cundall and Strack 1979.
    """
    V = vector(3, scalar)

    @wp.func
    def stick_or_slide(tangential_displacement: V, u_t: V, k_t: scalar, b_t: scalar, most: scalar):
        held = tangential_displacement
        stretched = k_t * wp.length(tangential_displacement)
        if stretched > most:
            held = tangential_displacement * (most / stretched)
        f_t = -k_t * held - b_t * u_t
        pull = wp.length(f_t)
        slides = pull > most
        if slides:
            f_t = f_t * (most / pull)
        return held, f_t, slides

    return stick_or_slide
