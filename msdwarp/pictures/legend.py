"""Legends of pictures: color bars and force arrows."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..kernels.pictures import drawing
from .arrows import COLOR, LONGEST
from .drawing import ColorScale

LEGIBLE, LEAST = 9 / 19, 4 / 19
"""Scales, 1 in a picture of 720 rows, of legends in small pictures, and of the smallest, if there is no room."""
MOST_ROOM = 0.3
"""Largest fraction of the picture's height that the camera keeps free for legends."""
INK, VEIL = (60, 66, 72, 255), (255, 255, 255, 150)
"""Colors of letters and of the translucent background."""
Stops = tuple[tuple[float, float, float], ...]


def ramp(stops: Stops, count: int) -> NDArray[np.float64]:
    """Return colors in 0 … 1, evenly spaced on a scale from end to end, shape [count, 3]."""
    at, places = np.linspace(0, 1, count), np.linspace(0, 1, len(stops))
    return np.stack([np.interp(at, places, channel) for channel in np.transpose(stops)], axis=1)


class Legends(NamedTuple):
    """Legends at the upper edge of a picture, in its left and its right corner."""

    left: Image.Image | None
    right: Image.Image | None

    @property
    def height(self) -> int:
        """Height of the taller one in pixels; 0 if there is none."""
        return max((one.height for one in self if one is not None), default=0)


@functools.lru_cache(maxsize=4)
def legends(size: tuple[int, int], scale: ColorScale | None, stops: Stops, full: float | None = None) -> Legends:
    """Return an arrow for the force `full` [N], and the color bar of a scale, that do not overlap.

    `size` is the width and height of the picture.
    """
    width, height = size
    unit = max(height / 720, LEGIBLE)
    while True:
        left = None if full is None else arrow(unit, f"{full:g} N or more", LONGEST * height)
        right = None if scale is None else bar(unit, scale, stops)
        if unit <= LEAST or sum(one.width for one in (left, right) if one is not None) <= width:
            return Legends(left, right)
        unit *= 0.9


def bar(unit: float, scale: ColorScale, stops: Stops) -> Image.Image:
    """Return the color bar; `unit` is 1 for a picture of 720 rows."""
    length, thick, size = round(260 * unit), max(4, round(14 * unit)), round(19 * unit)
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


def arrow(unit: float, label: str, length: float) -> Image.Image:
    """Return an arrow of this length [pixels] with its label; `unit` is 1 for a picture of 720 rows."""
    size = round(19 * unit)
    font = ImageFont.load_default(size)
    legend = Image.new("RGBA", (math.ceil(length + font.getlength(label) + 3 * size), 2 * size), VEIL)
    pen, color = ImageDraw.Draw(legend), tuple(round(255 * c) for c in COLOR)
    tip, neck, half = size + length, size + length - drawing.HEAD * length, drawing.WIDE * length
    pen.line([(size, size), (neck, size)], color, max(1, round(2 * drawing.THICK * length)))
    pen.polygon([(tip, size), (neck, size - half), (neck, size + half)], color)
    pen.text((tip + size / 2, size), label, INK, font, anchor="lm")
    return legend


def with_legends(image: NDArray[np.uint8], shown: Legends) -> NDArray[np.uint8]:
    """Return the picture with its legends."""
    if not shown.height:
        return image
    picture = Image.fromarray(image)
    for legend in shown:
        if legend is not None:
            at = 0 if legend is shown.left else picture.width - legend.width, 0
            if picture.mode == "RGBA":
                picture.alpha_composite(legend, at)
            else:
                picture.paste(legend, at, legend)
    return np.asarray(picture)
