"""Every figure of the 2014 report again, simulated or drawn, and the numbers that docs/report.md quotes.

    python -m benchmarks.report.figures [--device D] [--quick] [--plot-only]

writes docs/images/report_*.png and results/<device>/report_figures.csv; the figures show runs, which are simulated
again each time: --plot-only leaves the CSV alone, and --quick writes to a temporary folder. What shows no run is
drawn in `drawings`; `memory` counts the bytes of table 1.
"""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator
from numpy.typing import NDArray
from PIL import Image
from scipy.linalg import expm

from msdwarp import RK4, Leapfrog, Plane, Renderer, Scene, Simulation, SymplecticEuler, System, sheet
from msdwarp.pictures import timelapse
from msdwarp.scenes import block2d, chain, mattress, soft_cube
from msdwarp.studies.accuracy import simulate

from ..common import COLORS, IMAGES, arguments, machine, pyplot, table, write_csv
from .drawings import drawings
from .memory import stored
from .panels import FULL_STRAIN, INK, PALE, STOPS, arrow, bare, draw_body, row, save, strain_scale, strains

FIVE = ("#0072b2", "#e69f00", "#009e73", "#c8352b", "#7b5ea7")
"""Colors of five masses; distinguishable to all eyes."""
SPEED, FRICTION, FACTOR = 3.0, 0.5, 0.9
"""Of the sliding mass: speed at the start [m/s], Coulomb's coefficient, and the share that a touch leaves it."""


# Figures 7 and 8 -------------------------------------------------------------------------------------------------


def floppy_modes(system: System) -> int:
    """Return how many ways of moving, besides the three of a rigid body in the plane, lengthen no connection."""
    i, j = system.connections.T
    axis = system.position[i] - system.position[j]
    row = np.zeros((system.connection_count, *system.position.shape))
    c = np.arange(system.connection_count)
    row[c, i], row[c, j] = axis, -axis
    return system.position.size - int(np.linalg.matrix_rank(row.reshape(len(c), -1))) - 3


def shearing(options: Any, folder: Path) -> list[dict]:
    """Draw what becomes of a sheet with four neighbours a particle, and with eight (figures 7 and 8)."""
    size, push, times = 6, 0.3, (0.0, 0.6, 1.1, 1.4, 2.0, 4.0)
    plt, rows = pyplot(), []
    figure, axes = plt.subplots(2, len(times), figsize=(11, 3.7), layout="constrained")
    for line, neighbours in zip(axes, (4, 8), strict=True):
        body = sheet((size, size), neighbors=neighbours, stiffness=2000.0, damping=5.0, dim=2)
        body = body.translate((0, 0.5 * size))
        velocity = np.zeros_like(body.position)
        low, high = body.position[:, 1].min(), body.position[:, 1].max()
        velocity[:, 0] = push * (body.position[:, 1] - low) / (high - low)
        scene = Scene(system=body.replace(velocity=velocity), colliders=[Plane(restitution=0.2, friction=0.8)])
        _, positions = simulate(scene, times[-1], device=options.device)
        strain = strains(body, positions)
        for axis, time in zip(line, times, strict=True):
            k = round(60 * time)
            bare(axis, -3.6, 5.2, 5.9)
            draw_body(axis, body, positions[k], strain[k])
            if neighbours == 4:
                axis.set_title(f"{time:g} s", loc="center", fontsize=11, fontweight="normal")
        line[0].set_ylabel(f"{neighbours} neighbours\n(report, figure {7 if neighbours == 4 else 8})", fontsize=10)
        number = f"figure {7 if neighbours == 4 else 8}"
        rows += [
            row(
                number,
                "ways to move without lengthening a connection, turns and shifts left out",
                floppy_modes(body),
            ),
            row(number, "height as built", high - low, "m"),
            row(number, "height after 4 s", positions[-1, :, 1].max(), "m"),
            row(number, "largest strain on the way", np.abs(strain).max()),
        ]
    strain_scale(figure, axes, shrink=0.72, aspect=16, pad=0.01)
    save(figure, "report_fig7_8.png", folder)
    return rows


# Figure 9 --------------------------------------------------------------------------------------------------------


def slide(rule: str, substeps: int, options: Any) -> float:
    """Return how far a mass slides on the floor that starts at SPEED [m]."""
    surfaces = {"coulomb": {"friction": FRICTION}, "report": {"tangential_factor": FACTOR}}
    floor = Plane(restitution=0.0, **surfaces[rule])
    mass = System(position=[[0.0, 0.0]], velocity=[[SPEED, 0.0]])
    simulation = Simulation(
        mass, colliders=[floor], collider_rule=rule, substeps=substeps, device=options.device, precision="float64"
    )
    simulation.step(120)
    return float(simulation.frame().position[0, 0])


