"""What is written over a picture: what its colours tell."""

import functools
import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..kernels.pictures import HEAD, THICK, WIDE
from .arrows import COLOUR
from .drawing import ColourScale

ROOM = 0.125
"""What a legend needs of the upper edge, by the height of the picture."""
Stops = tuple[tuple[float, float, float], ...]


@functools.lru_cache(maxsize=4)
def bar(height: int, scale: ColourScale, stops: Stops) -> Image.Image:
    """Return the legend for a picture of this height, on a veil through which the picture is seen faintly."""
    unit = height / 720
    length, thick, size = round(260 * unit), max(4, round(14 * unit)), max(9, round(19 * unit))
    font, ink = ImageFont.load_default(size), (60, 66, 72, 255)
    # A margin on either side for half the last number, and more where the label is longer than that leaves.
    left, top = max(4 * size, math.ceil((font.getlength(scale.label) - length + size) / 2)), round(1.6 * size)
    legend = Image.new("RGBA", (length + 2 * left, thick + 4 * size), (255, 255, 255, 150))
    at = np.linspace(0, 1, length)
    ramp = np.stack([np.interp(at, np.linspace(0, 1, len(stops)), c) for c in np.transpose(stops)], axis=1)
    pixels = np.broadcast_to(np.round(255 * ramp).astype(np.uint8), (thick, length, 3))
    legend.paste(Image.fromarray(np.ascontiguousarray(pixels)), (left, top))
    pen = ImageDraw.Draw(legend)
    pen.text((left + length / 2, size / 5), scale.label, ink, font, anchor="ma")
    for share in (0, 0.5, 1) if length > 100 else (0, 1):  # where there is no room for three numbers
        value = (2 * share - 1 if scale.signed else share) * scale.full
        label = f"{value:+g}" if scale.signed and value else f"{value:g}" + (" or more" if share == 1 else "")
        pen.text((left + share * length, top + thick + size / 4), label, ink, font, anchor="ma")
    return legend


def with_bar(image: NDArray[np.uint8], scale: ColourScale, stops: Stops) -> NDArray[np.uint8]:
    """Return the picture with a bar of the scale's colours, evenly spaced stops, in its upper right corner."""
    picture = Image.fromarray(image)
    legend = bar(picture.height, scale, stops)
    picture.paste(legend, (picture.width - legend.width, 0), legend)
    return np.asarray(picture)


def with_arrow(image: NDArray[np.uint8], label: str, share: float) -> NDArray[np.uint8]:
    """Return the picture with an arrow in its upper left corner, so long by its height, and what it stands for."""
    picture = Image.fromarray(image)
    unit = picture.height / 720
    size, length = max(9, round(19 * unit)), share * picture.height
    font, ink = ImageFont.load_default(size), (60, 66, 72, 255)
    wide = math.ceil(length + font.getlength(label) + 3 * size)
    legend = Image.new("RGBA", (wide, 2 * size), (255, 255, 255, 150))
    pen, colour = ImageDraw.Draw(legend), tuple(round(255 * c) for c in COLOUR)
    tip, head = size + length, HEAD * length
    pen.line([(size, size), (tip - head, size)], colour, max(1, round(2 * THICK * length)))
    pen.polygon([(tip, size), (tip - head, size - WIDE * length), (tip - head, size + WIDE * length)], colour)
    pen.text((tip + size / 2, size), label, ink, font, anchor="lm")
    picture.paste(legend, (0, 0), legend)
    return np.asarray(picture)
