"""Draws the charts of contact_mechanics.py from its CSV rows."""

from ..common import pyplot, save

SHADES = {0.05: ("#c8352b", "o"), 0.3: ("#e69f00", "^"), 1.0: ("#0072b2", "s")}
"""Color and marker of each restitution."""
GROUNDS = {"plane": ("#e69f00", "^"), "plane, surface": ("#009e73", "v"), "pinned slab": ("#0072b2", "o")}
BOLLARDS = {"capsule": ("#e69f00", "^"), "capsule, surface": ("#009e73", "v"), "pinned cylinder": ("#0072b2", "o")}
SOFTER = {1.0: ("#0072b2", "s"), 10.0: ("#e69f00", "^"), 100.0: ("#c8352b", "o")}
"""Color and marker for springs that are so many times as stiff as the contact."""
GREY = {"color": "#555555", "fontsize": 9}


def _of(rows: list[dict], by: str, **wanted) -> list[dict]:
    """Return the rows of leapfrog that have these values, ordered by a column."""
    wanted = {"method": "leapfrog"} | wanted if "method" in rows[0] else wanted
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    return sorted(found, key=lambda row: row[by])


def _excess(axis, rows: list[dict], x: str, unit: float = 1.0, **wanted) -> None:
    """Draw friction found less friction asked for, against a column, a line for each restitution."""
    for restitution, (color, marker) in SHADES.items():
        mine = _of(rows, x, restitution=restitution, **wanted)
        axis.plot(
            [unit * row[x] for row in mine], [row["error"] for row in mine], color=color, marker=marker, zorder=3
        )
    axis.axhline(0, color="#999999", linewidth=0.9, linestyle="--")


def draw_sliding(rows: list[dict]) -> None:
    """Draw the friction that acts against that asked for, and its excess against spacing and speed."""
    plt = pyplot()
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12.6, 4.4), layout="constrained")
    top = 0.9
    left.plot([0, top], [0, top], color="#999999", linewidth=0.9, linestyle="--")
    left.text(0.6, 0.53, "dashed: as asked", rotation=44, rotation_mode="anchor", **GREY)
    handles = []
    for restitution, (color, marker) in SHADES.items():
        mine = _of(rows, "friction", restitution=restitution, angle=45, spacing=0.05, speed=0)
        x, y = [row["friction"] for row in mine], [row["effective"] for row in mine]
        handles += left.plot(x, y, color=color, marker=marker, label=f"restitution {restitution:g}")
    left.set(title="45°, slab of 50 mm", xlabel="friction asked for", ylabel="friction that acts", aspect="equal")
    left.set(xlim=(-0.02, top), ylim=(-0.02, top))
    _excess(middle, rows, "spacing", 1e3, angle=45, friction=0.4, speed=0)
    middle.set_xscale("log")
    middle.set_xticks([25, 50, 100, 200], ["25", "50", "100", "200"])
    middle.minorticks_off()
    middle.set(
        title="45°, μ = 0.4", xlabel="spacing of the slab [mm]; the die's is 100", ylabel="friction too much"
    )
    _excess(right, rows, "mean_speed", angle=0, friction=0.3, spacing=0.05)
    right.set(title="level, μ = 0.3, slab of 50 mm", xlabel="mean speed [m/s]", ylabel="friction too much")
    right.set_xlim(left=0)
    for axis in (middle, right):
        low, high = axis.get_ylim()
        axis.set_ylim(min(low, -0.01), max(high, 0.01))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.suptitle("A flat die slides on a pinned slab: is friction as asked?", x=0.01, ha="left", fontsize=12)
    save(figure, "contact_sliding.png")