def collider_rule(options: Any, folder: Path) -> list[dict]:
    """Draw a bounce, and how far a mass slides by the report's rule and by ours, against the step (figure 9)."""
    plt, rows = pyplot(), []
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10, 3.5), layout="constrained", gridspec_kw={"width_ratios": (1.25, 1)}
    )
    floor = Plane(restitution=0.6, friction=0.2)
    thrown = System(position=[[-2.5, 2.2]], velocity=[[3.8, 0.0]])
    simulation = Simulation(thrown, colliders=[floor], fps=240, device=options.device)
    frames = list(simulation.frames(1.45))
    way = np.array([frame.position[0] for frame in frames])
    bare(left, -2.8, 2.6, 2.85, below=0.2)
    left.plot(*way.T, color="#9cc4de", linewidth=1.4)
    left.plot(*way[::12].T, "o", color="#0072b2", markersize=4)
    hit = next(k for k in range(1, len(frames)) if frames[k].velocity[0, 1] > 0)
    for k, shade, name, aside in ((hit - 1, INK, "before", 0.12), (hit, "#c8352b", "after", -0.06)):
        velocity = 0.17 * frames[k].velocity[0]
        tail = way[hit] - velocity if k < hit else way[hit]
        arrow(left, tail, tail + velocity, shade, 2.0)
        place = {"ha": "right" if aside < 0 else "left", "va": "center", "color": shade}
        left.text(*(tail + (velocity if k >= hit else 0) + (aside, 0.12)), name, **place)
    left.set_title("A bounce: restitution 0.6, friction 0.2", pad=2)

    substeps = (1, 4) if options.quick else (1, 2, 4, 8, 16, 32, 64, 128)
    h = 1 / (60 * np.array(substeps))
    ways = {rule: [slide(rule, n, options) for n in substeps] for rule in ("report", "coulomb")}
    exact = SPEED**2 / (2 * FRICTION * 9.82)
    right.axhline(exact, color=INK, linewidth=1.2, linestyle="--")
    right.loglog(1e3 * h, ways["coulomb"], "o-", color="#0072b2", label=f"Coulomb's friction, μ = {FRICTION}")
    right.loglog(1e3 * h, ways["report"], "s-", color="#c8352b", label=f"report's rule, factor {FACTOR}")
    right.annotate("v²/2μg", (1e3 * h[-1], exact), (0, -13), textcoords="offset points", color=INK)
    right.set(xlabel="substep [ms]", ylabel="way until it rests [m]", ylim=(2e-3, 3))
    right.set_title(f"A mass that slides at {SPEED:g} m/s")
    right.xaxis.set_major_locator(FixedLocator([0.125, 0.25, 0.5, 1, 2, 4, 8, 16]))
    right.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    right.xaxis.set_minor_locator(NullLocator())
    right.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    right.legend(loc="lower right")
    save(figure, "report_fig9.png", folder)
    rows.append(row("figure 9", "way of the sliding mass, v²/2μg", exact, "m"))
    for rule, found in ways.items():
        for n, value in zip(substeps, found, strict=True):
            rows.append(row("figure 9", f"way of the sliding mass, rule {rule}, {n} substeps a frame", value, "m"))
    return rows


# Figure 12 -------------------------------------------------------------------------------------------------------


def exact_chain(system: System, fps: float, frames: int) -> NDArray:
    """Return the exact positions of a free chain in one dimension, shape [frame_count, particle_count].

    While no two masses change sides the force law is linear there: z' = A z with z = (x − x at rest, v), and
    z(t + h) = exp(A h) z(t).
    """
    n, k, b = system.particle_count, system.stiffness[0], system.damping[0]
    pairs = np.diff(np.eye(n), axis=0)
    coupling = pairs.T @ pairs / system.mass[0]
    x = system.position[:, 0]
    rest = x.mean() + system.rest_length[0] * (np.arange(n) - (n - 1) / 2)
    onwards = expm(np.block([[np.zeros((n, n)), np.eye(n)], [-k * coupling, -b * coupling]]) / fps)
    z, positions = np.concatenate([x - rest, np.zeros(n)]), []
    for _ in range(frames):
        positions.append(rest + z[:n])
        z = onwards @ z
    assert np.diff(positions, axis=1).min() > 0, "masses pass each other: the law is not linear"
    return np.array(positions)


