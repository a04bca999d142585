"""The report's figures that show no run, drawn again: the force law, who is joined, two ways to the sum."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from numpy.typing import NDArray

from msdwarp import sheet
from msdwarp.shapes.grid import lattice_directions

from ..common import pyplot
from .panels import INK, PALE, arrow, row, save


def _view(axis: Any, middle: tuple[float, float], height: float) -> None:
    """Show what is around a point, all panels in the same proportions."""
    x, y, width = *middle, 1.65 * height
    axis.set(xlim=(x - width / 2, x + width / 2), ylim=(y - height / 2, y + height / 2), aspect="equal")


def _ball(axis: Any, place: Any, text: str = "", radius: float = 0.13, color: str = "#0072b2") -> None:
    axis.add_patch(Circle(place, radius, facecolor=color, edgecolor="white", linewidth=1.2, zorder=4))
    axis.text(*place, text, color="white", ha="center", va="center", zorder=5, fontsize=10, style="italic")


def _law(axis: Any) -> None:
    """Draw a spring and a damper between two particles, and the forces on one (figures 1 to 4)."""
    _view(axis, (2.35, -0.15), 3.3)
    for x in (0.3, 2.7):
        axis.plot((x, x), (-0.42, 0.42), color=INK, linewidth=1.4)
    axis.plot((0, 0.3), (0, 0), color=INK, linewidth=1.4)
    axis.plot((2.7, 3.0), (0, 0), color=INK, linewidth=1.4)
    wave = np.linspace(0, 1, 17)
    spring = 0.42 + 0.17 * np.array([0, 0, *[(-1) ** k for k in range(13)], 0, 0])
    axis.plot(0.3 + 2.4 * wave, spring, color="#009e73", linewidth=1.8)
    for x, y in (
        ((0.3, 1.35), (-0.42, -0.42)),
        ((1.85, 1.35, 1.35, 1.85), (-0.26, -0.26, -0.58, -0.58)),
        ((1.62, 1.62), (-0.54, -0.30)),
        ((1.62, 2.7), (-0.42, -0.42)),
    ):
        axis.plot(x, y, color="#e69f00", linewidth=1.8)
    axis.text(1.5, 0.72, "spring  $k,\\ l_0$", color="#007a58", ha="center", va="bottom")
    axis.text(1.5, -0.72, "damper  $b$", color="#a87400", ha="center", va="top")
    _ball(axis, (0, 0), "j", 0.2)
    _ball(axis, (3, 0), "i", 0.2)
    arrow(axis, (3, 0), (3.95, 0.95), INK)
    axis.plot((3.95, 3.95), (0.95, 0), color=PALE, linewidth=1, linestyle=":")
    axis.plot((3.0, 4.1), (0, 0), color=PALE, linewidth=1, linestyle=":")
    axis.text(3.98, 1.0, "$\\Delta v$", color=INK)
    axis.text(4.02, 0.05, "$\\Delta v\\cdot\\Delta\\hat{x}$", color=INK, va="bottom")
    arrow(axis, (0, -1.18), (3, -1.18), INK, 1.2)
    axis.text(1.5, -1.22, "$\\Delta x = x_i - x_j$", ha="center", va="top", color=INK)
    arrow(axis, (3, 0.0), (2.15, 0.0), "#c8352b", 2.2)
    axis.text(2.12, 0.02, "$F_i$", color="#c8352b", ha="right", va="center")
    axis.set_title("The force of a connection (report, figures 1 to 4)")


def _rules(axis: Any) -> None:
    """Draw four neighbours, and eight (figure 6)."""
    _view(axis, (1.85, -0.2), 3.8)
    for middle, diagonals in ((0.0, False), (3.7, True)):
        for x, y in itertools.product((-1, 0, 1), repeat=2):
            if (x or y) and (diagonals or not x * y):
                color = "#e69f00" if x * y else "#0072b2"
                axis.plot((middle, middle + x), (0, y), color=color, linewidth=2)
            _ball(axis, (middle + x, y), color="#0072b2" if (x, y) == (0, 0) else "#8a949c")
        label = "8 neighbours: it holds" if diagonals else "4 neighbours: it shears"
        axis.text(middle, -1.38, label, ha="center", va="top", color=INK)
    axis.set_title("Connection rules in the plane (figure 6)")


def _directions(axis: Any) -> None:
    """Draw the thirteen directions of the rule of 26 neighbours."""
    view = np.array([[1.0, -0.13], [0.55, 0.22], [0.0, 1.0]])

    def flat(point: Any) -> NDArray:
        return np.array(point) @ view

    _view(axis, (1.05, 0.0), 3.5)
    corners = list(itertools.product((-1, 0, 1), repeat=3))
    for a, b in itertools.combinations(corners, 2):
        if sum(abs(p - q) for p, q in zip(a, b, strict=True)) == 1:
            axis.plot(*np.array([flat(a), flat(b)]).T, color="#e3e7ea", linewidth=0.8, zorder=0)
    colors = {1: "#0072b2", 2: "#e69f00", 3: "#c8352b"}
    for step in lattice_directions(3, diagonals=True).values():
        n = sum(map(abs, step))
        arrow(axis, flat((0, 0, 0)), 0.93 * flat(step), colors[n], 2.0 if n == 1 else 1.6)
        axis.plot(*np.array([flat((0, 0, 0)), -flat(step)]).T, color=colors[n], linewidth=0.9, alpha=0.35)
    for corner in sorted(corners, key=lambda c: -c[1]):
        _ball(axis, flat(corner), radius=0.06, color=INK if corner == (0, 0, 0) else "#8a949c")
    names = {1: "3 axes, length 1", 2: "6 face diagonals, √2", 3: "4 space diagonals, √3"}
    for k, (n, name) in enumerate(names.items()):
        axis.text(1.75, 0.55 - 0.36 * k, name, color=colors[n], va="center", fontsize=9.5)
    axis.set_title("26 neighbours in space: 13 directions and back")


def _routes(axis: Any) -> None:
    """Draw four particles, all joined, by connection and by particle (figure 10)."""
    _view(axis, (2.55, 0.5), 3.6)
    corners = np.array([[0, 0], [1.8, 0], [1.8, 1.8], [0, 1.8]])
    shown = (
        (0.0, "by connection (algorithm 3):\n6 forces, each added at two ends"),
        (3.3, "by particle (algorithm 2):\n12 forces, each added at one end"),
    )
    for shift, label in shown:
        at = corners + np.array([shift, 0.0])
        for a, b in itertools.combinations(range(4), 2):
            axis.plot(*at[[a, b]].T, color="#d5dade", linewidth=1.2, zorder=0)
            diagonal = abs(a - b) == 2
            # The diagonals cross in the middle; the point of one is moved aside.
            place = (0.62 if (a, b) == (0, 2) else 0.38) if diagonal else 0.5
            for start, end, share in ((a, b, 1 - place), (b, a, place)):
                along = at[end] - at[start]
                unit = along / np.linalg.norm(along)
                if shift:  # a force computed near each end, for that end alone
                    source = at[end] - 0.72 * unit
                    axis.plot(*source, "o", color="#c8352b", markersize=4.5)
                    arrow(axis, source, at[end] - 0.2 * unit, "#c8352b", 1.3)
                else:
                    source = at[start] + (1 - share) * along
                    arrow(axis, source, at[end] - 0.2 * unit, "#009e73", 1.3)
                    axis.plot(*source, "o", color="#009e73", markersize=5.5, zorder=4)
        for k, place in enumerate(at):
            _ball(axis, place, str(k + 1), 0.17)
        axis.text(shift + 0.9, -0.34, label, ha="center", va="top", fontsize=9.5, color=INK)
    axis.set_title("Two algorithms to the same sum (figure 10)")


def drawings(folder: Path) -> list[dict]:
    """Draw the force law, the connection rules and the algorithms in one picture; return counts of them."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
    for axis, draw in zip(axes.ravel(), (_law, _rules, _directions, _routes), strict=True):
        axis.axis("off")
        draw(axis)
    save(figure, "report_drawings.png", folder)
    square = sheet((2, 2), dim=2)
    return [
        row("figure 10", "four particles: connections", square.connection_count),
        row("figure 10", "four particles: neighbours", 2 * square.connection_count),
        row("section 2.1.5", "directions of 26 neighbours", len(lattice_directions(3, diagonals=True))),
    ]
