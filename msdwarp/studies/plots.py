"""Curves over time, and pictures side by side."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import disk

RED, BLUE, GREEN, DARK = "#e4633f", "#2f6f9f", "#5a9e6f", "#333a40"
"""Colors of curves."""
_COMPONENT = re.compile(r"_(x|y|z|xx|yy|zz|xy|xz|yz|von_mises|mean|largest)(?=_(?:m|m_s|N|N_m)$|$)")
"""What a column of probe readings has after the quantity, before its unit."""


def output_path(path: str | Path, suffix: str, force: bool, name: str = "path") -> Path:
    """Return the path of a file to write; raise ValueError or OSError if the file cannot be written.

    `name` is the argument's name in messages.
    """
    path = Path(path)
    if path.suffix != suffix:
        raise ValueError(f"{name} is {path}; its name must end in {suffix}")
    if path.exists() and not force:
        raise FileExistsError(f"{name} is {path}, which exists; name another file or add --force")
    disk.writable_folder(name, path, path.parent)
    return path


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of this size [inches]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure: Any, path: str | Path) -> None:
    """Write a figure as a PNG file; raise OSError, which names the file, if that fails."""
    with disk.writing(Path(path)) as unfinished:
        figure.savefig(unfinished, dpi=150)


def plot_pictures(pictures: Sequence[NDArray[np.uint8]], titles: Sequence[str], about: str, path: Path) -> None:
    """Draw pictures of one size side by side, each below its title, as a PNG file; `about` is above all."""
    columns = math.ceil(math.sqrt(len(pictures)))
    rows = math.ceil(len(pictures) / columns)
    height, width = pictures[0].shape[:2]
    figure = new_figure(12, 12 / columns * rows * height / width + 0.3 * rows + 0.4)
    figure.suptitle(about, parse_math=False)
    for axes in (panels := figure.subplots(rows, columns, squeeze=False).ravel()):
        axes.set_axis_off()
    for axes, picture, title in zip(panels, pictures, titles, strict=False):
        axes.imshow(picture)
        axes.set_title(title)
    save_figure(figure, path)


def plot_log(csv_path: Path, png_path: Path) -> None:
    """Draw the energies of a CSV log against time, as a PNG file."""
    table = np.atleast_1d(np.genfromtxt(csv_path, delimiter=",", names=True))
    if not table.size:
        return
    figure = new_figure(8, 4.5)
    axes = figure.subplots()
    draw_energies(axes, table)
    axes.set_xlabel("time [s]")
    axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 1), ncols=4)
    save_figure(figure, png_path)


def plot_readings(csv_path: Path, png_path: Path, force: bool) -> Path:
    """Draw readings of probes against time, from a file such as a run's probes.csv; return the picture's path.

    Columns that differ in their component alone share a panel. Raises ValueError if the file has no such columns,
    or no rows.
    """
    target = output_path(png_path, ".png", force, "out")
    with csv_path.open(encoding="utf-8") as lines:
        time, *names = lines.readline().strip().split(",")
        if time != "time_s" or not names:
            raise ValueError(
                f"{csv_path} begins with {time[:40]!r}; it must have columns time_s, foot_force_x_N ..."
            )
        rows = lines.readlines()
    if not rows:
        raise ValueError(f"{csv_path} has no rows; nothing was read")
    table = np.loadtxt(rows, delimiter=",", ndmin=2)
    panels: dict[str, list[int]] = {}
    for k, name in enumerate(names, 1):
        panels.setdefault(_COMPONENT.sub("", name), []).append(k)
    figure = new_figure(8, 0.4 + 2.4 * len(panels))
    every = figure.subplots(len(panels), squeeze=False, sharex=True)[:, 0]
    for axes, (title, columns) in zip(every, panels.items(), strict=True):
        for k in columns:
            component = _COMPONENT.search(names[k - 1])
            axes.plot(
                table[:, 0], table[:, k], lw=1.5, label=component[1].replace("_", " ") if component else None
            )
        axes.set_ylabel(title, parse_math=False)
        axes.margins(x=0)
        add_grid(axes)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(frameon=False, ncols=4)
    every[-1].set_xlabel("time [s]")
    save_figure(figure, target)
    return target


def draw_energies(axes: Any, table: NDArray[np.void]) -> None:
    """Draw the energies of a table, with columns as in a log, against time."""
    start = table["gravitational_J"][0]
    curves = {
        "kinetic": (table["kinetic_J"], RED),
        "elastic": (table["elastic_J"], BLUE),
        "gravitational (0 at the start)": (table["gravitational_J"] - start, GREEN),
        "total": (table["total_J"] - start, DARK),
    }
    draw_curves(axes, table["time_s"], curves, "energy [J]")


def draw_curves(axes: Any, time: NDArray, curves: Mapping[str, tuple[NDArray, str]], quantity: str) -> None:
    """Draw curves against time, given as (values, color) by name; the DARK one is drawn thicker."""
    for label, (values, color) in curves.items():
        axes.plot(time, values, label=label, color=color, lw=2.2 if color == DARK else 1.5)
    axes.set_ylabel(quantity)
    axes.margins(x=0)
    add_grid(axes)


def add_grid(axes: Any) -> None:
    """Draw a faint grid, and remove the frame's upper and right lines."""
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
