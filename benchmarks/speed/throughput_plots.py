"""Draws the charts of throughput.py from its CSV rows and, where they are there, those of peers.csv."""

import math
from pathlib import Path

from ..common import pyplot, read_csv, save

COLORS = {"scatter": "#c8352b", "gather": "#e69f00", "stencil": "#0072b2"}
FORCE_ALGORITHMS = (
    "Stencil: neighbours of a lattice found by counting; gather: from a table; scatter: forces added by atomics."
)
PANELS = {"lattice": "Blocks: n × n × n particles, 26 neighbours", "cloth": "Cloth: n × n particles, 8 neighbours"}
PEERS = {
    "CUDA lattice": ("hand-written CUDA\nfor blocks only", "#222222", "D"),
    "CUDA scatter": ("hand-written CUDA,\natomics", "#777777", "v"),
    "newton": ("newton", "#7b3f9e", "P"),
}
"""Codes of peers.csv that are drawn: what they are called, color and marker."""
GREY = "#555555"


def draw(rows: list[dict], ceilings: list[dict], machine: str, folder: Path) -> None:
    """Draw both charts, by other names for the CPU."""
    rows = [r for r in rows if (r["method"], r["precision"]) == ("symplectic Euler", "float32")]
    if not any(r["family"] in PANELS for r in rows):
        return
    suffix = "_cpu" if folder.name == "cpu" else ""
    on = machine.split(";")[0].removeprefix("GPU ").removeprefix("CPU ")
    peers = read_csv(folder / "peers.csv")[1] if (folder / "peers.csv").exists() else []
    throughput(rows, peers, on, f"throughput{suffix}.png")
    floor = next(r["value"] for r in ceilings if r["ceiling"] == "launch")
    cost(rows, floor * 1e6, on, f"cost{suffix}.png")


def curves(axis, rows: list[dict], family: str, value: str) -> list[tuple]:
    """Plot a line for each algorithm; return (x, y, text, color) of their ends."""
    ends = []
    for force_algorithm, color in COLORS.items():
        mine = sorted(
            (r for r in rows if r["family"] == family and r["force_algorithm"] == force_algorithm), key=_particles
        )
        if mine:
            xs, ys = [_particles(r) for r in mine], [r[value] for r in mine]
            axis.loglog(xs, ys, "-", color=color)
            for r, x, y in zip(mine, xs, ys, strict=True):
                axis.plot(x, y, "o" if r["one_launch"] else "s", color=color, markerfacecolor=_fill(r, color))
            ends.append((xs[-1], ys[-1], force_algorithm, color))
    return ends


def _particles(row: dict) -> float:
    return row["particles"]


def _fill(row: dict, color: str) -> str:
    """Return what a marker is filled with: its color if "auto" takes this algorithm."""
    return color if row["automatic"] else "white"


def label_ends(axis, ends: list[tuple], room: float) -> None:
    """Write the labels of (x, y, text, color) to the right of all, in `room` times the last x.

    Labels that would overlap push each other apart.
    """
    low, high = map(math.log10, axis.get_ylim())
    right = 1.3 * max(x for x, *_ in ends)
    ends = sorted(ends, key=lambda end: end[1])
    heights = [0.026 * (high - low) * (1 + text.count("\n")) for _, _, text, _ in ends]  # half of each
    places = [math.log10(y) for _, y, *_ in ends]
    for _ in range(200):
        for k in range(len(places) - 1):
            overlap = heights[k] + heights[k + 1] - (places[k + 1] - places[k])
            if overlap > 0:
                places[k], places[k + 1] = places[k] - overlap / 2, places[k + 1] + overlap / 2
    for (_, _, text, color), place in zip(ends, places, strict=True):
        style = {"color": color, "va": "center", "fontweight": "bold", "fontsize": 9, "linespacing": 0.95}
        style["bbox"] = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}  # over dotted lines
        axis.text(right, 10**place, text, **style)
    axis.set_xlim(right=right * room)


