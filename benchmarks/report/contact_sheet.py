"""A contact sheet of all scenes: each simulated to its best moment, drawn, and laid out as a grid.

    python -m benchmarks.report.contact_sheet [--scenes NAME ...] [--width PIXELS] [--out FILE]

writes docs/images/scenes.png; `--scenes cube worm` draws those only.
"""

import argparse
import dataclasses
import math
import textwrap
from pathlib import Path
from types import ModuleType

import numpy as np
import warp as wp
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from msdwarp import Renderer, Simulation

from ..common import IMAGES, scene_scripts

TARGET = IMAGES / "scenes.png"

BEST = {
    "balloon": 1.5,
    "block2d": 1.1,
    "bridge": 7.0,
    "chain": 0.3,
    "cloth": 2.0,
    "cookie": 0.36,
    "cradle": 1.0,
    "crawl": 4.4,
    "cube": 0.62,
    "curtain": 2.0,
    "dice": 1.2,
    "flag": 3.6,
    "mattress": 2.8,
    "snap": 0.4,
    "pile": 1.5,
    "robot": 2.2,
    "soft_cube": 0.45,
    "tower": 0.45,
    "trampoline": 0.65,
    "waffle": 1.0,
    "walker": 3.6,
    "worm": 1.25,
}
"""When a scene looks its best [s], where that is not DEFAULT times its duration."""
DEFAULT = 0.45

ASPECT = 1.6
"""Width over height of a picture."""
PAPER, FRAME, INK, PALE = (255, 255, 255), (222, 226, 230), (38, 44, 50), (128, 136, 144)


def picture(name: str, script: ModuleType, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a scene at its best moment, simulated on the CPU."""
    scene = script.build()
    moment = BEST.get(name, DEFAULT * scene.duration)
    simulation = Simulation.from_scene(scene, device="cpu")
    *_, last = simulation.frames(moment)
    if scene.system.tears:  # what is torn is drawn apart
        torn = scene.system.replace(broken_at=simulation.snapshot().broken_at)
        scene = dataclasses.replace(scene, system=torn)
    return Renderer(scene, last.position, resolution=size).image(last.position, last.time)


def caption(script: ModuleType) -> str:
    """Return the first line of a scene's docstring."""
    line = (script.__doc__ or "").partition("\n")[0]
    return line.replace("×", "x")  # which Pillow's font lacks


def grid(count: int) -> tuple[int, int]:
    """Return (columns, rows) for so many pictures: wider than high, with few places left empty."""

    def cost(columns: int) -> float:
        rows = math.ceil(count / columns)
        return abs(math.log(columns / rows / 1.5)) + 3 * (columns * rows - count) / (columns * rows)

    columns = min(range(1, count + 1), key=cost)
    return columns, math.ceil(count / columns)


def sheet(pictures: list[tuple[str, NDArray[np.uint8], str]], width: int) -> Image.Image:
    """Lay out (name, picture, caption), each `width` pixels wide; a last row that is not full is centred."""
    columns, rows = grid(len(pictures))
    height = round(width / ASPECT)
    unit = width / 480
    margin, gap, text = round(72 * unit), round(40 * unit), round(66 * unit)
    size = (
        2 * margin + columns * width + (columns - 1) * gap,
        2 * margin + rows * (height + text) + (rows - 1) * gap,
    )
    paper = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(paper)
    title, small = (ImageFont.load_default(round(points * unit)) for points in (17, 13.5))
    for k, (name, image, words) in enumerate(pictures):
        row, column = divmod(k, columns)
        missing = columns - min(columns, len(pictures) - row * columns)
        x = margin + round((column + missing / 2) * (width + gap))
        y = margin + row * (height + text + gap)
        paper.paste(Image.fromarray(image), (x, y))
        pen.rectangle((x - 1, y - 1, x + width, y + height), outline=FRAME)
        pen.text((x, y + height + 11 * unit), name.replace("_", " "), INK, title)
        letters = int(width / small.getlength("n") * 1.16)  # of average width
        lines = "\n".join(textwrap.wrap(words, letters))
        pen.multiline_text((x, y + height + 33 * unit), lines, PALE, small, spacing=4 * unit)
    return paper


def main() -> None:
    """Draw the scenes that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    scripts = scene_scripts()
    parser.add_argument("--scenes", nargs="+", choices=scripts, default=list(scripts), help="by default all")
    parser.add_argument("--width", type=int, default=480, help="of each picture, in pixels")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    size = (options.width, round(options.width / ASPECT))
    pictures = []
    for name in options.scenes:
        print(name, flush=True)
        pictures.append((name, picture(name, scripts[name], size), caption(scripts[name])))
    sheet(pictures, options.width).save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
