"""Measure textbook experiments, and compare them with their closed forms.

    python -m benchmarks.accuracy.validation [--device D] [--quick] [--plot-only]

`textbook_waves.py` and `textbook_motions.py` have the experiments. validation.csv has a row for each quantity:
`exact` by the closed form, `measured`, and `deviation` (measured over exact, minus 1). validation_curves.csv has
what is drawn.
"""

from ..common import COLORS, arguments, machine, pyplot, read_csv, save, table, write_csv
from . import textbook_motions as motions, textbook_waves as waves
from .textbook import Found

EXPERIMENTS = {
    "slinky drop": waves.slinky_drop,
    "catenary": motions.catenary,
    "elastic pendulum": motions.elastic_pendulum,
    "string": waves.string_modes,
    "membrane": waves.membrane_modes,
    "dispersion of a chain": waves.dispersion,
    "Euler load": waves.euler_load,
    "elastica": motions.elastica,
    "Dzhanibekov": motions.dzhanibekov,
    "Kapitza's pendulum": motions.kapitza,
    "bubble": waves.bubble,
}
COLUMNS = 3
"""Charts in a row."""
MOST = 150
"""Points of a curve that are kept, about."""


def quantities(name: str, found: Found) -> list[dict]:
    """Return the rows of an experiment's quantities."""
    return [
        {"experiment": name, "quantity": q.name, "unit": q.unit}
        | {"exact": float(q.exact), "measured": float(q.measured), "deviation": f"{q.deviation:.1e}"}
        for q in found.quantities
    ]


def curves(name: str, found: Found) -> list[dict]:
    """Return the rows of an experiment's chart."""
    head = {"experiment": name, "x_axis": found.axes[0], "y_axis": found.axes[1]}
    return [
        head | {"kind": kind, "x": float(x), "y": float(y)}
        for kind, points in (("measured", found.points), ("exact", found.curve))
        for x, y in zip(*(one[:: max(1, len(one) // MOST)] for one in points), strict=True)
    ]


def draw(rows: list[dict]) -> None:
    """Draw a chart for each experiment: closed form and measured points."""
    plt = pyplot()
    names = list(dict.fromkeys(row["experiment"] for row in rows))
    lines = -(-len(names) // COLUMNS)
    figure, axes = plt.subplots(lines, COLUMNS, figsize=(4.2 * COLUMNS, 2.9 * lines), layout="constrained")
    flat = axes.ravel()
    for axis in flat[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(flat, names, strict=False):
        mine = [row for row in rows if row["experiment"] == name]
        styles = {"exact": {"color": COLORS["leapfrog"], "lw": 1.6, "label": "closed form"}}
        styles["measured"] = {"color": COLORS["RK4"], "ls": "none", "marker": "o", "ms": 4, "label": "msdwarp"}
        for kind, style in styles.items():
            points = [(row["x"], row["y"]) for row in mine if row["kind"] == kind]
            axis.plot(*zip(*points, strict=True), **style)
        axis.set_title(name, loc="left")
        axis.set_xlabel(mine[0]["x_axis"])
        axis.set_ylabel(mine[0]["y_axis"])
    flat[len(names)].legend(*flat[0].get_legend_handles_labels(), loc="center", frameon=False, fontsize=12)
    save(figure, "validation.png")


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments("Do textbook experiments come out as their closed forms say?")
    paths = options.folder / "validation.csv", options.folder / "validation_curves.csv"
    if not options.plot_only:
        chosen = list(EXPERIMENTS)[: 3 if options.quick else None]
        found = {name: EXPERIMENTS[name](options.device) for name in chosen}
        for path, rows in zip(paths, (quantities, curves), strict=True):
            write_csv(path, [row for one in found.items() for row in rows(*one)], machine(options.device))
    _, rows = read_csv(paths[0])
    table(paths[0].name, list(rows[0]), [list(row.values()) for row in rows])
    if not options.quick:
        draw(read_csv(paths[1])[1])


if __name__ == "__main__":
    main()
