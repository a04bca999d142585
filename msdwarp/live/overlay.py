"""Panels in front of a view in a window: images of text and curves on a translucent background."""

import functools
import importlib.util
import textwrap
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .shown import ENERGIES
from .sources import Reading

VEIL, INK, FAINT = (255, 255, 255, 205), (44, 50, 56, 255), (110, 118, 126, 255)
"""Colors of the background, of text, and of secondary text."""
CURVES = ("kinetic", "elastic", "potential")
RECENT = 60
"""Maximal number of readings that the plot of energies shows."""
FINE = 3
"""Curves are drawn at this multiple of the resolution, then reduced, for smooth edges."""


@functools.lru_cache(maxsize=16)
def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return a font that has arrows: Matplotlib's, since PyVista needs Matplotlib; otherwise Pillow's."""
    found = importlib.util.find_spec("matplotlib")
    if found is not None and found.origin is not None:
        fonts = Path(found.origin).parent / "mpl-data/fonts/ttf"
        with suppress(OSError):
            return ImageFont.truetype(fonts / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"), size)
    return ImageFont.load_default(size)


def _panel(width: float, height: float, unit: float) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """Return an empty panel of this size [pixels] with round corners, and a pen to draw on it."""
    size = (round(width), round(height))
    # A finer mask cuts the corners; colors stay white there, to avoid dark edges.
    mask = Image.new("L", (size[0] * FINE, size[1] * FINE), 0)
    ends = (0, 0, mask.width - 1, mask.height - 1)
    ImageDraw.Draw(mask).rounded_rectangle(ends, radius=8 * unit * FINE, fill=VEIL[3])
    image = Image.new("RGBA", size, VEIL)
    image.putalpha(mask.resize(size, Image.Resampling.BOX))
    return image, ImageDraw.Draw(image)


def text(lines: Sequence[str], unit: float, *, columns: int = 60) -> Image.Image:
    """Return lines of text, at least two: the first large, the last faint; wrapped after `columns` letters.

    `unit` is the scale: 1 in a window 720 rows high.
    """
    pad, large, small = 11 * unit, max(10, round(15 * unit)), max(9, round(13 * unit))
    first, body, hint = (_font(large, bold=True), INK), (_font(small), INK), (_font(small), FAINT)
    styles = [first, *[body] * (len(lines) - 2), hint]
    rows = [(row, one) for line, one in zip(lines, styles, strict=True) for row in textwrap.wrap(line, columns)]
    width, step = max(font.getlength(row) for row, (font, _) in rows), 1.5 * small
    image, pen = _panel(width + 2 * pad, len(rows) * step + 1.5 * pad, unit)
    for k, (row, (font, ink)) in enumerate(rows):
        pen.text((pad, 0.75 * pad + (k + 0.5) * step), row, ink, font, anchor="lm")
    return image


def notice(message: str, unit: float, *, columns: int = 56) -> Image.Image:
    """Return a message in large letters; for `unit` see `text`."""
    rows = textwrap.wrap(message, columns)
    size, pad = max(12, round((24 if len(rows) < 2 else 18) * unit)), 16 * unit
    font = _font(size)
    image, pen = _panel(
        max(font.getlength(row) for row in rows) + 2 * pad, len(rows) * 1.35 * size + 1.2 * pad, unit
    )
    for k, row in enumerate(rows):
        pen.text((image.width / 2, 0.6 * pad + (k + 0.5) * 1.35 * size), row, INK, font, anchor="mm")
    return image


def keys(listed: str, unit: float) -> Image.Image:
    """Return the list of keys: one line per key, with two spaces before the key's effect."""
    rows = [line.split("  ", 1) for line in listed.splitlines()]
    size, pad = max(9, round(15 * unit)), 16 * unit
    bold, plain = _font(size, bold=True), _font(size)
    first = max(bold.getlength(row[0]) for row in rows) + 1.2 * size
    width = first + max(plain.getlength(row[-1]) for row in rows) + 2 * pad
    image, pen = _panel(width, len(rows) * 1.5 * size + 1.4 * pad, unit)
    for k, row in enumerate(rows):
        y = 0.7 * pad + (k + 0.5) * 1.5 * size
        pen.text((pad, y), row[0], INK, bold, anchor="lm")
        pen.text((pad + first, y), row[-1], INK, plain, anchor="lm")
    return image


def energies(readings: Sequence[Reading], unit: float) -> Image.Image | None:
    """Return a plot of recent energy readings, with potential energy from its minimum; None for too few."""
    recent = list(readings)[-RECENT:]
    if len(recent) < 3 or recent[-1].time <= recent[0].time:
        return None
    size, pad, wide, high = max(8, round(12 * unit)), 11 * unit, 250 * unit, 84 * unit
    font = _font(size)
    image, pen = _panel(wide + 2 * pad, high + 2.2 * size + 2 * pad, unit)
    curves = {name: np.array([getattr(one, name) for one in recent]) for name in ("time", *CURVES)}
    times = curves.pop("time")
    curves["potential"] = curves["potential"] - curves["potential"].min()
    most = max(1e-30, *(float(np.nan_to_num(curve).max()) for curve in curves.values()))
    x = pad + wide * (times - times[0]) / (times[-1] - times[0])
    top, left = pad + 2.2 * size, pad
    strokes = Image.new("RGBA", (image.width * FINE, image.height * FINE), (255, 255, 255, 0))
    fine_pen = ImageDraw.Draw(strokes)
    for name, curve in curves.items():
        y = top + high * (1.0 - np.clip(np.nan_to_num(curve) / most, 0.0, 1.0))
        fine_pen.line([*zip(FINE * x, FINE * y, strict=True)], ENERGIES[name], round(2 * unit * FINE))
        pen.text((left, 0.8 * pad + size / 2), name, ENERGIES[name], font, anchor="lm")
        left += font.getlength(name) + size
    # The average is weighted by opacity, so that colors do not fade to white at edges.
    image.alpha_composite(strokes.resize(image.size, Image.Resampling.LANCZOS))
    pen.line([(pad, top + high), (pad + wide, top + high)], FAINT, max(1, round(unit)))
    pen.text((pad + wide, 0.8 * pad + size / 2), f"{most:.3g} J", FAINT, font, anchor="rm")
    return image
