"""Rods: chains that resist bending."""

import math

import numpy as np

from .. import checks
from ..bodies import Angles, Material, System
from .lattices import chain


def rod(count: int, spacing: float, *, radius: float, material: Material, dim: int = 3) -> System:
    """Return a straight round rod along x, centred at the origin, that resists stretching and bending.

    It is a `chain` with an angle at each inner particle, which resists bending. With E of the material, the
    stiffness of a connection is E A/a and of an angle E I/a, for A = π r² and I = π r⁴/4. Angles are damped with
    the same time as connections. Twist is not modelled: turning an end about the rod's axis has no effect, and the
    rest shape is straight. (Twist needs a material frame for each edge, whose angle spreads along the whole rod:
    it is no sum of forces between near particles.)

    Parameters
    ----------
    count
        Number of particles, at least 3.
    spacing
        Distance of neighbours a [m].
    radius
        Radius r of the cross section [m].
    material
        The material.
    dim
        Number of coordinates: 2 or 3.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Reference: Bergou et al., Discrete elastic rods, ACM Trans. Graph. 27 (2008) 63, without its material frames.
    """
    count, radius = checks.count("count", count, 3), checks.positive("radius", radius)
    spacing = checks.positive("spacing", spacing)
    checks.one_of("dim", dim, (2, 3))
    checks.instance("material", material, Material, "msdwarp.STEEL_WIRE")
    line = chain(count, spacing, material=material, area=math.pi * radius**2, dim=dim)
    stiffness = material.youngs_modulus * math.pi * radius**4 / 4 / spacing
    damping = material.damping_time(spacing * (count - 1)) * stiffness
    first = np.arange(count - 2)
    particles = np.stack([first, first + 1, first + 2], axis=1)
    return line.replace(angles=Angles(particles=particles, stiffness=stiffness, damping=damping))
