"""Light: where it comes from, how strong it is and how soft its shadows are, in all pictures alike.

A surface of colour c, unit normal n and gloss g that is seen from the direction v is as bright as

    c (AMBIENT + BOUNCE (1 - n·z)/2 + KEY k max(n·l, 0) + HEAD max(n·h, 0) + FILL max(n·f, 0))
        + g (KEY s max(p·v, 0)^e + HEAD max(q·v, 0)^e),

where the unit vector z points up, l to the key light, h back along the camera's view, f to the fill light, p and q
are l and h, mirrored at n, and e is SHININESS. A share s of the key light is seen from there, 0 in full shadow;
k = SHADED + (1 - SHADED) s of it arrives, since what is around scatters the rest. The ground is painted, and keeps
SHADOW + (1 - SHADOW) s of its colour.
"""

import numpy as np
from numpy.typing import NDArray

AMBIENT, KEY, HEAD, FILL = 0.42, 0.44, 0.32, 0.15
"""Light from all around, the key light from the upper left behind the camera, a weaker one at the camera, and one
that fills what is turned away from the key light, from the right; only the key light casts shadows."""
BOUNCE = 0.18
"""Light from below, as a bright floor sends it up: without it faces that look down are dark. A face sees the share
(1 - n·z)/2 of a wide floor (B. Liu and R. Jordan, Solar Energy 7, 1963)."""
EVEN_AMBIENT, EVEN_SHARE = 0.66, 0.55
"""The light from all around, and the share left of the two lights, where colours tell values: even light, and none
from below, so that they look on all sides as they do in the legend."""
SHADOW = 0.66
"""Brightness of the ground in full shadow over that in light."""
SHADED = 0.12
"""The share of the key light that still reaches a body or an obstacle in full shadow."""
SOFTNESS = 0.05
"""Radius of the key light, a disc, over its distance: at a distance d behind an edge a shadow fades in over 2 d of
this."""
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
"""The corners of the square around the key light, looked at first: behind a straight edge that hides none of them,
or all, it hides none of the light, or all."""
SHININESS = 30.0
"""Phong's exponent of highlights."""
GOLDEN = np.pi * (3 - np.sqrt(5))
"""The golden angle [rad]."""


def towards_key(right: NDArray, forward: NDArray) -> NDArray[np.float64]:
    """Return the direction towards the key light, of unit length: over the left shoulder of a camera.

    `right` and `forward` are unit vectors of its view, shape [3].
    """
    direction = -0.75 * right - 0.35 * forward * (1, 1, 0) + np.array([0, 0, 1.1])
    return direction / np.linalg.norm(direction)


def towards_fill(right: NDArray, forward: NDArray) -> NDArray[np.float64]:
    """Return the direction towards the fill light, of unit length: from the right, and a little from behind.

    `right` and `forward` are unit vectors of its view, shape [3].
    """
    direction = 0.9 * right - 0.4 * forward * (1, 1, 0) + np.array([0, 0, 0.1])
    return direction / np.linalg.norm(direction)


def spread(count: int) -> NDArray[np.float64]:
    """Return points spread evenly over the unit disc, shape [count, 2]: those of the key light that are looked at.

    Any some of them that follow each other are spread over the disc too: a spiral by the golden angle (H. Vogel,
    "A better way to construct the sunflower head", Mathematical Biosciences 44, 1979), with the radii in the order
    of the van der Corput sequence.
    """
    angle = GOLDEN * np.arange(count)
    radius = np.sqrt(_van_der_corput(count) + 0.5 / count)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def across(direction: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors across a direction of unit length, shape [3], and across each other."""
    aside = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = np.cross(aside, direction)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def _van_der_corput(count: int) -> NDArray[np.float64]:
    """Return the first numbers of the van der Corput sequence, shape [count]: 0, 1/2, 1/4, 3/4, 1/8 ..."""
    number, result = np.arange(count), np.zeros(count)
    share = 0.5
    while number.any():
        result += share * (number % 2)
        number, share = number // 2, share / 2
    return result