def draw_bounce(rows: list[dict]) -> None:
    """Draw the speed after a bounce over that before, against the restitution asked for."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.6), layout="constrained", sharey=True)
    handles = []
    for axis, pose in zip(axes, ("flat", "edge", "corner"), strict=True):
        axis.plot([0, 1], [0, 1], color="#999999", linewidth=0.9, linestyle="--")
        for softer, (color, marker) in SOFTER.items():
            for damping, style in ((0.0, "-"), (8.0, ":")):
                mine = _of(rows, "restitution", pose=pose, softer=softer, damping=damping)
                x, y = [row["restitution"] for row in mine], [row["with_rotation"] for row in mine]
                label = f"springs {softer:g} times as stiff as the contact" + (", damped" if damping else "")
                drawn = axis.plot(x, y, color=color, marker=marker, linestyle=style, label=label)
                handles += drawn if pose == "flat" else []
        axis.set(title=f"lands {'flat' if pose == 'flat' else f'on its {pose}'}", xlabel="restitution asked for")
        axis.set(aspect="equal", xlim=(0, 1.03), ylim=(0, 1.03))
    axes[0].set_ylabel("speed after over speed before")
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.suptitle("A block bounces on a pinned one: how fast does it come back?", x=0.01, ha="left", fontsize=12)
    save(figure, "contact_bounce.png")


def draw_round(rolling: list[dict], capstan: list[dict], hertz: list[dict]) -> None:
    """Draw accelerations of rolling balls, friction of a rope, and forces on pressed balls, beside theory."""
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.6), layout="constrained")
    _rolling(axes[0], rolling)
    _capstan(axes[1], capstan)
    _hertz(axes[2], hertz)
    figure.suptitle("Contact beside textbook mechanics", x=0.01, ha="left", fontsize=12)
    save(figure, "contact_mechanics.png")


def _rolling(axis, rows: list[dict]) -> None:
    for k, (ground, (color, marker)) in enumerate(GROUNDS.items()):
        mine = _of(rows, "restitution", ground=ground)
        for place, row in enumerate(mine):
            x = place + 0.16 * (k - 1)
            axis.plot(
                x, row["ratio"], marker, color=color, markersize=8, label=ground if place == 0 else None, zorder=3
            )
            axis.plot([x, x], [1, row["ratio"]], color=color, linewidth=1.4, zorder=2)
        axis.set_xticks(range(len(mine)), [f"{row['restitution']:g}" for row in mine])
    axis.axhline(1, color="#999999", linewidth=0.9, linestyle="--")
    low, high = axis.get_ylim()
    axis.set_ylim(min(0.0, low), max(1.2, high))
    axis.margins(x=0.12)
    axis.set(
        title="A ball rolls down 20°", xlabel="restitution", ylabel="acceleration over g sin α / (1 + I/(m r²))"
    )
    axis.legend(fontsize=9, loc="best")


def _capstan(axis, rows: list[dict]) -> None:
    for k, (bollard, (color, marker)) in enumerate(BOLLARDS.items()):
        mine = _of(rows, "friction", bollard=bollard)
        style = {"color": color, "marker": marker, "linestyle": "none", "markersize": 8, "zorder": 3}
        x = [place + 0.16 * (k - 1) for place in range(len(mine))]
        for name, label, filled in (("effective", bollard, True), ("effective_start", None, False)):
            y = [row[name] - row["friction"] for row in mine]
            axis.plot(x, y, label=label, **style, **({} if filled else {"markerfacecolor": "none"}))
        axis.set_xticks(range(len(mine)), [f"{row['friction']:g}" for row in mine])
    axis.plot([], [], "o", color="#555555", markerfacecolor="none", markersize=8, label="hollow: as it starts")
    axis.axhline(0, color="#999999", linewidth=0.9, linestyle="--")
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, -0.02), max(high, 0.05))
    axis.margins(x=0.12)
    axis.set(title="A rope slides half around a bollard", xlabel="friction μ asked for")
    axis.set_ylabel("ln(ratio of tensions)/π − μ")
    axis.legend(fontsize=9, loc="best")


def _hertz(axis, rows: list[dict]) -> None:
    finest = max(row["cells"] for row in rows)
    for ground, (color, marker) in GROUNDS.items():
        for cells in sorted({row["cells"] for row in rows}):
            mine = _of(rows, "approach", ground=ground, cells=cells)
            # Where both planes give the same, the marker of the first is seen behind that of the second.
            style = {"color": color, "marker": marker, "markersize": 9 if ground == "plane" else 6}
            if cells < finest:
                style |= {"linestyle": ":", "markerfacecolor": "none"}
            x, y = [1e3 * row["approach"] for row in mine], [row["ratio"] for row in mine]
            axis.loglog(x, y, label=ground if cells == finest else None, **style)
            axis.set_xticks(x, [f"{one:g}" for one in x])
    fewest = min(row["cells"] for row in rows)
    name = f"hollow: {fewest:g} cells across, not {finest:g}"
    axis.plot([], [], "o:", color="#555555", markerfacecolor="none", markersize=6, label=name)
    axis.axhline(1, color="#999999", linewidth=0.9, linestyle="--")
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, 0.8), max(3 * high, 1.5))  # room for the legend
    axis.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axis.minorticks_off()
    axis.set(title="A ball of radius 0.2 m is pressed", xlabel="approach of its centre [mm]")
    axis.set_ylabel("force over 4/3 E* √R d$^{1.5}$")
    axis.legend(fontsize=9, loc="upper right")
