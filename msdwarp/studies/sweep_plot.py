"""Pictures of a sweep: one swept parameter as a line, two as a map."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks, disk
from .plots import BLUE, RED
from .sweep_points import DONE
from .sweep_results import WORDS, read_results

_USUAL = ("kinetic_J", "elastic_J", "gravitational_J", "largest_strain")
_NOT_DRAWN = (
    "time_s",
    "seconds",
    "substeps",
    "total_J",
    "dissipated_W",
    "momentum_kg_m_s",
    "angular_momentum_kg_m2_s",
)
_MOST_PANELS = 6


def plot_sweep(results: str | Path, path: str | Path, *, show: str | None = None, force: bool = False) -> Path:
    """Draw the results of a sweep over what was swept: over one parameter lines, over two maps.

    Of more parameters the two with most values are drawn, and the mean is over the others; around a line a band
    shows the least and the greatest. A cross marks a point at which no run came to its end.

    Parameters
    ----------
    results
        The file results.nc of a sweep.
    path
        The picture, `*.png`.
    show
        Draw this result alone. By default energies, the largest strain, and what was probed and observed.
    force
        Replace a file that is there.

    Returns
    -------
    Path
        The picture.

    Raises
    ------
    ValueError
        If the file holds no results, or not this one, or none is a number; or the name does not end in .png; or
        xarray is missing.
    FileExistsError
        If the file exists and `force` is False.
    OSError
        If a file cannot be read or written.
    """
    path = Path(path)
    if path.suffix != ".png":
        raise ValueError(f"path is {path}; its name must end in .png")
    if path.exists() and not force:
        raise FileExistsError(f"path is {path}, which exists; name another file or add --force")
    found = read_results(Path(results))
    names = [str(name) for name in found.data_vars if name not in WORDS]
    if show is not None:
        checks.one_of("show", show, names)
        names = [show]
    else:
        own = [name for name in names if name not in (*_USUAL, *_NOT_DRAWN)]
        names = [*own, *(name for name in _USUAL if name in names)][:_MOST_PANELS]
    names = [name for name in names if np.isfinite(found[name].values).any()]
    if not names:
        raise ValueError(f"{results} holds no number that could be drawn: no run came to its end")
    disk.writable_folder("path", path, path.parent)
    _figure(found, names).savefig(path, dpi=150)
    return path


def _figure(found: Any, names: list[str]) -> Any:
    """Return a figure with a panel for each of some results."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    swept = sorted((str(name) for name in found.sizes), key=lambda name: -found.sizes[name])[:2]
    swept = [
        name for name in map(str, found.sizes) if name in swept and (found.sizes[name] > 1 or name == swept[0])
    ]
    others = [name for name in found.sizes if name not in swept]
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(5.2 * columns, 3.4 * rows + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    ended = (found["status"] == DONE).all(others).transpose(*swept).values
    for axes, name in zip(panels, names, strict=False):
        values = found[name].transpose(*swept, *others)
        if len(swept) == 1:
            _line(axes, found[swept[0]].values, values, others, ended)
            axes.set_ylabel(_label(name))
        else:
            across, up = found[swept[0]].values, found[swept[1]].values
            mean = values.mean(others).values if others else values.values
            _map(figure, axes, across, up, mean, ended, _label(name))
            axes.set_ylabel(swept[1])
        axes.set_xlabel(swept[0])
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    means = f", mean over {', '.join(map(str, others))}" if others else ""
    figure.suptitle(f"{found.attrs.get('scene', 'sweep')}: {found['status'].size} runs{means}", parse_math=False)
    return figure


def _line(axes: Any, across: NDArray, values: Any, others: list[Any], ended: NDArray) -> None:
    places = _places(axes.xaxis, axes.set_xscale, across)
    mean = values.mean(others).values if others else values.values
    axes.plot(places, mean, color=BLUE, marker="o" if len(across) <= 60 else "", ms=3.5, lw=1.6)
    if others:
        least, most = values.min(others).values, values.max(others).values
        axes.fill_between(places, least, most, color=BLUE, alpha=0.15, lw=0)
    axes.plot(places[~ended], np.full((~ended).sum(), 0.03), "x", color=RED, transform=axes.get_xaxis_transform())
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _map(figure: Any, axes: Any, across: NDArray, up: NDArray, mean: NDArray, ended: NDArray, label: str) -> None:
    x, y = _places(axes.xaxis, axes.set_xscale, across), _places(axes.yaxis, axes.set_yscale, up)
    drawn = axes.pcolormesh(_edges(x), _edges(y), np.ma.masked_invalid(mean.T), cmap="viridis")
    figure.colorbar(drawn, ax=axes, label=label)
    i, j = np.nonzero(~ended)
    axes.plot(x[i], y[j], "x", color=RED)


def _places(axis: Any, set_scale: Any, values: NDArray) -> NDArray[np.float64]:
    """Return where values stand on an axis, logarithmic for a decade or more; texts stand in order."""
    if values.dtype.kind not in "iuf":
        axis.set_ticks(range(len(values)), [str(value) for value in values])
        return np.arange(len(values), dtype=float)
    places = values.astype(float)
    if _is_geometric(places):
        set_scale("log")
    return places


def _is_geometric(values: NDArray[np.float64]) -> bool:
    """Tell whether positive numbers span a decade."""
    return len(values) > 1 and values.min() > 0 and values.max() / values.min() >= 10


def _edges(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of cells around places, halfway between two of them, by ratio on a logarithmic axis."""
    if len(places) == 1:
        return np.array([places[0] - 0.5, places[0] + 0.5])
    log = _is_geometric(places)
    at = np.log(places) if log else places
    middle = 0.5 * (at[1:] + at[:-1])
    edges = np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])
    return np.exp(edges) if log else edges


def _label(name: str) -> str:
    """Return what a result is called beside an axis, with its unit in brackets."""
    for unit, shown in (
        ("_kg_m2_s", "kg m²/s"),
        ("_kg_m_s", "kg m/s"),
        ("_m_s", "m/s"),
        ("_J", "J"),
        ("_W", "W"),
        ("_N", "N"),
        ("_m", "m"),
        ("_s", "s"),
    ):
        if name.endswith(unit):
            return f"{name.removesuffix(unit).replace('_', ' ')} [{shown}]"
    return name.replace("_", " ")
