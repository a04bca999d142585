"""Every figure of the 2014 report again, simulated or drawn, and the numbers that docs/report.md quotes.

    python -m benchmarks.report.figures [--device D] [--quick] [--plot-only]

writes docs/images/report_*.png and results/<device>/report_figures.csv; the figures show runs, which are simulated
again each time: --plot-only leaves the CSV alone, and --quick writes to a temporary folder.
"""

import itertools
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator
from numpy.typing import NDArray
from PIL import Image
from scipy.linalg import expm

from msdwarp import (
    RK4,
    Leapfrog,
    Plane,
    Renderer,
    Scene,
    Simulation,
    SymplecticEuler,
    System,
    box,
    sheet,
)
from msdwarp.pictures import timelapse
from msdwarp.pictures.legend import STOPS
from msdwarp.scenes import block2d, chain, mattress, soft_cube
from msdwarp.shapes.grid import lattice_directions
from msdwarp.studies.accuracy import simulate

from ..common import COLOURS, IMAGES, arguments, machine, pyplot, table, write_csv

INK, PALE, GROUND = "#333a40", "#9aa3ab", "#dfe4e8"
FIVE = ("#0072b2", "#e69f00", "#009e73", "#c8352b", "#7b5ea7")
"""Colours of five masses; distinguishable to all eyes."""
STRAIN = LinearSegmentedColormap.from_list("strain", [tuple(stop) for stop in STOPS])
FULL_STRAIN = 0.2
"""Strain from which a connection is red: the report's."""
SPEED, FRICTION, FACTOR = 3.0, 0.5, 0.9
"""Of the sliding mass: speed at the start [m/s], Coulomb's coefficient, and the share that a touch leaves it."""


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
    """Draw connections in the colours of their strain, the most strained on top, and particles."""
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
    """Add the scale of strain colours."""
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(Normalize(0, FULL_STRAIN), STRAIN), ax=axes, ticks=(0, 0.1, 0.2), **place)
    bar.ax.set_yticklabels(["0", "0.1", "0.2\nor more"])
    bar.set_label("|length / rest length − 1|")
    bar.outline.set_visible(False)


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
        body = sheet((size, size), neighbours=neighbours, stiffness=2000.0, damping=5.0, dim=2)
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
        mass, colliders=[floor], contact=rule, substeps=substeps, device=options.device, precision="float64"
    )
    simulation.step(120)
    return float(simulation.frame().position[0, 0])


def contact(options: Any, folder: Path) -> list[dict]:
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
        _arrow(left, tail, tail + velocity, shade, 2.0)
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
        lower.semilogy(times[1:], error.max(axis=1)[1:], line, color=COLOURS[name], label=f"{name}, {step}")
        if (name, fps) == ("symplectic Euler", 60):
            for k, colour in enumerate(FIVE):
                upper.plot(times, x[:, k], color=colour, linewidth=2.4)
                label = {"textcoords": "offset points", "color": colour, "va": "center", "fontweight": "bold"}
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


# Table 1 ---------------------------------------------------------------------------------------------------------


def stored(options: Any) -> list[dict]:
    """Count the bytes that the mattress of 20 × 7 × 2 takes on the device, by route, in float32 (table 1)."""
    rows, body = [], box((20, 7, 2), stiffness=5000.0, damping=20.0)
    n, m = body.particle_count, body.connection_count
    for route in ("scatter", "gather", "stencil"):
        simulation = Simulation(body, route=route, device=options.device)
        model, forces = simulation.model, simulation._dynamics.world.forces
        instants = (simulation.state.here, simulation.state.there)
        of_forces = {
            name: getattr(forces, name) for name in ("f", "mask", "first", "other") if hasattr(forces, name)
        }
        constants = getattr(forces, "constants", None)
        kind = getattr(constants, "kind", None)
        moving = sum(array._ref.capacity for instant in instants for array in (instant.x, instant.v))
        moving -= 4 * 2 * model.margin * 16  # what a stencil may read beyond either end
        force = of_forces["f"]._ref.capacity if "f" in of_forces else 0
        mask = of_forces["mask"].capacity if "mask" in of_forces else 0
        pairs = {
            "scatter": model.connections.capacity,
            "gather": sum(of_forces[name].capacity for name in ("first", "other") if name in of_forces),
            "stencil": 0,
        }[route]
        backup = sum(array._ref.capacity for array in simulation._backup._kept) - 4 * model.margin * 16
        found = {
            "position and velocity, twice, per particle": moving / n,
            "force, per particle": force / n,
            "bits of neighbours, per particle": mask / n,
            "1 / mass, in all": model.inverse_mass._ref.capacity,
            "who is joined, per connection": pairs / m,
            "which constants, per connection": (kind.capacity if kind is not None else 0) / m,
            "stiffness, in all": model.stiffness._ref.capacity,
            "damping, in all": model.damping._ref.capacity,
            "kept beside a substep, per connection": (
                model.rest_length.capacity + (0 if route == "scatter" else model.connections.capacity)
            )
            / m,
            "kept beside a substep, per particle": backup / n,
            "arrays of a substep, in all": moving
            + force
            + mask
            + pairs
            + (kind.capacity if kind is not None else 0),
        }
        rows += [row("table 1", f"{route}: {name}", value, "bytes") for name, value in found.items()]
    rows.append(row("table 1", "report: per particle", 4 * 13, "bytes"))
    rows.append(row("table 1", "report: per connection", 4 * 5, "bytes"))
    rows.append(row("table 1", "report: in all", 4 * 13 * n + 4 * 5 * m, "bytes"))
    rows.append(row("table 1", "mattress: particles", n))
    rows.append(row("table 1", "mattress: connections", m))
    return rows


