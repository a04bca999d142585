"""Pictures of a sweep, of results that are made up."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from msdwarp.studies import plot_sweep, sweep_plot, units_of
from msdwarp.studies.grid import points
from msdwarp.studies.sweep_points import Point, read_results, write_results

pytest.importorskip("h5netcdf")

STIFFNESS = [10.0, 30.0, 100.0, 300.0]


def results(folder: Path, grid: dict, failed: int = -1, **units: str) -> Path:
    """Write made-up results over a grid, of which one point may have failed; return the file."""
    planned = [Point({"scene": "made up", "parameters": given, "options": {}}, None) for given in points(grid)]
    rows = [
        {"status": "done", "message": "", "elastic_J": float(k), "foot_force_z_N": 1.0}
        for k in range(len(planned))
    ]
    if failed >= 0:
        rows[failed] = {"status": "failed", "message": "for a reason"}
    write_results(grid, planned, rows, folder, units)
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


def drawn(tmp_path, grid, **units):
    """Return the axes of a plotted sweep, after it was drawn."""
    figure = sweep_plot._figure(read_results(results(tmp_path, grid, **units)), ["elastic_J", "foot_force_z_N"])
    figure.draw_without_rendering()
    return figure.axes


@pytest.mark.parametrize(
    "values",
    [
        np.geomspace(300, 3000, 8).tolist(),
        np.geomspace(1e5, 1e6, 5).tolist(),
        [1.0, 150.0],
        [f"material {k}" for k in range(40)],
        [f"a very long name of a material, number {k}" for k in range(9)],
    ],
    ids=["a decade", "large", "two decades", "many texts", "long texts"],
)
def test_numbers_and_texts_at_the_axes_do_not_overlap(tmp_path, values):
    axes = drawn(tmp_path, {"stiffness": values})[0]
    texts = [one for one in axes.get_xticklabels() if one.get_text()]
    places = [one.get_window_extent() for one in texts]
    inside = [one for one in places if axes.bbox.x0 - 1 <= (one.x0 + one.x1) / 2 or texts[0].get_rotation()]
    assert len(inside) >= 2
    for left, right in pairwise(inside):
        if texts[0].get_rotation():  # slanted ones are apart if their ends are, by more than a line is high
            assert right.x1 - left.x1 > 1.5 * axes.xaxis.label.get_size()
        else:
            assert left.x1 < right.x0


def test_axes_have_the_units_of_docstrings(tmp_path):
    def build(*, stiffness, drop_height, mass, turns, shape=()):
        """Build a scene from [nothing].

        Parameters
        ----------
        stiffness, lead
            Spring constant
            [N/mm], above 0.
        drop_height
            Height of shape [3] from which it falls [m].
        turns
            How often it turns, shape [any].
        """

    units = units_of(build, ("stiffness", "drop_height", "mass", "turns"))
    assert units == {"stiffness": "N/mm", "drop_height": "m", "mass": "kg"}
    axes = drawn(tmp_path, {"drop_height": [1.0, 2.0], "turns": [1, 2, 3]}, **units)[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("drop height [m]", "turns")


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