def five_masses(options: Any, folder: Path) -> list[dict]:
    """Draw the five masses' positions against time, exact ones on top, and errors by method (figure 12)."""
    scene = chain.build()
    methods = [
        ("symplectic Euler", SymplecticEuler(), 20, "-."),
        ("symplectic Euler", SymplecticEuler(), 60, "-"),
        ("leapfrog", Leapfrog(), 60, "-"),
        ("leapfrog θ=½", Leapfrog(damper_extrapolation=0.5), 60, "-"),
        ("RK4", RK4(), 60, "-"),
    ]
    plt, rows = pyplot(), []
    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(9.4, 7.2), layout="constrained", gridspec_kw={"height_ratios": (1.75, 1)}, sharex=True
    )
    for name, method, fps, line in methods:
        options_of_run = {"integrator": method, "fps": fps, "substeps": 1, "precision": "float64"}
        _, positions = simulate(scene, scene.duration, device=options.device, **options_of_run)
        times, x = np.arange(len(positions)) / fps, positions[..., 0]
        exact = exact_chain(scene.system, fps, len(positions))
        error = np.abs(x - exact)
        step = f"h = 1/{fps} s"
        rows.append(row("figure 12", f"largest error, {name}, {step}", error.max(), "m"))
        lower.semilogy(times[1:], error.max(axis=1)[1:], line, color=COLORS[name], label=f"{name}, {step}")
        if (name, fps) == ("symplectic Euler", 60):
            for k, color in enumerate(FIVE):
                upper.plot(times, x[:, k], color=color, linewidth=2.4)
                label = {"textcoords": "offset points", "color": color, "va": "center", "fontweight": "bold"}
                upper.annotate(f"{x[-1, k]:.2f}", (times[-1], x[-1, k]), (6, 0), **label)
                rows.append(row("figure 12", f"mass {k + 1} after 12.5 s", x[-1, k], "m"))
                rows.append(row("figure 12", f"mass {k + 1} after 12.5 s, exact", exact[-1, k], "m"))
            upper.plot(times, exact, color="black", linewidth=1.0, linestyle=(0, (4, 3)))
            rows.append(row("figure 12", "least distance of two masses, exact", np.diff(exact, axis=1).min(), "m"))
    slowest = 4 * scene.system.stiffness[0] / scene.system.mass[0] * math.sin(math.pi / 10) ** 2
    decay = slowest * scene.system.damping[0] / scene.system.stiffness[0] / 2
    rows.append(row("figure 12", "period of the slowest mode", 2 * math.pi / math.sqrt(slowest - decay**2), "s"))
    rows.append(row("figure 12", "time in which it falls to 1/e", 1 / decay, "s"))
    settled = simulate(scene, 60.0, device=options.device, substeps=1, precision="float64")[1][-1, :, 0]
    rows += [row("figure 12", f"mass {k + 1} after 60 s", x, "m") for k, x in enumerate(settled)]
    ours = plt.Line2D([], [], color=PALE, linewidth=2.4, label="msdwarp, symplectic Euler, h = 1/60 s")
    dashed = plt.Line2D([], [], color="black", linewidth=1.0, linestyle=(0, (4, 3)), label="exact")
    upper.legend(handles=[ours, dashed], loc="lower right", bbox_to_anchor=(1, 0.0), ncols=2)
    upper.set(ylabel="position [m]", xlim=(0, 12.5), ylim=(-1.35, 5.7), yticks=range(-1, 6))
    printed = upper.secondary_xaxis("top", functions=(lambda t: 2 * t, lambda t: t / 2))
    printed.set_xlabel("the axis as printed in the report, stretched by two", color="#777777")
    printed.tick_params(colors="#777777")
    printed.spines["top"].set_color("#bbbbbb")
    lower.set(xlabel="time [s]", ylabel="largest error [m]", ylim=(1e-8, 1))
    figure.legend(*lower.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    save(figure, "report_fig12.png", folder)
    return rows


# Figure 13 -------------------------------------------------------------------------------------------------------


def block(options: Any, folder: Path) -> list[dict]:
    """Draw the block of 4 × 4 masses, dropped from 15 m and spinning, that hits on a corner (figure 13)."""
    fps = 240
    scene = block2d.build(height=15.0, spin=1.05)
    simulation, positions = simulate(scene, 8.0, device=options.device, precision="float64", fps=fps)
    system, strain = scene.system, strains(scene.system, positions)
    largest = np.abs(strain).max(axis=1)
    hit = int(np.argmax(positions[..., 1].min(axis=1) <= 1e-9))
    worst = int(largest.argmax())
    moments = [hit + round(fps * t) for t in (0.0, 0.06, 0.1, 0.16, 0.25, 0.36)]

    plt = pyplot()
    figure = plt.figure(figsize=(11, 7.0), layout="constrained")
    grid = figure.add_gridspec(3, 4, width_ratios=(0.92, 1, 1, 1), height_ratios=(1, 1, 0.62))
    fall = figure.add_subplot(grid[:, 0])
    bare(fall, -2.7, 3.9, 17.4, below=0.6)
    for time in (0.0, 0.95, 1.3, hit / fps):
        k = round(fps * time)
        draw_body(fall, system, positions[k], strain[k], 1.2)
        middle = positions[k].mean(axis=0)
        fall.annotate(f"{k / fps:.2f} s", (2.4, middle[1] + 0.9), color=INK, fontsize=9, va="center")
    fall.set_title("the fall", fontsize=11, loc="center", fontweight="normal")
    panels = [figure.add_subplot(grid[r, 1 + c]) for r in range(2) for c in range(3)]
    for axis, k in zip(panels, moments, strict=True):
        middle = positions[k, :, 0].mean()
        bare(axis, middle - 3.4, middle + 3.4, 5.6)
        draw_body(axis, system, positions[k], strain[k], 2.2)
        title = f"{k / fps:.2f} s, largest strain {largest[k]:.2f}"
        axis.set_title(title, fontsize=10, loc="center", fontweight="normal")
    strain_scale(figure, panels, shrink=0.8, aspect=20, pad=0.01)
    curve, times = figure.add_subplot(grid[2, 1:]), np.arange(len(largest)) / fps
    curve.axhline(FULL_STRAIN, color=tuple(STOPS[2]), linewidth=1, linestyle="--")
    curve.plot(times, largest, color=INK, linewidth=1.3)
    curve.plot(times[moments], largest[moments], "o", color="#0072b2", markersize=5)
    curve.set(xlabel="time [s]", ylabel="largest strain", xlim=(0, times[-1]), ylim=(0, None))
    save(figure, "report_fig13.png", folder)
    height = positions[..., 1].mean(axis=1)
    return [
        row("figure 13", "first touch", hit / fps, "s"),
        row(
            "figure 13",
            "its centre's speed downwards just before",
            fps * (height[hit - 2] - height[hit - 1]),
            "m/s",
        ),
        row("figure 13", "largest strain", largest[worst]),
        row("figure 13", "largest strain at", worst / fps, "s"),
        row("figure 13", "highest point of its centre after the first bounce", height[worst:].max(), "m"),
        row("figure 13", "largest strain of the second bounce", largest[3 * fps :].max()),
        row("figure 13", "substeps a second", fps * simulation.substeps),
    ]


# Figure 14 -------------------------------------------------------------------------------------------------------


def pictures(options: Any, folder: Path) -> list[dict]:
    """Draw the scenes mattress and soft_cube, several poses in one picture each (figure 14)."""
    rows, size = [], ((320, 180) if options.quick else (960, 540))
    shown = {"mattress": (mattress, (0.0, 0.3, 4.5)), "soft_cube": (soft_cube, (0.0, 0.1, 0.26, 0.8))}
    for name, (script, times) in shown.items():
        scene = script.build()
        _, positions = simulate(scene, scene.duration, device=options.device)
        chosen = positions[[round(60 * time) for time in times]].astype(np.float32)
        image = timelapse(Renderer(scene, chosen, resolution=size), chosen, times)
        path = folder / f"report_fig14_{name}.png"
        Image.fromarray(image).quantize(256).save(path, optimize=True)
        print("wrote", path.name, f"({path.stat().st_size / 1e3:.0f} kB)")
        system = scene.system
        k, b, m = float(system.stiffness[0]), float(system.damping[0]), float(system.mass[0])
        rows += [
            row("figure 14", f"{name}: particles", system.particle_count),
            row("figure 14", f"{name}: connections", system.connection_count),
            row("figure 14", f"{name}: stiffness", k, "N/m"),
            row("figure 14", f"{name}: damping / stiffness", b / k, "s"),
            row("figure 14", f"{name}: damping / √(stiffness · mass)", b / math.sqrt(k * m)),
        ]
    return rows


def main() -> None:
    """Simulate, draw, and write the numbers."""
    options = arguments(__doc__.splitlines()[0])
    folder = options.folder if options.quick else IMAGES
    rows = drawings(folder)
    for make in (shearing, collider_rule, five_masses, block, pictures):
        rows += make(options, folder)
    rows += stored(options)
    table("The report's figures", list(rows[0]), [list(one.values()) for one in rows])
    if not options.plot_only:
        write_csv(options.folder / "report_figures.csv", rows, machine(options.device))


if __name__ == "__main__":
    sys.exit(main())
