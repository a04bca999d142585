"""What is written over a picture: the strain bar."""

import functools

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .scene import Look

STOPS = np.array([[0.13, 0.62, 0.33], [0.96, 0.80, 0.23], [0.85, 0.15, 0.14]])
"""Colours at no strain, half and full strain; the same as in kernels/drawing.py."""


@functools.lru_cache(maxsize=4)
def _strain_bar(height: int, full_strain: float) -> Image.Image:
    """Return the legend for a picture of this height, on a veil through which the picture is seen faintly."""
    unit = height / 720
    length, thick, size = round(260 * unit), max(4, round(14 * unit)), max(9, round(19 * unit))
    legend = Image.new("RGBA", (length + 8 * size, thick + 4 * size), (255, 255, 255, 150))
    at = np.linspace(0, 1, length)
    ramp = np.stack([np.interp(at, (0, 0.5, 1), STOPS[:, k]) for k in range(3)], axis=1)
    pixels = np.broadcast_to(np.round(255 * ramp).astype(np.uint8), (thick, length, 3))
    left, top = 4 * size, round(1.6 * size)
    legend.paste(Image.fromarray(np.ascontiguousarray(pixels)), (left, top))
    pen, font, ink = ImageDraw.Draw(legend), ImageFont.load_default(size), (60, 66, 72, 255)
    pen.text((left + length / 2, 0), "strain  |length / rest length - 1|", ink, font, anchor="ma")
    for share in (0, 0.5, 1):
        label = f"{share * full_strain:g}" + (" or more" if share == 1 else "")
        pen.text((left + share * length, top + thick + size / 4), label, ink, font, anchor="ma")
    return legend


def with_strain_bar(image: NDArray[np.uint8], look: Look) -> NDArray[np.uint8]:
    """Return the picture with the legend of strain colours in its lower right corner."""
    picture = Image.fromarray(image)
    legend = _strain_bar(picture.height, look.full_strain)
    picture.paste(legend, (picture.width - legend.width, picture.height - legend.height), legend)
    return np.asarray(picture)
