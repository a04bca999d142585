"""Tone mapping: what a page is given, so that in full light its colors are those of pictures.

A page is drawn by three.js, whose film curve changes colors: `ACESFilmicToneMapping`, S. Hill's fit of the
reference transforms of the Academy Color Encoding System. Here is its inverse.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

LIGHT = math.pi
"""Intensity of light of strength 1 on a page: matt surfaces of three.js reflect 1 / π of it."""
EXPOSURE = 1 / 0.6
BRIGHTEST = 0.76
"""Where white ends on the curve. Brighter colors are made as much darker."""
IN = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
OUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
ABOVE, BELOW = (1.0, 0.0245786, -0.000090537), (0.983729, 0.4329510, 0.238081)
"""Coefficients of the polynomials, from the second degree on, whose ratio is the curve."""


def paint(colors: ArrayLike) -> NDArray[np.uint8]:
    """Return the colors of materials, bytes of shape [..., 3], that a page shows in full LIGHT as these."""
    shown = np.asarray(colors) / 255
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    curved = np.maximum(linear @ np.linalg.inv(OUT).T, 0)
    curved = curved * (BRIGHTEST / np.maximum(curved.max(axis=-1, keepdims=True), BRIGHTEST))
    # The larger root of a quadratic equation, whose first coefficient is above 0.
    a, b, c = (one - curved * other for one, other in zip(ABOVE, BELOW, strict=True))
    before = (np.sqrt(b * b - 4 * a * c) - b) / (2 * a)
    return encoded(np.clip(before @ np.linalg.inv(IN).T / EXPOSURE, 0, 1))


def encoded(linear: ArrayLike) -> NDArray[np.uint8]:
    """Return the bytes of sRGB (IEC 61966-2-1) for intensities 0 … 1."""
    linear = np.asarray(linear)
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * shown).astype(np.uint8)
