"""Sweeps whose points are worlds of ensembles: what they find is what runs of their own do."""

import os
import re
import sys
import warnings

import numpy as np
import pytest
import swept

import msdwarp as msd
from msdwarp.studies import sweep_ensembles

sweep_module = sys.modules["msdwarp.studies.sweep"]  # its face has the function of that name
pytest.importorskip("h5netcdf")
xarray = pytest.importorskip("xarray")


def grid(**more):
    """Return a grid of points that differ in all that worlds may differ in at once."""
    return {"stiffness": [300.0, 400.0], "seed": [0, 1, 2], **more}


def own_folders(folder):
    return {path.name: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()}


@pytest.mark.parametrize(
    ("more", "options"),
    [
        ({"damping": [0.1, 0.3]}, {"substeps": 12}),
        pytest.param({"friction": [0.1, 0.8]}, {"substeps": 12, "integrator": "rk4"}, marks=pytest.mark.slow),
        pytest.param(
            {"gravity": [1.6, 9.82], "probes": [True]},
            {"substeps": 12, "integrator": "leapfrog-extrapolated", "precision": "float32-compensated"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_worlds_find_what_runs_of_their_own_find(tmp_path, plain_device, more, options):
    options = options | {"device": plain_device}
    if plain_device != "cpu":  # what repeats to the last bit there
        options |= {"force_algorithm": "gather"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # all of them are worlds
        found = msd.sweep(swept.thrown, grid(**more), tmp_path / "worlds", jobs="ensemble", **options)
    assert (found["status"] == "done").all()
    assert len(np.unique(found["total_J"])) == found["total_J"].size
    swept.assert_alike(found, msd.sweep(swept.thrown, grid(**more), tmp_path / "runs", jobs=1, **options))
    assert own_folders(tmp_path / "worlds").keys() == own_folders(tmp_path / "runs").keys()


@pytest.mark.slow
def test_bodies_that_stick_to_each_other_end_as_in_runs_of_their_own(tmp_path):
    several = {"stiffness": [1400.0, 2000.0], "tilt": [0.1, 0.2], "probes": [True]}
    how = {"substeps": 15, "fps": 240.0, "device": "cpu"}  # short frames: each launch of one is recorded
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = msd.sweep(swept.stacked, several, tmp_path / "worlds", jobs="ensemble", **how)
    assert (found["status"] == "done").all()
    assert (found["total_J"] - found["kinetic_J"] - found["elastic_J"] - found["gravitational_J"] > 1e-5).all()
    swept.assert_alike(found, msd.sweep(swept.stacked, several, tmp_path / "runs", jobs=1, **how))


def test_what_is_observed_of_a_world_is_that_of_its_run(tmp_path):
    how = {"observe": {"height": swept.tip_height}, "substeps": 12, "device": "cpu"}
    found = msd.sweep(swept.thrown, grid(), tmp_path / "worlds", jobs="ensemble", **how)
    assert found["height"].notnull().all()
    swept.assert_alike(found, msd.sweep(swept.thrown, grid(), tmp_path / "runs", jobs=1, **how))


@pytest.mark.slow
def test_worlds_go_on_where_runs_have_ended_and_runs_where_worlds_have(tmp_path):
    how, told = {"substeps": 12, "device": "cpu"}, []
    msd.sweep(swept.thrown, {"seed": "0:2"}, tmp_path, jobs=1, **how)
    before = own_folders(tmp_path)
    report = {"report": lambda *numbers: told.append(numbers)}
    msd.sweep(swept.thrown, {"seed": "0:5"}, tmp_path, jobs="ensemble", **how, **report)
    assert told == [(1, 3), (2, 3), (3, 3)]
    told.clear()
    found = msd.sweep(swept.thrown, {"seed": "0:6"}, tmp_path, jobs=1, **how, **report)
    assert told == [(1, 1)]
    assert (found["status"] == "done").all()
    assert before.items() <= own_folders(tmp_path).items()


def test_automatic_substeps_are_those_of_the_world_that_needs_most(tmp_path):
    stiffness = {"stiffness": [100.0, 400.0, 1600.0]}
    found = msd.sweep(swept.thrown, stiffness, tmp_path, jobs="ensemble", device="cpu")
    needed = [
        msd.Simulation.from_scene(swept.thrown(stiffness=one), device="cpu").substeps for one in (100, 400, 1600)
    ]
    assert needed[0] < needed[2]
    assert found["substeps"].values.tolist() == [needed[2]] * 3


@pytest.mark.slow
def test_what_no_ensemble_has_is_a_run_of_its_own(tmp_path):
    # One stiffness is beyond the limit of stability with these substeps.
    several = {"stiffness": [300.0, 400.0, 4e6], "wind": [False, True]}
    how = {"substeps": 12, "device": "cpu"}
    said = "4 of 6 points were worlds of ensembles, the others runs of their own: in world 0 substeps is 12"
    with pytest.warns(UserWarning, match=re.escape(said)) as heard:
        found = msd.sweep(swept.thrown, several, tmp_path / "worlds", jobs="ensemble", **how)
    assert heard[0].filename == __file__
    assert found["status"].values.tolist() == [["done"] * 2] * 2 + [["failed"] * 2]
    swept.assert_alike(found, msd.sweep(swept.thrown, several, tmp_path / "runs", jobs=1, **how))


@pytest.mark.slow
def test_a_world_that_diverges_is_told_of_as_its_run_is(tmp_path):
    stiffness = {"stiffness": [300.0, 400.0, 4e6]}
    how = {"substeps": 12, "allow_unstable": True, "device": "cpu"}
    with pytest.warns(UserWarning, match="2 of 3 points were .* its world diverges"):
        found = msd.sweep(swept.thrown, stiffness, tmp_path / "worlds", jobs="ensemble", **how)
    assert found["status"].values.tolist() == ["done", "done", "diverged"]
    swept.assert_alike(found, msd.sweep(swept.thrown, stiffness, tmp_path / "runs", jobs=1, **how))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"keep": "run"}, "keep is 'run'; it must be 'summary' where jobs is 'ensemble'"),
        ({"executor": os}, "executor is"),
        ({"jobs": "ensembles"}, "jobs is 'ensembles'; it must be a whole number of at least 1, 'auto' or"),
    ],
)
def test_what_is_wrong_is_said_before_a_file_is_touched(tmp_path, options, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        msd.sweep(swept.thrown, grid(), tmp_path / "out", **({"jobs": "ensemble"} | options))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_by_itself_it_takes_ensembles_where_there_is_one_gpu_and_substeps_are_set(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(sweep_module, "gpus_for", lambda device: ["0"])  # here there may be none
    monkeypatch.setattr(sweep_module, "workers_for", lambda *_: swept.Here())  # no process has to be begun
    monkeypatch.setattr(sweep_ensembles, "Ensemble", lambda *a, **k: made.append(1) or msd.Ensemble(*a, **k))
    stiffness = {"stiffness": [300.0, 400.0]}
    for k, (substeps, keep, ensembles) in enumerate([(12, "summary", 1), ("auto", "summary", 0), (12, "run", 0)]):
        made.clear()
        folder, how = tmp_path / str(k), {"substeps": substeps, "keep": keep, "device": "cpu"}
        found = msd.sweep(swept.thrown, stiffness, folder, jobs="auto", **how)
        assert (found["status"] == "done").all()
        assert len(made) == ensembles