# Drawings --------------------------------------------------------------------------------------------------------


def _view(axis: Any, middle: tuple[float, float], height: float) -> None:
    """Show what is around a point, all panels in the same proportions."""
    x, y, width = *middle, 1.65 * height
    axis.set(xlim=(x - width / 2, x + width / 2), ylim=(y - height / 2, y + height / 2), aspect="equal")


def _ball(axis: Any, place: Any, text: str = "", radius: float = 0.13, colour: str = "#0072b2") -> None:
    axis.add_patch(Circle(place, radius, facecolor=colour, edgecolor="white", linewidth=1.2, zorder=4))
    axis.text(*place, text, color="white", ha="center", va="center", zorder=5, fontsize=10, style="italic")


def _arrow(axis: Any, start: Any, end: Any, colour: str, width: float = 1.8, **style: Any) -> None:
    shape = {"arrowstyle": "-|>", "mutation_scale": 7 + 3 * width, "shrinkA": 0, "shrinkB": 0}
    axis.add_patch(FancyArrowPatch(start, end, color=colour, linewidth=width, zorder=3, **(shape | style)))


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
    _arrow(axis, (3, 0), (3.95, 0.95), INK)
    axis.plot((3.95, 3.95), (0.95, 0), color=PALE, linewidth=1, linestyle=":")
    axis.plot((3.0, 4.1), (0, 0), color=PALE, linewidth=1, linestyle=":")
    axis.text(3.98, 1.0, "$\\Delta v$", color=INK)
    axis.text(4.02, 0.05, "$\\Delta v\\cdot\\Delta\\hat{x}$", color=INK, va="bottom")
    _arrow(axis, (0, -1.18), (3, -1.18), INK, 1.2)
    axis.text(1.5, -1.22, "$\\Delta x = x_i - x_j$", ha="center", va="top", color=INK)
    _arrow(axis, (3, 0.0), (2.15, 0.0), "#c8352b", 2.2)
    axis.text(2.12, 0.02, "$F_i$", color="#c8352b", ha="right", va="center")
    axis.set_title("The force of a connection (report, figures 1 to 4)")


def _rules(axis: Any) -> None:
    """Draw four neighbours, and eight (figure 6)."""
    _view(axis, (1.85, -0.2), 3.8)
    for middle, diagonals in ((0.0, False), (3.7, True)):
        for x, y in itertools.product((-1, 0, 1), repeat=2):
            if (x or y) and (diagonals or not x * y):
                colour = "#e69f00" if x * y else "#0072b2"
                axis.plot((middle, middle + x), (0, y), color=colour, linewidth=2)
            _ball(axis, (middle + x, y), colour="#0072b2" if (x, y) == (0, 0) else "#8a949c")
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
    colours = {1: "#0072b2", 2: "#e69f00", 3: "#c8352b"}
    for step in lattice_directions(3, diagonals=True).values():
        n = sum(map(abs, step))
        _arrow(axis, flat((0, 0, 0)), 0.93 * flat(step), colours[n], 2.0 if n == 1 else 1.6)
        axis.plot(*np.array([flat((0, 0, 0)), -flat(step)]).T, color=colours[n], linewidth=0.9, alpha=0.35)
    for corner in sorted(corners, key=lambda c: -c[1]):
        _ball(axis, flat(corner), radius=0.06, colour=INK if corner == (0, 0, 0) else "#8a949c")
    names = {1: "3 axes, length 1", 2: "6 face diagonals, √2", 3: "4 space diagonals, √3"}
    for k, (n, name) in enumerate(names.items()):
        axis.text(1.75, 0.55 - 0.36 * k, name, color=colours[n], va="center", fontsize=9.5)
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
                    _arrow(axis, source, at[end] - 0.2 * unit, "#c8352b", 1.3)
                else:
                    source = at[start] + (1 - share) * along
                    _arrow(axis, source, at[end] - 0.2 * unit, "#009e73", 1.3)
                    axis.plot(*source, "o", color="#009e73", markersize=5.5, zorder=4)
        for k, place in enumerate(at):
            _ball(axis, place, str(k + 1), 0.17)
        axis.text(shift + 0.9, -0.34, label, ha="center", va="top", fontsize=9.5, color=INK)
    axis.set_title("Two routes to the same sum (figure 10)")


def drawings(folder: Path) -> list[dict]:
    """Draw the force law, the connection rules and the routes in one picture; return what is counted of them."""
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


def row(figure: str, quantity: str, value: float, unit: str = "") -> dict:
    """Return a row of the CSV."""
    return {"figure": figure, "quantity": quantity, "value": float(value), "unit": unit}


def main() -> None:
    """Simulate, draw, and write the numbers."""
    options = arguments(__doc__.splitlines()[0])
    folder = options.folder if options.quick else IMAGES
    rows = drawings(folder)
    for make in (shearing, contact, five_masses, block, pictures):
        rows += make(options, folder)
    rows += stored(options)
    table("The report's figures", list(rows[0]), [list(one.values()) for one in rows])
    if not options.plot_only:
        write_csv(options.folder / "report_figures.csv", rows, machine(options.device))


if __name__ == "__main__":
    sys.exit(main())