def throughput(rows: list[dict], peers: list[dict], on: str, name: str) -> None:
    """Draw connection updates per second against particles."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(12.4, 5.2), sharey=True, layout="constrained")
    ends = []
    for axis, (family, title) in zip(axes, PANELS.items(), strict=True):
        found = curves(axis, rows, family, "connections_per_second")
        if family == "lattice":
            found += _peer_points(axis, peers)
        _floors(axis, rows, family)
        axis.set_title(title)
        axis.set_xlabel("particles")
        ends.append(found)
    axes[0].set_ylabel("connection updates [1/s]")
    for axis, found in zip(axes, ends, strict=True):
        if found:
            label_ends(axis, found, 25 if any("\n" in text for _, _, text, _ in found) else 6)
    figure.suptitle(_fastest(rows, on), x=0.01, ha="left", fontsize=12)
    notes = [
        f"Symplectic Euler in float32. {FORCE_ALGORITHMS}",
        "Filled markers: the algorithm taken by itself; circles: all substeps of a frame in one launch; squares: "
        "more launches.",
        "Dotted: what moving an algorithm's data from and to memory allows at the speed of a copy, if neighbours "
        "come from a cache. Small bodies stay in the caches.",
    ]
    figure.supxlabel("\n".join(notes), x=0.01, ha="left", fontsize=8.5, color=GREY)
    save(figure, name)


def _floors(axis, rows: list[dict], family: str) -> None:
    """Draw what the gathering routes' traffic allows, as for the largest body, with its name at the left.

    What scattering moves at least says little: it waits for its atomics.
    """
    left = min((_particles(r) for r in rows if r["family"] == family), default=1)
    for force_algorithm in ("gather", "stencil"):
        mine, color = (
            [r for r in rows if r["family"] == family and r["force_algorithm"] == force_algorithm],
            COLORS[force_algorithm],
        )
        if mine:
            largest = max(mine, key=_particles)
            bound = largest["connections_per_second"] / largest["share_of_bandwidth"]
            axis.axhline(bound, linestyle=":", linewidth=1.2, color=color)
            label = {"color": color, "fontsize": 8, "va": "bottom"}
            axis.text(left, bound * 1.03, f"{force_algorithm}: memory at the speed of a copy", **label)


def _peer_points(axis, peers: list[dict]) -> list[tuple]:
    """Plot the cubes of other codes; return (x, y, text, color) of their ends."""
    ends = []
    for code, (label, color, marker) in PEERS.items():
        mine = [r for r in peers if r["code"] == code and str(r["body"]).startswith("cube")]
        points = sorted((r["particles"], r["connections_per_second"]) for r in mine)
        points = [(x, y) for x, y in points if isinstance(y, float) and math.isfinite(y)]
        if points:
            axis.loglog(*zip(*points, strict=True), marker + "-", color=color, markersize=6, linewidth=0.7)
            ends.append((*points[-1], label, color))
    return ends


def _fastest(rows: list[dict], on: str) -> str:
    """Say how many updates each algorithm reaches in blocks, the fastest first."""
    best = {}
    for r in rows:
        if r["family"] == "lattice":
            best[r["force_algorithm"]] = max(best.get(r["force_algorithm"], 0.0), r["connections_per_second"])
    ranked = sorted(best.items(), key=lambda item: -item[1])
    said = ", ".join(f"{_count(rate)} by {force_algorithm}" for force_algorithm, rate in ranked)
    return f"Connections of a block updated per second, at best: {said} ({on})"


def _count(number: float) -> str:
    """Return a number in words, to two digits."""
    size, word = (1e9, "billion") if number >= 1e9 else (1e6, "million")
    digits = max(0, 1 - math.floor(math.log10(number / size)))
    return f"{round(number / size, 1 - math.floor(math.log10(number / size))):.{digits}f} {word}"


def cost(rows: list[dict], floor: float, on: str, name: str) -> None:
    """Draw the time of a substep against particles, with that of an empty launch."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(12.4, 5.0), sharey=True, layout="constrained")
    ends = []
    for axis, (family, title) in zip(axes, PANELS.items(), strict=True):
        ends.append(curves(axis, rows, family, "us_per_substep"))
        axis.axhline(floor, linestyle="--", linewidth=1.2, color=GREY)
        axis.set_title(title)
        axis.set_xlabel("particles")
    axes[0].set_ylabel("time of a substep [µs]")
    for axis, found in zip(axes, ends, strict=True):
        if found:
            label_ends(axis, found, 6)
            where = {"va": "bottom", "ha": "right", "fontsize": 8, "color": GREY}
            right = axis.get_xlim()[1]
            axis.text(
                right / 1.2, floor * 1.06, f"a launch of nothing in a recorded frame: {floor:.2g} µs", **where
            )
    figure.suptitle(_flat(rows, on), x=0.01, ha="left", fontsize=12)
    note = (
        f"Symplectic Euler in float32. {FORCE_ALGORITHMS}\nFilled markers: the algorithm taken by itself. "
        "Circles: all 48 substeps of a frame in one launch; squares: a launch for each substep, two if scattered."
    )
    figure.supxlabel(note, x=0.01, ha="left", fontsize=8.5, color=GREY)
    save(figure, name)


def _flat(rows: list[dict], on: str) -> str:
    """Say what the smallest and the largest block take, and the largest that takes a few times the least."""
    mine = sorted((r for r in rows if r["family"] == "lattice" and r["automatic"]), key=_particles)
    least, most = mine[0], mine[-1]
    flat = max(_particles(r) for r in mine if r["us_per_substep"] <= 6 * least["us_per_substep"])
    return (
        f"A substep of a block takes {_span(least['us_per_substep'])} with {_thousands(_particles(least))}"
        f" particles, not six times that up to {_thousands(flat)}, {_span(most['us_per_substep'])} with "
        f"{_thousands(_particles(most))} ({on})"
    )


def _span(microseconds: float) -> str:
    """Return a time in its unit, to two digits."""
    size, unit = (1000, "ms") if microseconds >= 1000 else (1, "µs")
    return f"{float(f'{microseconds / size:.2g}'):g} {unit}"


def _thousands(number: float) -> str:
    """Return a whole number with thin spaces between thousands, or in millions."""
    return f"{number / 1e6:.3g} million" if number >= 1e6 else f"{number:,.0f}".replace(",", "\u202f")
