"""A contact sheet of all scenes: each simulated to its best moment, drawn, and laid out as a grid.

Run `python benchmarks/contact_sheet.py`; it writes docs/images/scenes.png. `--scenes cube worm` draws those only.
"""

import argparse
import ast
import importlib.util
import math
import pkgutil
import textwrap
from pathlib import Path

import numpy as np
import warp as wp
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from msdwarp import Renderer, Simulation, scenes
from msdwarp.cli.scene_files import find_scene

TARGET = Path(__file__).parents[1] / "docs" / "images" / "scenes.png"

BEST = {
    "block2d": 1.1,
    "chain": 0.3,
    "cloth": 2.0,
    "cube": 0.95,
    "dice": 0.5,
    "mattress": 2.8,
    "soft_cube": 0.45,
    "waffle": 1.0,
    "worm": 1.6,
}
"""When a scene looks its best [s], where that is not DEFAULT times its duration."""
DEFAULT = 0.45

ASPECT = 1.6
"""Width over height of a picture."""
PAPER, FRAME, INK, PALE = (255, 255, 255), (222, 226, 230), (38, 44, 50), (128, 136, 144)


def names() -> list[str]:
    """Return the names of the scenes that come with msdwarp."""
    return sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))


def picture(name: str, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a scene at its best moment, simulated on the CPU."""
    scene = find_scene(name).scene()
    moment = BEST.get(name, DEFAULT * scene.duration)
    *_, last = Simulation.of(scene, device="cpu").frames(moment)
    return Renderer(scene, last.position, resolution=size).image(last.position, last.time)


def caption(name: str) -> str:
    """Return the first line of a scene's docstring."""
    spec = importlib.util.find_spec(f"{scenes.__name__}.{name}")
    assert spec is not None
    assert spec.origin is not None
    source = Path(spec.origin).read_text(encoding="utf-8")
    line = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
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
    parser.add_argument("--scenes", nargs="+", choices=names(), default=names(), help="by default all")
    parser.add_argument("--width", type=int, default=480, help="of each picture, in pixels")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    size = (options.width, round(options.width / ASPECT))
    pictures = []
    for name in options.scenes:
        print(name, flush=True)
        pictures.append((name, picture(name, size), caption(name)))
    sheet(pictures, options.width).save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
