"""Legends of pictures: color bars and force arrows."""

import functools
import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..kernels.pictures import drawing
from .arrows import COLOR
from .drawing import ColorScale

ROOM = 0.125
"""Height of a legend at the upper edge, over the height of the picture."""
INK, VEIL = (60, 66, 72, 255), (255, 255, 255, 150)
"""Colors of letters and of the translucent background."""
Stops = tuple[tuple[float, float, float], ...]


def ramp(stops: Stops, count: int) -> NDArray[np.float64]:
    """Return colors in 0 … 1, evenly spaced on a scale from end to end, shape [count, 3]."""
    at, places = np.linspace(0, 1, count), np.linspace(0, 1, len(stops))
    return np.stack([np.interp(at, places, channel) for channel in np.transpose(stops)], axis=1)


@functools.lru_cache(maxsize=4)
def bar(height: int, scale: ColorScale, stops: Stops) -> Image.Image:
    """Return the color bar for a picture of this height."""
    unit = height / 720
    length, thick, size = round(260 * unit), max(4, round(14 * unit)), max(9, round(19 * unit))
    font = ImageFont.load_default(size)
    # A margin on either side for half the last number; more if the label needs it.
    left, top = max(4 * size, math.ceil((font.getlength(scale.label) - length + size) / 2)), round(1.6 * size)
    legend = Image.new("RGBA", (length + 2 * left, thick + 4 * size), VEIL)
    pixels = np.broadcast_to(np.round(255 * ramp(stops, length)).astype(np.uint8), (thick, length, 3))
    legend.paste(Image.fromarray(np.ascontiguousarray(pixels)), (left, top))
    pen = ImageDraw.Draw(legend)
    pen.text((left + length / 2, size / 5), scale.label, INK, font, anchor="ma")
    for fraction in (0, 0.5, 1) if length > 100 else (0, 1):  # a short bar has no space for three numbers
        value = (2 * fraction - 1 if scale.signed else fraction) * scale.full
        label = f"{value:+g}" if scale.signed and value else f"{value:g}" + (" or more" if fraction == 1 else "")
        pen.text((left + fraction * length, top + thick + size / 4), label, INK, font, anchor="ma")
    return legend


@functools.lru_cache(maxsize=4)
def arrow(height: int, label: str, fraction: float) -> Image.Image:
    """Return an arrow whose length is a `fraction` of the picture's height, with its label."""
    size, length = max(9, round(19 * height / 720)), fraction * height
    font = ImageFont.load_default(size)
    legend = Image.new("RGBA", (math.ceil(length + font.getlength(label) + 3 * size), 2 * size), VEIL)
    pen, color = ImageDraw.Draw(legend), tuple(round(255 * c) for c in COLOR)
    tip, neck, half = size + length, size + length - drawing.HEAD * length, drawing.WIDE * length
    pen.line([(size, size), (neck, size)], color, max(1, round(2 * drawing.THICK * length)))
    pen.polygon([(tip, size), (neck, size - half), (neck, size + half)], color)
    pen.text((tip + size / 2, size), label, INK, font, anchor="lm")
    return legend


def with_corner(image: NDArray[np.uint8], legend: Image.Image, *, right: bool) -> NDArray[np.uint8]:
    """Return the picture with a legend in its upper right or left corner."""
    picture = Image.fromarray(image)
    at = picture.width - legend.width if right else 0, 0
    if picture.mode == "RGBA":
        picture.alpha_composite(legend, at)
    else:
        picture.paste(legend, at, legend)
    return np.asarray(picture)
