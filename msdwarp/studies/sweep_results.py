"""The results of a sweep: one dataset over what was swept, as NetCDF and as a table."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import disk
from .sweep_points import Point, Row

RESULTS, TABLE = "results.nc", "results.csv"
MISSING = "results of a sweep need xarray and h5netcdf: pip install 'msdwarp[sweep]'"
WORDS = ("status", "message", "run")
"""Results that are texts."""


def import_xarray() -> Any:
    """Return xarray; raise ValueError that says how to get it, where it or h5netcdf is not installed."""
    try:
        import h5netcdf  # noqa: F401  # pyright: ignore[reportMissingImports]
        import xarray  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(MISSING) from error
    return xarray


def dataset(grid: Mapping[str, Sequence[Any]], planned: Sequence[Point], rows: Sequence[Row]) -> Any:
    """Return the rows of all points as an `xarray.Dataset` over what was swept; NaN where a row lacks a number.

    Parameters
    ----------
    grid
        The values of what is swept; the last name changes fastest from point to point.
    planned, rows
        The points, and what is known of each.
    """
    xarray = import_xarray()
    shape, names = [len(values) for values in grid.values()], list(grid)
    numbers = dict.fromkeys(name for row in rows for name in row if name not in (*WORDS, *grid))
    found: dict[str, Any] = {
        "status": [row["status"] for row in rows],
        "message": [row["message"] for row in rows],
        "run": [point.digest for point in planned],
    }
    variables = {name: (names, np.array(words, dtype=object).reshape(shape)) for name, words in found.items()}
    for name in numbers:
        values = np.array([row.get(name, np.nan) for row in rows], dtype=np.float64)
        variables[name] = (names, values.reshape(shape))
    coordinates = {name: coordinate(values) for name, values in grid.items()}
    said = planned[0].parameters
    same = {key: value for key, value in (said["parameters"] | said["options"]).items() if key not in grid}
    about = {"scene": str(said["scene"]), "parameters": json.dumps(same)}
    return xarray.Dataset(variables, coordinates, about)


def coordinate(values: Sequence[Any]) -> np.ndarray:
    """Return the values of what is swept as numbers, or as texts where one of them is none."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values)
    return np.array([str(value) for value in values], dtype=object)


def write_results(results: Any, folder: Path) -> None:
    """Write the results as NetCDF and as a table with a line for each point; each file appears whole."""
    with disk.replacing(folder / RESULTS) as unfinished:
        results.to_netcdf(unfinished, engine="h5netcdf")
    columns = [*results.sizes, *results.data_vars]
    over = results["status"]
    arrays = [results[name].broadcast_like(over).transpose(*over.dims).values.ravel() for name in columns]
    with disk.replacing(folder / TABLE) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(map(_text, line) for line in zip(*arrays, strict=True))


def _text(value: Any) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def read_results(path: Path) -> Any:
    """Return the results that a file holds; raise OSError or ValueError if it is none."""
    xarray = import_xarray()
    with xarray.open_dataset(path, engine="h5netcdf") as opened:
        results = opened.load()
    if "status" not in results or not results.sizes:
        raise ValueError(f"{path} has no results of a sweep")
    return results
