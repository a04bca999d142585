"""Draws the charts of work_precision.py from its CSV rows."""

from collections.abc import Sequence

from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..common import COLORS, MARKERS, pyplot, save

LINES = {"float64": "-", "float32": ":", "float32-compensated": "--"}
FOUND = {"xlabel": "force evaluations", "ylabel": "relative position error"}


def _stars(axis, automatic: Sequence[dict], rows: list[dict], scene: str) -> None:
    """Draw what automatic substeps cost and reach, of the methods that a scene has a curve of."""
    drawn = {row["method"] for row in rows if row["scene"] == scene}
    for row in automatic:
        if row["scene"] == scene and row["method"] in drawn:
            style = {"markersize": 13, "markeredgecolor": "black", "color": COLORS[row["method"]], "zorder": 5}
            axis.plot(row["evaluations"], row["error"], "*", **style)


def _curves(axis, rows: list[dict], x: str, scene: str, *, precisions=("float64",), methods=COLORS) -> None:
    for method in methods:
        for precision in precisions:
            mine = [r for r in rows if (r["scene"], r["method"], r["precision"]) == (scene, method, precision)]
            mine.sort(key=lambda r: r[x])
            if not mine:
                continue
            xs, ys = [r[x] for r in mine], [r["error"] for r in mine]
            style = {"color": COLORS[method], "marker": MARKERS[method], "markevery": 1}
            axis.loglog(xs, ys, LINES[precision], label=method, markeredgewidth=1.2, **style)
            if precision == "float64" and mine[0]["share_of_limit"] > 0.9:  # where stability ends
                axis.plot(xs[0], ys[0], "o", markersize=11, fillstyle="none", color=COLORS[method])

    if x == "evaluations":
        wide = axis.get_xlim()[1] > 60 * axis.get_xlim()[0]
        axis.xaxis.set_major_locator(LogLocator(subs=(1,) if wide else (1, 2, 5)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda n, _: f"{n:,.0f}".replace(",", "\u202f")))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.yaxis.set_major_locator(LogLocator(numticks=8))


def _legend(figure, axes, columns: int = 8) -> None:
    handles = {}
    for axis in axes:
        for line in axis.get_lines():
            if line.get_label() in COLORS:
                handles.setdefault(line.get_label(), line)
    ring = axes[0].plot([], [], "o", markersize=11, fillstyle="none", color="#555555")[0]
    lines = [*(handles[m] for m in COLORS if m in handles), ring]
    labels = [*(m for m in COLORS if m in handles), "longest stable step"]
    if any(line.get_marker() == "*" for line in axes[0].get_lines()):
        lines += axes[0].plot([], [], "*", markersize=13, color="#999999", markeredgecolor="black")
        labels.append("automatic substeps")
    figure.legend(lines, labels, loc="outside lower center", ncols=min(columns, len(labels)))


def _grid(
    rows: list[dict],
    scenes: list[str],
    x: str,
    xlabel: str,
    title: str,
    name: str,
    columns: int = 3,
    automatic: Sequence[dict] = (),
) -> None:
    plt = pyplot()
    height = -(-len(scenes) // columns)
    figure, axes = plt.subplots(
        height, columns, figsize=(3.9 * columns, 3.4 * height + 0.6), layout="constrained", squeeze=False
    )
    used = axes.ravel()[: len(scenes)]
    for axis in axes.ravel()[len(scenes) :]:
        axis.set_visible(False)
    for axis, scene in zip(used, scenes, strict=True):
        _curves(axis, rows, x, scene)
        _stars(axis, automatic, rows, scene)
        first = next(r for r in rows if r["scene"] == scene)
        axis.set_title(f"{first['title']} · {first['duration']:g} s")
    for axis in axes[:, 0]:
        axis.set_ylabel(FOUND["ylabel"])
    for axis in axes[-1]:
        axis.set_xlabel(xlabel)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    _legend(figure, used, 4 if columns == 2 else 8)
    save(figure, name)


def _float32(rows: list[dict]) -> None:
    plt = pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.4), sharey=True, layout="constrained")
    for axis, scene in zip(axes, ("worm", "mattress"), strict=True):
        _curves(axis, rows, "evaluations", scene, precisions=tuple(LINES), methods=("leapfrog", "RK4"))
        first = next((r for r in rows if r["scene"] == scene), None)
        axis.set_title(first["title"] if first else scene)
        axis.set_xlabel(FOUND["xlabel"])
    axes[0].set_ylabel(FOUND["ylabel"])
    handles = [plt.Line2D([], [], color="#555555", linestyle=s, label=p) for p, s in LINES.items()]
    handles += [
        plt.Line2D([], [], color=COLORS[m], marker=MARKERS[m], label=m, linestyle="none")
        for m in ("leapfrog", "RK4")
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5)
    figure.suptitle(
        "Plain float32, far from the origin: shorter steps make it worse", x=0.01, ha="left", fontsize=12
    )
    save(figure, "work_precision_float32.png")


def _readme(rows: list[dict]) -> None:
    plt = pyplot()
    figure, axis = plt.subplots(figsize=(7.6, 4.6), layout="constrained")
    scene = "mattress"
    methods = [m for m in COLORS if not m.startswith("RKC2")]
    _curves(axis, rows, "evaluations", scene, methods=methods)
    for line in axis.get_lines():
        if line.get_label() in methods:
            x, y = line.get_xdata()[-1], line.get_ydata()[-1]
            axis.text(1.08 * x, y, line.get_label(), color=line.get_color(), va="center", fontweight="bold")
    axis.set_xlim(right=2.4 * axis.get_xlim()[1])
    first = next(r for r in rows if r["scene"] == scene)
    axis.set(xlabel=f"force evaluations for {first['duration']:g} s of simulated time", ylabel=FOUND["ylabel"])
    axis.set_title("Twenty by seven by two particles, thrown with spin, before contact\n", fontsize=11)
    note = "rings: the longest stable step of each method; float64, against a reference by SciPy's DOP853"
    axis.text(0, 1.02, note, transform=axis.transAxes, color="#555555", fontsize=9)
    save(figure, "work_precision_readme.png")


def draw_time(rows: list[dict], machine: str, name: str) -> None:
    """Draw the one chart that depends on the machine."""
    free = [s for s in dict.fromkeys(r["scene"] for r in rows) if not s.endswith("_contact")]
    title = f"What computing time buys, before any contact ({machine.split(';')[0]}, float64)"
    seconds = "computing time per simulated second [s]"
    _grid(rows, free, "seconds_per_second", seconds, title, f"work_precision_time_{name}.png")


def draw(rows: list[dict], automatic: list[dict]) -> None:
    """Draw every chart of error against evaluations for which there are rows; automatic substeps as stars."""
    scenes = list(dict.fromkeys(r["scene"] for r in rows))
    free = [s for s in scenes if not s.endswith("_contact")]
    contact = [s for s in scenes if s.endswith("_contact")]
    _grid(
        rows,
        free,
        "evaluations",
        FOUND["xlabel"],
        "What a force evaluation buys, before any contact (float64)",
        "work_precision.png",
        automatic=automatic,
    )
    if contact:
        title = "With contact every method is of first order at best (float64)"
        _grid(rows, contact, "evaluations", FOUND["xlabel"], title, "work_precision_contact.png", 2, automatic)
    _float32(rows)
    _readme(rows)
