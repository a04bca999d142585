"""History: energies, momentum and heights of a trajectory over time, computed from its file alone, and plots.

Further functions return the system in a frame, and the energies of particles.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies import AXES, LINEAR_SPRING, System, broken_before, counted
from ..engine import Assembly, Measures, Model, State, assemble, measure
from ..files import Trajectory
from ..world import Change, Problem
from .plots import BLUE, DARK, GREEN, RED, draw_curves, draw_energies, new_figure, output_path, save_figure
from .table import COLUMNS, GrowingTable


class Moment(NamedTuple):
    """Energies, momentum and heights of the body in one frame."""

    time: float
    """Simulated time [s]."""
    measures: Measures
    """Energies, momentum and strain."""
    lowest: float
    """Height of the lowest particle, its last coordinate [m]."""
    mean: float
    """Height of the centre of mass of the free particles [m]; of all particles if all are pinned."""
    highest: float
    """Height of the highest particle [m]."""


def history(trajectory: Trajectory, *, gravity: ArrayLike, schedule: Sequence[Change] = ()) -> Iterator[Moment]:
    """Return an iterator over a trajectory's moments; one frame is in memory at a time.

    Moments are computed on the CPU in float64 from stored frames, the run's gravity [m/s²] and schedule. Raises
    ValueError if gravity is out of range, or rest lengths change but strains are not in the file.
    """
    # Checked here, not at the first next().
    Model(trajectory.system, gravity=gravity, device="cpu", precision="float64")
    if trajectory.system.yields or schedule:
        try:
            _ = trajectory.strains
        except ValueError as error:
            raise ValueError(
                f"{error}, and the rest lengths, which change in this run, are known only from it"
            ) from error
    return _moments(trajectory, gravity, schedule)


def _moments(trajectory: Trajectory, gravity: ArrayLike, schedule: Sequence[Change]) -> Iterator[Moment]:
    assembly: Assembly | None = None
    made = -1
    for k in range(len(trajectory)):
        system, changes = system_in(trajectory, k, schedule), len(changes_made(trajectory, k, schedule))
        if assembly is None or changes > made:
            problem, made = Problem(system=system, gravity=gravity), changes
            assembly = assemble(problem, device="cpu", precision="float64")
        elif assembly.model.system.yields:
            assembly.model.rest_length.assign(assembly.model.ordered(system.rest_length))
        if assembly.fracture is not None:
            assembly.fracture.restore({"broken_at": system.broken_at})
        state = State.from_system(system, assembly.model, 0)
        height, centre = system.position[:, -1], system.center_of_mass
        heights = float(height.min()), float(centre[-1]), float(height.max())
        yield Moment(float(trajectory.times[k]), measure(assembly, state), *heights)


def _line(moment: Moment) -> tuple[float, ...]:
    time, measures, *heights = moment
    return (time, *(of(measures) for of in COLUMNS.values()), *measures.momentum, *heights)


def write_history(
    trajectory: Trajectory,
    path: str | Path,
    *,
    gravity: ArrayLike,
    schedule: Sequence[Change] = (),
    force: bool = False,
) -> Path:
    """Write the history of a trajectory as a table `*.csv`, with a line for each frame, or as a plot `*.png`.

    Return the path. Columns are as in a run's log of energies, then the components of the momentum, and the
    lowest, mean and highest height. Raises ValueError if a plot has fewer than two frames, and the errors of
    `history` and `output_path`.
    """
    plotted = Path(path).suffix == ".png"
    path = output_path(path, ".png" if plotted else ".csv", force)
    if plotted and len(trajectory) < 2:
        frames = counted(len(trajectory), "frame")
        raise ValueError(f"{trajectory.path} has {frames}; a plot over time takes at least 2")
    lines = map(_line, history(trajectory, gravity=gravity, schedule=schedule))
    momenta = [f"momentum_{axis}_kg_m_s" for axis in _axes(trajectory)]
    columns = ["time_s", *COLUMNS, *momenta, "lowest_m", "mean_m", "highest_m"]
    if plotted:
        _plot(trajectory, np.fromiter(lines, dtype=[(name, np.float64) for name in columns]), path)
        return path
    with GrowingTable(path, columns) as table:
        for line in lines:
            table.write_line(line)
    return path


def _plot(trajectory: Trajectory, table: NDArray[np.void], path: Path) -> None:
    """Draw energies, momentum and heights against time."""
    system = trajectory.system
    figure = new_figure(8, 9)
    panels = energies, momentum, heights = figure.subplots(3, sharex=True)
    draw_energies(energies, table)
    size = {"size": (table["momentum_kg_m_s"], DARK)}
    colors = dict(zip("xyz", (RED, GREEN, BLUE), strict=True))
    components = {axis: (table[f"momentum_{axis}_kg_m_s"], colors[axis]) for axis in _axes(trajectory)}
    draw_curves(momentum, table["time_s"], size | components, "momentum [kg m/s]")
    curves = {
        "highest": (table["highest_m"], RED),
        "mean (centre of mass)": (table["mean_m"], DARK),
        "lowest": (table["lowest_m"], BLUE),
    }
    draw_curves(heights, table["time_s"], curves, "height [m]" if system.dim > 1 else "x [m]")
    heights.fill_between(table["time_s"], table["lowest_m"], table["highest_m"], color=DARK, alpha=0.08, lw=0)
    heights.set_xlabel("time [s]")
    for axes in panels:  # margins for the legend above, and a power of ten on the left
        axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 1), ncols=4, borderaxespad=0.2)
    figure.align_ylabels()
    name = Path(trajectory.attributes.get("scene", trajectory.path)).stem
    title = f"{name}: {system.particle_count} particles, {system.connection_count} connections"
    figure.suptitle(title, parse_math=False)
    save_figure(figure, path)


def _axes(trajectory: Trajectory) -> list[str]:
    return ["xyz"[axis] for axis in AXES[trajectory.system.dim]]


def changes_made(trajectory: Trajectory, k: int, schedule: Sequence[Change]) -> list[Change]:
    """Return the changes made before frame k was simulated, in order."""
    fps = trajectory.attributes.get("options", {}).get("fps", trajectory.fps)  # a file may hold every n-th frame
    before = round(trajectory.times[k] * fps) - 1
    ordered = sorted(schedule, key=lambda change: change.time)
    return [change for change in ordered if change.is_due(before, fps)]


def system_in(trajectory: Trajectory, k: int, schedule: Sequence[Change] = ()) -> System:
    """Return the system in frame k of a trajectory.

    Changes of the schedule are included. Rest lengths that change are computed from the strains; ValueError is
    raised if the file has no strains.
    """
    system = start = trajectory.system
    frame = trajectory.frame(k)
    for change in changes_made(trajectory, k, schedule):
        system = change.foreseen.applied_to(system)
    system = system.replace(position=frame.position, velocity=frame.velocity)
    if start.tears:
        broken_at = trajectory.broken_at
        system = system.replace(broken_at=np.where(broken_before(broken_at, frame.time), broken_at, np.inf))
    if not (start.yields or schedule):
        return system
    rest_length = recovered_rest_length(system, trajectory.strains[k])
    return system.replace(rest_length=rest_length, original_length=start.original_length)


def recovered_rest_length(system: System, strain: NDArray) -> NDArray[np.float64]:
    """Return rest lengths [m], shape [connection_count], given the strains of springs.

    A spring between coincident particles keeps the system's rest length, which its strain does not determine.
    """
    ratio = 1.0 + strain.astype(np.float64)
    return np.divide(system.length, ratio, out=np.array(system.rest_length), where=ratio > 0)


def particle_energies(system: System) -> NDArray[np.float64]:
    """Return the energy of each particle [J], shape [particle_count]: kinetic, and half of its springs' energies.

    Pinned particles have no kinetic energy. Raises ValueError if springs are not linear.
    """
    if system.spring != LINEAR_SPRING:
        raise ValueError(f"system has spring={system.spring!r}; for energies of particles it must be linear")
    mass = np.where(system.pinned, 0.0, system.mass)
    energy = 0.5 * mass * (system.velocity**2).sum(axis=1)
    half = 0.25 * np.where(system.broken, 0.0, system.stiffness) * (system.length - system.rest_length) ** 2
    for end in system.connections.T:
        energy += np.bincount(end, weights=half, minlength=system.particle_count)
    return energy
