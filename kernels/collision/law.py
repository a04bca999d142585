"""The law of a contact: a spring and a damper along the normal, and friction that sticks; see `evaluate`."""

import functools

import warp as wp

from ..basis import vector
from .friction import TANGENTIAL, friction


@functools.cache
def contact_law(scalar: type):
    """Compose the law of one contact, (...) -> (f_n, f_t, slip, u_n, slides).

    Returned are the force along the normal [N], that along the surface [N], how far the contact has been moved
    along it now [m], how fast the point comes out along the normal [m/s], and whether it slides.
    """
    V = vector(3, scalar)
    zero, one = scalar(0.0), scalar(1.0)
    tangential, stick_or_slide = scalar(TANGENTIAL), friction(scalar)

    @wp.func
    def press(
        k_n: scalar,  # stiffness of the contact [N/m]
        damping: scalar,  # its damping ratio
        coefficient: scalar,  # of friction
        density: scalar,  # vertices of the point's body by its points
        mobility: scalar,  # 1 / the reduced mass of both [1/kg]
        overlap: scalar,  # [m]
        normal: V,  # unit vector out of the facet
        u: V,  # velocity of the point relative to the facet [m/s]
        moved: V,  # how far the contact had been moved along the surface before [m]
        h: scalar,  # length of the substep that begins [s]; 0 where none does
        behind: scalar,  # twice the time by which velocities lag behind positions [s]
    ):
        u_n = wp.dot(u, normal)
        u_t = u - u_n * normal
        # As it has a share of the stiffness, a point has one of the mass.
        root = wp.sqrt(density * k_n / mobility)
        # A pair touches twice, as a point and as a facet of each: both have half of the damping.
        b_n = scalar(2.0**0.5) * damping * root
        b_t = wp.sqrt(tangential) * b_n
        # Where velocities lag the mean of those before and after a substep counts.
        late = one / (one + behind * b_n * mobility)
        b_t = b_t / (one + behind * b_t * mobility)
        f_n = wp.max(zero, k_n * overlap - late * b_n * u_n)
        tangential_displacement = moved - wp.dot(moved, normal) * normal + h * u_t
        tangential_displacement, f_t, slides = stick_or_slide(
            tangential_displacement, u_t, tangential * k_n, b_t, coefficient * f_n
        )
        return f_n, f_t, tangential_displacement, u_n, slides

    return press
