"""Plots of a sweep: lines over one swept parameter, maps over two."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from .plots import BLUE, RED, add_grid, new_figure, output_path, save_figure
from .sweep_points import DONE, WORDS, read_results
from .table import COLUMNS

_USUAL = ("kinetic_J", "elastic_J", "gravitational_J", "largest_strain")
_MOST_PANELS = 6
_MOST_TEXTS, _LONGEST, _ABREAST = 12, 24, 45
"""Maximal number of texts at an axis, of letters of one, and of letters of all if they stand side by side."""
_SUBDIVIDED = 2.0
"""A logarithmic axis of up to so many decades has ticks at 1, 2 and 5 times powers of ten."""


def plot_sweep(results: str | Path, path: str | Path, *, show: str | None = None, force: bool = False) -> Path:
    """Plot the results.nc of a sweep into `*.png`: lines over one parameter, maps over two; return the path.

    With more parameters, the two with most values are drawn; results are means over the others. A band around a
    line shows the least and greatest value. A cross marks a point without a completed run. By default energies,
    the largest strain, probes and observed quantities are drawn; with `show` only the named result.

    Raises ValueError if the file has no results, or not the named one, or none is a number, or xarray is missing;
    and the errors of `output_path`.
    """
    path = output_path(path, ".png", force)
    found = read_results(Path(results))
    names = [str(name) for name in found.data_vars if name not in WORDS]
    if show is not None:
        checks.one_of("show", show, names)
        names = [show]
    else:
        own = [name for name in names if name not in ("time_s", "seconds", "substeps", *COLUMNS)]
        names = [*own, *(name for name in _USUAL if name in names)][:_MOST_PANELS]
    names = [name for name in names if np.isfinite(found[name].values).any()]
    if not names:
        raise ValueError(f"{results} holds no number that could be drawn: no run came to its end")
    save_figure(_figure(found, names), path)
    return path


def _figure(found: Any, names: list[str]) -> Any:
    """Return a figure with a panel for each named result."""
    longest, *second = sorted(map(str, found.sizes), key=lambda name: -found.sizes[name])[:2]
    drawn = {longest, *(name for name in second if found.sizes[name] > 1)}
    swept = [name for name in map(str, found.sizes) if name in drawn]
    others = [name for name in found.sizes if name not in swept]
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    figure = new_figure(5.2 * columns, 3.4 * rows + 0.4)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    ended = (found["status"] == DONE).all(others).transpose(*swept).values
    for axes, name in zip(panels, names, strict=False):
        values = found[name].transpose(*swept, *others)
        mean = values.mean(others) if others else values
        if len(swept) == 1:
            places = _line(axes, mean, ended)
            if others:
                least, most = values.min(others).values, values.max(others).values
                axes.fill_between(places, least, most, color=BLUE, alpha=0.15, lw=0)
            axes.set_ylabel(_label(found, name))
        else:
            _map(axes, mean, ended, _label(found, name))
            axes.set_ylabel(_label(found, swept[1]))
        axes.set_xlabel(_label(found, swept[0]))
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    means = f", mean over {', '.join(map(str, others))}" if others else ""
    figure.suptitle(f"{found.attrs.get('scene', 'sweep')}: {found['status'].size} runs{means}", parse_math=False)
    return figure


def _line(axes: Any, mean: Any, ended: NDArray) -> NDArray[np.float64]:
    """Draw a line with crosses; return the coordinates of its points along the axis."""
    places = _places(axes.xaxis, axes.set_xscale, mean[mean.dims[0]].values)
    axes.plot(places, mean.values, color=BLUE, marker="o" if len(places) <= 60 else "", ms=3.5, lw=1.6)
    axes.plot(places[~ended], np.full((~ended).sum(), 0.03), "x", color=RED, transform=axes.get_xaxis_transform())
    _thin(axes.xaxis, places)
    add_grid(axes)
    return places


def _map(axes: Any, mean: Any, ended: NDArray, label: str) -> None:
    across, up = mean.dims
    x = _places(axes.xaxis, axes.set_xscale, mean[across].values)
    y = _places(axes.yaxis, axes.set_yscale, mean[up].values)
    # Cells end midway between two points; on a logarithmic axis at the geometric mean.
    scales = {"xscale": axes.get_xscale(), "yscale": axes.get_yscale()}
    scales = {name: scale for name, scale in scales.items() if scale == "log"}  # setting a linear one resets ticks
    how = {"cmap": "viridis", "center": False, "add_labels": False, "cbar_kwargs": {"label": label}}
    mean.assign_coords({across: x, up: y}).plot.pcolormesh(x=across, y=up, ax=axes, **scales, **how)
    _thin(axes.xaxis, x)
    _thin(axes.yaxis, y)
    i, j = np.nonzero(~ended)
    axes.plot(x[i], y[j], "x", color=RED)


def _places(axis: Any, set_scale: Any, values: NDArray) -> NDArray[np.float64]:
    """Return coordinates of values on an axis, which is logarithmic for a decade or more; texts are in order."""
    if values.dtype.kind not in "iuf":
        texts = [text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…" for text in map(str, values)]
        shown = range(0, len(texts), -(-len(texts) // _MOST_TEXTS))
        long = axis.axis_name == "x" and sum(len(texts[k]) + 2 for k in shown) > _ABREAST
        how = {"rotation": 30, "horizontalalignment": "right", "rotation_mode": "anchor"} if long else {}
        axis.set_ticks(list(shown), [texts[k] for k in shown], **how)
        return np.arange(len(values), dtype=float)
    places = values.astype(float)
    if places.min() > 0 and places.max() / places.min() >= 10:
        set_scale("log")
    return places


def _thin(axis: Any, places: NDArray[np.float64]) -> None:
    """Let the ticks of a logarithmic axis be so few that their numbers do not overlap."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if axis.get_scale() == "log":
        axis.set_minor_formatter(NullFormatter())
        if np.log10(places.max() / places.min()) <= _SUBDIVIDED:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _label(found: Any, name: str) -> str:
    """Return the label of an axis, with the unit in brackets."""
    if (unit := found[name].attrs.get("units")) is not None:
        return f"{name.replace('_', ' ')} [{unit}]"
    for unit in ("_kg_m2_s", "_kg_m_s", "_m_s", "_J", "_W", "_N", "_m", "_s"):
        if name.endswith(unit):
            shown = unit[1:].replace("m2", "m²").replace("_s", "/s").replace("_", " ")
            return f"{name.removesuffix(unit).replace('_', ' ')} [{shown}]"
    return name.replace("_", " ")
