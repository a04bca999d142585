"""History: what happens in a trajectory over time, by its file alone, and a plot of it."""

import csv
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import disk
from ..bodies import AXES
from ..engine import Measures, Model, State, measure
from ..files import Trajectory
from ..world import Change
from .energy_log import COLUMNS
from .frames import changes_made, system_in
from .plots import BLUE, DARK, GREEN, RED, draw_curves, draw_energies


class Moment(NamedTuple):
    """What a frame holds."""

    time: float
    """Simulated time [s]."""
    measures: Measures
    """Energies, momentum and strain."""
    lowest: float
    """Height of the lowest particle, its last coordinate [m]."""
    mean: float
    """Height of the centre of mass of the particles that are not pinned; of all, if all are [m]."""
    highest: float
    """Height of the highest particle [m]."""


def history(trajectory: Trajectory, *, gravity: ArrayLike, schedule: Sequence[Change] = ()) -> Iterator[Moment]:
    """Return an iterator over what each frame of a trajectory holds; one frame is in memory at a time.

    All is computed on the CPU in float64 from the frames as they are stored.

    Parameters
    ----------
    trajectory
        The frames, and the system that moves in them.
    gravity
        Acceleration of free fall in the run [m/s²]: its size, downwards along the last coordinate, or a vector
        of shape [d].
    schedule
        Changes of parameters in the run; the file knows the system as it was at the start.

    Raises
    ------
    ValueError
        If gravity is out of range; or if rest lengths do not stay, since the system yields or there is a
        schedule, and strains are not in the file.
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
    model, made = None, -1
    for k in range(len(trajectory)):
        system, changes = system_in(trajectory, k, schedule), len(changes_made(trajectory, k, schedule))
        if model is None or changes > made:
            model, made = Model(system, gravity=gravity, device="cpu", precision="float64"), changes
        elif model.lengths_change:
            model.rest_length.assign(model.ordered(system.rest_length))
        if model.tearing is not None:
            model.tearing.restore({"broken_at": system.broken_at})
        state = State.from_system(system, model, 0)
        height, centre = system.position[:, -1], system.centre_of_mass
        heights = float(height.min()), float(centre[-1]), float(height.max())
        yield Moment(float(trajectory.times[k]), measure(model, state), *heights)


def write_history(
    trajectory: Trajectory,
    path: str | Path,
    *,
    gravity: ArrayLike,
    schedule: Sequence[Change] = (),
    force: bool = False,
) -> Path:
    """Write the history of a trajectory as a table: a line for each frame, SI units in the names of the columns.

    The columns are those of a run's log of energies, and behind them the components of the momentum and the
    lowest, mean and highest height.

    Parameters
    ----------
    trajectory, gravity, schedule
        See `history`.
    path
        The file, `*.csv`.
    force
        Replace a file that is there.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        If the name does not end in .csv; and as by `history`.
    FileExistsError
        If the file exists and `force` is False.
    OSError
        If nothing can be written there.
    """
    path = _target(path, ".csv", force)
    moments, columns = history(trajectory, gravity=gravity, schedule=schedule), _columns(trajectory.system.dim)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([f"{of(moment):.9g}" for of in columns.values()] for moment in moments)
    return path


def plot_history(
    trajectory: Trajectory,
    path: str | Path,
    *,
    gravity: ArrayLike,
    schedule: Sequence[Change] = (),
    force: bool = False,
) -> Path:
    """Draw energies, momentum and heights of a trajectory against time.

    Parameters
    ----------
    trajectory, gravity, schedule
        See `history`.
    path
        The picture, `*.png`.
    force
        Replace a file that is there.

    Returns
    -------
    Path
        The picture.

    Raises
    ------
    ValueError
        If the name does not end in .png or there are fewer than two frames; and as by `history`.
    FileExistsError
        If the file exists and `force` is False.
    OSError
        If nothing can be written there.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = _target(path, ".png", force)
    if len(trajectory) < 2:
        frames = f"{len(trajectory)} frame{'' if len(trajectory) else 's'}"
        raise ValueError(f"{trajectory.path} has {frames}; a plot over time takes at least 2")
    system, columns = trajectory.system, _columns(trajectory.system.dim)
    moments = history(trajectory, gravity=gravity, schedule=schedule)
    rows = (tuple(of(moment) for of in columns.values()) for moment in moments)
    table = np.fromiter(rows, dtype=[(name, np.float64) for name in columns])

    figure = Figure(figsize=(8, 9), layout="constrained")
    FigureCanvasAgg(figure)
    panels = energies, momentum, heights = figure.subplots(3, sharex=True)
    draw_energies(energies, table)
    size = {"size": (table["momentum_kg_m_s"], DARK)}
    colours = dict(zip("xyz", (RED, GREEN, BLUE), strict=True))
    components = {name: (table[_component(name)], colours[name]) for name in _coordinates(system.dim)}
    draw_curves(momentum, table["time_s"], size | components, "momentum [kg m/s]")
    curves = {
        "highest": (table["highest_m"], RED),
        "mean (centre of mass)": (table["mean_m"], DARK),
        "lowest": (table["lowest_m"], BLUE),
    }
    draw_curves(heights, table["time_s"], curves, "height [m]" if system.dim > 1 else "x [m]")
    heights.fill_between(table["time_s"], table["lowest_m"], table["highest_m"], color=DARK, alpha=0.08, lw=0)
    heights.set_xlabel("time [s]")
    for axes in panels:  # above them a legend hides nothing, and on the right leaves room for a power of ten
        axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 1), ncols=4, borderaxespad=0.2)
    figure.align_ylabels()
    name = Path(trajectory.attributes.get("scene", trajectory.path)).stem
    title = f"{name}: {system.particle_count} particles, {system.connection_count} connections"
    figure.suptitle(title, parse_math=False)
    figure.savefig(path, dpi=150)
    return path


def _target(path: str | Path, suffix: str, force: bool) -> Path:
    """Return where a file goes, after all that can be wrong with that."""
    path = Path(path)
    if path.suffix != suffix:
        raise ValueError(f"path is {path}; its name must end in {suffix}")
    if path.exists() and not force:
        raise FileExistsError(f"path is {path}, which exists; name another file or add --force")
    disk.writable_folder("path", path, path.parent)
    return path


def _coordinates(dim: int) -> list[str]:
    """Return the names of the coordinates."""
    return ["xyz"[axis] for axis in AXES[dim]]


def _component(axis: str) -> str:
    """Return the name of a column."""
    return f"momentum_{axis}_kg_m_s"


def _columns(dim: int) -> dict[str, Callable[[Moment], float]]:
    """Return the numbers of a line by the names of their columns."""
    columns: dict[str, Callable[[Moment], float]] = {"time_s": lambda moment: moment.time}
    for name, of in COLUMNS.items():
        columns[name] = lambda moment, of=of: of(moment.measures)
    for k, axis in enumerate(_coordinates(dim)):
        columns[_component(axis)] = lambda moment, k=k: float(moment.measures.momentum[k])
    for height in ("lowest", "mean", "highest"):
        columns[f"{height}_m"] = lambda moment, height=height: getattr(moment, height)
    return columns
