"""Draws the charts of contact.py from its CSV rows."""

from ..common import COLORS, MARKERS, pyplot, save


def _style(method: str) -> dict:
    return {"color": COLORS[method], "marker": MARKERS[method], "label": method}


def _methods(rows: list[dict]) -> list[str]:
    return [one for one in COLORS if any(row["method"] == one for row in rows)]


def _of(rows: list[dict], **wanted) -> list[dict]:
    """Return the rows that have these values, by their steps."""
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    return sorted(found, key=lambda row: row["step"])


def draw_work(rows: list[dict]) -> None:
    """Draw error against force evaluations, a panel for each case."""
    plt = pyplot()
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    size = (4.1 * len(scenes), 4.4)
    figure, axes = plt.subplots(
        1, len(scenes), figsize=size, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    handles = {}
    for axis, scene in zip(axes[0], scenes, strict=True):
        for method in _methods(rows):
            mine = _of(rows, scene=scene, method=method)
            if not mine:
                continue
            x, y = [row["evaluations"] for row in mine], [row["error"] for row in mine]
            handles[method] = axis.loglog(x, y, "-", **_style(method))[0]
            if mine[-1]["finer"] == 1:
                style = {"markersize": 13, "markeredgecolor": "black", "color": COLORS[method], "zorder": 5}
                axis.plot(x[-1], y[-1], "*", **style)
        axis.set_title(_of(rows, scene=scene)[0]["title"])
        axis.set_xlabel("force evaluations per simulated second")
    axes[0, 0].set_ylabel("relative position error")
    star = axes[0, 0].plot([], [], "*", markersize=13, color="#999999", markeredgecolor="black", linestyle="none")
    labels = [*handles, "automatic substeps"]
    figure.legend([*handles.values(), *star], labels, loc="outside lower center", ncols=len(labels))
    title = "With contact between bodies, what a force evaluation buys (float64)"
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    save(figure, "contact_work.png")


def draw_restitution(rows: list[dict]) -> None:
    """Draw restitution against the step, a panel for each method."""
    plt = pyplot()
    methods = _methods(rows)
    figure, axes = plt.subplots(
        1, len(methods), figsize=(3.8 * len(methods), 4.2), layout="constrained", sharey=True, squeeze=False
    )
    for axis, method in zip(axes[0], methods, strict=True):
        for asked in sorted({row["asked"] for row in rows}):
            mine = _of(rows, method=method, asked=asked)
            x = [1 / row["finer"] for row in mine]
            axis.axhline(asked, color="#999999", linewidth=0.9, linestyle="--", zorder=1)
            axis.fill_between(
                x, [row["least"] for row in mine], [row["most"] for row in mine], color=COLORS[method], alpha=0.25
            )
            axis.semilogx(x, [row["mean"] for row in mine], "-", **_style(method))
        axis.axvline(1, color="#555555", linewidth=0.9, linestyle=":")
        axis.text(1.06, 0.03, "automatic", transform=axis.get_xaxis_transform(), color="#555555", fontsize=9)
        ticks = [0.125, 0.25, 0.5, 1, 2, 4]
        axis.set_xticks(ticks, ["⅛", "¼", "½", "1", "2", "4"])
        axis.minorticks_off()
        axis.set_title(method)
        axis.set_xlabel("step, by the automatic one")
    axes[0, 0].set_ylabel("speed after a collision over that before")
    axes[0, 0].set_ylim(0, 1.2)
    found = "asked (dashed), found (line: mean, band: all moments of impact)"
    figure.suptitle(f"Restitution does not depend on the step: {found}", x=0.01, ha="left", fontsize=12)
    save(figure, "contact_restitution.png")


def draw_friction(rows: list[dict]) -> None:
    """Draw the creep on a gentle slope, and the acceleration on a steep one, against the step."""
    plt = pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.3), layout="constrained")
    for method in _methods(rows):
        hold, slide = (_of(rows, slope=slope, method=method) for slope in ("hold", "slide"))
        # What is less than a tenth of a nanometre a second is drawn there, on a scale of logarithms.
        left.loglog([1e6 * r["step"] for r in hold], [max(1e3 * r["creep"], 1e-7) for r in hold], **_style(method))
        right.semilogx([1e6 * r["step"] for r in slide], [r["acceleration"] for r in slide], **_style(method))
    left.axhline(0.1, color="#999999", linewidth=0.9, linestyle="--")
    left.text(
        0.02, 0.1, "0.1 mm/s", transform=left.get_yaxis_transform(), va="bottom", color="#555555", fontsize=9
    )
    left.set(title="15°, μ = 0.5: it should hold", ylabel="creep over the last half second [mm/s]")
    left.set_ylim(5e-8, 1)
    coulomb = next(row["coulomb"] for row in rows if row["slope"] == "slide")
    right.axhline(coulomb, color="#999999", linewidth=0.9, linestyle="--")
    right.axhspan(0.98 * coulomb, 1.02 * coulomb, color="#eeeeee", zorder=0)
    note = f"Coulomb: {coulomb:.2f} m/s², ± 2 %"
    right.text(
        0.02, coulomb, note, transform=right.get_yaxis_transform(), va="bottom", color="#555555", fontsize=9
    )
    right.set(title="35°, μ = 0.3: it should slide", ylabel="acceleration [m/s²]")
    right.set_ylim(0.9 * coulomb, 1.06 * coulomb)
    for axis in (left, right):
        axis.set_xlabel("step [µs]")
        axis.set_xticks([10, 20, 50, 100, 200], ["10", "20", "50", "100", "200"])
        axis.minorticks_off()
    handles = [line for line in right.get_lines() if line.get_label() in COLORS]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle("Friction against the step: a die on a pinned block", x=0.01, ha="left", fontsize=12)
    save(figure, "contact_friction.png")
