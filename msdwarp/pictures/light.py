"""Light: its directions, its strength and the softness of its shadows, equal in all pictures.

A surface of color c, unit normal n and gloss g, seen from the direction v, has the brightness

    c d + w, where w = g (KEY s max(p·v, 0)^e + HEAD max(q·v, 0)^e), d = a + TONE a (1 - a),
    and a is the lesser of 1 and
    SKY (1 + n·z)/2 + BOUNCE b (1 - n·z)/2 + KEY k max(n·l, 0) + HEAD max(n·h, 0) + FILL max(n·f, 0).

Strengths are divided by the largest sum of any normal, so that at full light a surface has its color as given: a
is 1, and so is d. The sum is above 1 only where a camera has left the place for which strengths were made.

The unit vector z points up, l to the key light, h back along the camera's view, f to the fill light, p and q are l
and h, mirrored at n, and e is the `shininess` of its roughness. A fraction s of the key light is visible from the
surface, 0 in full shadow; k = SHADED + (1 - SHADED) s of it arrives, since the surroundings scatter some. Near the
ground a body hides the light from there: b = h / (h + a) at the height h, with CONTACT in a. The ground is unlit,
and keeps SHADOW + (1 - SHADOW) s of its color.

Surfaces with other finishes (`world.Reflectance`: sheen t, metallic m, opacity o) that mirror the brightness r of
their surroundings (`kernels/pictures/shading.py`) have, with i = 1 - n·v,

- for cloth  c (d + t i²) + w,
- for metal  c ((1 - m) d + m r + w),
- for glass  o c d + f r + w, and (1 - o) (1 - f) (1 - w) of what is behind, if it mirrors a fraction f.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

KEY_FROM, FILL_FROM = (-0.75, -0.35, 1.1), (0.9, -0.4, 0.1)
"""Directions (right, forwards, upwards) of the key light, over the camera's left shoulder, and the fill light."""
KEY, HEAD, FILL = 0.44, 0.32, 0.15
"""The key light, a weaker light at the camera, and a fill light for faces turned away from the key light; only the
key light casts shadows."""
SKY, BOUNCE = 0.58, 0.44
"""Light from all of the sky, and from a bright floor: without it faces that look down are dark. A face sees the
shares (1 + n·z)/2 of the sky and (1 - n·z)/2 of a wide floor (B. Liu and R. Jordan, Solar Energy 7, 1963)."""
TONE = 0.7
"""By how much surfaces are brighter between darkness and full light than in proportion to the light."""
CONTACT = 0.03
"""Height above the ground where half of the floor's light arrives, over the extent of all that the camera sees."""
EVEN_AMBIENT, EVEN_DIFFUSE = 0.66, 0.55
"""Strength of ambient light, and factor of the lights with a direction, where colors show values: ambient light
is equal from above and below, so that colors look on all sides as in the legend."""
SHADOW = 0.66
"""Brightness of the ground in full shadow, over its brightness in light."""
SHADED = 0.12
"""The fraction of the key light that still reaches a body or an obstacle in full shadow."""
SOFTNESS = 0.05
"""Radius of the key light, a disc, over its distance: at a distance d behind an edge a shadow fades in over 2 d of
this."""
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
"""Corners of the square around the key light, and its centre, sampled first: a straight edge that hides none or
all of the corners hides none or all of the light; what looks smaller than the light may hide the centre alone."""
GOLDEN = np.pi * (3 - np.sqrt(5))
"""The golden angle [rad]."""


class Lights(NamedTuple):
    """Strengths of light from the sky and the floor, and of the key light, the headlight and the fill light."""

    sky: float
    bounce: float
    key: float
    head: float
    fill: float


def lights(key: NDArray, head: NDArray, fill: NDArray, *, even: bool = False) -> Lights:
    """Return strengths for unit vectors towards the three lights: a surface in full light has its color as given.

    With `even` ambient light comes equally from above and below, as where colors show values.
    """
    sky, bounce, diffuse = (EVEN_AMBIENT, EVEN_AMBIENT, EVEN_DIFFUSE) if even else (SKY, BOUNCE, 1.0)
    strengths = diffuse * np.array([KEY, HEAD, FILL])
    upwards = (sky - bounce) / 2 * np.array([0.0, 0.0, 1.0])
    # For the lights that a surface faces d is linear in its normal: it is largest along the sum of their vectors.
    each = strengths[:, None] * np.array([key, head, fill])
    full = (sky + bounce) / 2 + max(
        np.linalg.norm(upwards + np.array(on) @ each) for on in product((0, 1), repeat=3)
    )
    return Lights(*(float(one / full) for one in (sky, bounce, *strengths)))


def shininess(roughness: float) -> float:
    """Return Phong's exponent of highlights as wide as those of a microfacet model of this roughness.

    That is a quarter of J. Blinn's exponent, 2 / roughness⁴ - 2 (B. Walter et al., "Microfacet models for
    refraction through rough surfaces", EGSR 2007, with the roughness of UsdPreviewSurface).
    """
    return 0.5 / roughness**4 - 0.5


def towards(light: tuple[float, float, float], right: NDArray, forward: NDArray) -> NDArray[np.float64]:
    """Return the unit vector towards a light, such as KEY_FROM, for a camera with these unit vectors."""
    aside, ahead, up = light
    direction = aside * right + ahead * forward * (1, 1, 0) + np.array([0, 0, up])
    return direction / np.linalg.norm(direction)


def spread(count: int) -> NDArray[np.float64]:
    """Return sampling points of the key light, spread evenly over the unit disc, shape [count, 2].

    Any consecutive points are also spread over the disc: a spiral by the golden angle (H. Vogel, "A better way to
    construct the sunflower head", Mathematical Biosciences 44, 1979), with the radii in the order of the van der
    Corput sequence 0, 1/2, 1/4, 3/4, 1/8 ...
    """
    angle = GOLDEN * np.arange(count)
    in_order = np.array([int(f"{k:032b}"[::-1], 2) / 2**32 for k in range(count)])
    radius = np.sqrt(in_order + 0.5 / count)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def across(direction: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors normal to a unit vector and to each other."""
    aside = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = np.cross(aside, direction)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
