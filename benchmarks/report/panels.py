"""What the report's figures share: how a picture is saved, bodies in the plane, arrows, and a row of numbers."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import NDArray

from msdwarp import System

INK, PALE, GROUND = "#333a40", "#9aa3ab", "#dfe4e8"
STOPS = ((0.13, 0.62, 0.33), (0.96, 0.80, 0.23), (0.85, 0.15, 0.14))
"""Colors of no strain, half and full strain in either direction: the report's green, yellow and red."""
STRAIN = LinearSegmentedColormap.from_list("strain", [tuple(stop) for stop in STOPS])
FULL_STRAIN = 0.2
"""Strain from which a connection is red: the report's."""


def row(figure: str, quantity: str, value: float, unit: str = "") -> dict:
    """Return a row of the CSV."""
    return {"figure": figure, "quantity": quantity, "value": float(value), "unit": unit}


def save(figure: Any, name: str, folder: Path) -> None:
    """Save a figure."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / name, dpi=118, bbox_inches="tight", pad_inches=0.08, pil_kwargs={"optimize": True})
    print(f"wrote {name} ({(folder / name).stat().st_size / 1e3:.0f} kB)")


def strains(system: System, positions: NDArray) -> NDArray:
    """Return the strain of every connection in every frame, shape [frame_count, connection_count]."""
    i, j = system.connections.T
    return np.linalg.norm(positions[:, i] - positions[:, j], axis=2) / system.rest_length - 1


def draw_body(axis: Any, system: System, position: NDArray, strain: NDArray, width: float = 1.6) -> None:
    """Draw connections in the colors of their strain, the most strained on top, and particles."""
    order = np.argsort(np.abs(strain))
    lines = LineCollection(
        position[system.connections[order]],
        cmap=STRAIN,
        norm=Normalize(0, FULL_STRAIN),
        linewidths=width,
        capstyle="round",
    )
    lines.set_array(np.abs(strain[order]))
    axis.add_collection(lines)
    axis.plot(*position.T, "o", color=INK, markersize=2.6 * width / 1.6)


def bare(axis: Any, left: float, right: float, top: float, *, below: float = 0.35) -> None:
    """Make a panel of the plane, at scale, with the ground."""
    axis.set(xlim=(left, right), ylim=(-below, top), aspect="equal", xticks=[], yticks=[])
    axis.grid(False)
    for spine in axis.spines.values():
        spine.set_visible(False)
    axis.add_patch(Rectangle((left, -below), right - left, below, color=GROUND, linewidth=0))
    axis.axhline(0, color=PALE, linewidth=1)


def strain_scale(figure: Any, axes: Any, **place: Any) -> None:
    """Add the scale of strain colors."""
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(Normalize(0, FULL_STRAIN), STRAIN), ax=axes, ticks=(0, 0.1, 0.2), **place)
    bar.ax.set_yticklabels(["0", "0.1", "0.2\nor more"])
    bar.set_label("|length / rest length − 1|")
    bar.outline.set_visible(False)


def arrow(axis: Any, start: Any, end: Any, color: str, width: float = 1.8, **style: Any) -> None:
    """Draw an arrow between two points."""
    shape = {"arrowstyle": "-|>", "mutation_scale": 7 + 3 * width, "shrinkA": 0, "shrinkB": 0}
    axis.add_patch(FancyArrowPatch(start, end, color=color, linewidth=width, zorder=3, **(shape | style)))
