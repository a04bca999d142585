"""Pictures of a sweep, of results that are made up."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from msdwarp.studies import plot_sweep
from msdwarp.studies.grid import points
from msdwarp.studies.sweep_points import Point, write_results

pytest.importorskip("h5netcdf")

STIFFNESS = [10.0, 30.0, 100.0, 300.0]


def results(folder: Path, grid: dict, failed: int = -1) -> Path:
    """Write made-up results over a grid, of which one point may have failed; return the file."""
    planned = [Point({"scene": "made up", "parameters": given, "options": {}}, None) for given in points(grid)]
    rows = [
        {"status": "done", "message": "", "elastic_J": float(k), "foot_force_z_N": 1.0}
        for k in range(len(planned))
    ]
    if failed >= 0:
        rows[failed] = {"status": "failed", "message": "for a reason"}
    write_results(grid, planned, rows, folder)
    return folder / "results.nc"


@pytest.mark.slow
@pytest.mark.parametrize(
    "grid",
    [
        {"stiffness": STIFFNESS},
        {"stiffness": STIFFNESS, "damping": [1, 2]},
        {"seed": [0, 1, 2], "stiffness": STIFFNESS, "integrator": ["rk4", "leapfrog"]},
        {"integrator": ["rk4", "leapfrog"]},
        {"stiffness": [-1, 0, 1]},
    ],
    ids=lambda grid: "-".join(grid),
)
def test_grids_of_all_kinds_are_drawn(tmp_path, grid):
    path = plot_sweep(results(tmp_path, grid), tmp_path / "a.png")
    assert np.asarray(Image.open(path).convert("L")).std() > 5  # not blank


@pytest.mark.slow
@pytest.mark.parametrize("grid", [{"stiffness": STIFFNESS}, {"stiffness": STIFFNESS, "damping": [1, 2]}])
def test_what_did_not_come_to_its_end_is_crossed(tmp_path, grid):
    def red(failed):
        path = plot_sweep(results(tmp_path, grid, failed), tmp_path / "a.png", show="foot_force_z_N", force=True)
        r, g, b = np.moveaxis(np.asarray(Image.open(path).convert("RGB"), dtype=int), -1, 0)
        return int(((r > 200) & (g < 130) & (b < 100)).sum())

    assert red(-1) == 0
    assert red(2) > 10  # pixels of a cross


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"show": "elastic"}, "show is 'elastic'; it must be one of 'elastic_J', 'foot_force_z_N'"),
        ({"path": "a.pdf"}, "its name must end in .png"),
    ],
)
def test_what_cannot_be_drawn_is_named(tmp_path, options, said):
    file = results(tmp_path, {"stiffness": STIFFNESS})
    path = tmp_path / options.pop("path", "a.png")
    with pytest.raises(ValueError, match=re.escape(said)):
        plot_sweep(file, path, **options)
    assert not path.exists()


def test_results_without_a_number_are_not_drawn(tmp_path):
    file = results(tmp_path, {"stiffness": [1.0]}, failed=0)
    with pytest.raises(ValueError, match="holds no number that could be drawn"):
        plot_sweep(file, tmp_path / "a.png")
