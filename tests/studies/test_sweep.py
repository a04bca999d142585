"""Sweeps: equal to single runs, gone on with, and complete though workers are killed."""

import csv
import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import swept

import msdwarp as msd
from msdwarp.runtime import THREADS
from msdwarp.studies.sweep_points import Point, remove_unfinished, run_point, stored_row
from msdwarp.studies.workers import Workers

pytest.importorskip("h5netcdf")
xarray = pytest.importorskip("xarray")

GRID = {"stiffness": [50.0, 100.0, 200.0, 400.0]}
HERE = {"jobs": 1, "device": "cpu"}
NUMBERS = ["kinetic_J", "elastic_J", "total_J", "largest_strain", "substeps", "tip_position_z_m"]


@pytest.mark.slow
def test_a_sweep_is_so_many_single_runs(tmp_path):
    grid = {"stiffness": [100, 200.0], "count": (3, 4), "fps": "60,30"}
    found = msd.sweep(swept.build, grid, tmp_path / "out", observe={"height": swept.tip_height}, **HERE)
    assert dict(found.sizes) == {"stiffness": 2, "count": 2, "fps": 2}
    assert (found["status"] == "done").all()
    for stiffness, count, fps in ((100, 3, 60), (200, 4, 30)):
        scene = swept.build(stiffness=stiffness, count=count)
        single = msd.Simulation.from_scene(scene, fps=fps, device="cpu")
        single.step(round(0.1 * fps))
        row, measures = found.sel(stiffness=stiffness, count=count, fps=fps), single.measure()
        # The same computation, so the same bits; and the very numbers that the simulation gives.
        assert float(row["elastic_J"]) == measures.elastic_energy
        assert float(row["largest_strain"]) == measures.largest_strain
        assert float(row["height"]) == swept.tip_height(single)
        assert float(row["tip_position_z_m"]) == single.readings["tip"].values[-1, 2]
        assert float(row["time_s"]) == single.time
    with xarray.open_dataset(tmp_path / "out" / "results.nc", engine="h5netcdf") as stored:
        xarray.testing.assert_identical(stored.load(), found)
    with (tmp_path / "out" / "results.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 8
    for line in lines:
        row = found.sel(stiffness=float(line["stiffness"]), count=float(line["count"]), fps=float(line["fps"]))
        assert float(line["elastic_J"]) == float(row["elastic_J"])
        assert line["run"] == row["run"].item()
        assert {path.name for path in (tmp_path / "out" / "runs" / line["run"]).iterdir()} == {
            "parameters.json",
            "summary.json",
        }


@pytest.mark.slow
def test_a_wider_grid_simulates_what_is_new(tmp_path):
    told = []
    first = msd.sweep(swept.build, {"stiffness": [50, 100]}, tmp_path, report=lambda *n: told.append(n), **HERE)
    assert told == [(1, 2), (2, 2)]
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    told.clear()
    # More values, another parameter with its usual value among others, and another order.
    grid = {"damping": [0.2, 0.1], "stiffness": [200.0, 100.0, 50.0]}
    second = msd.sweep(swept.build, grid, tmp_path, report=lambda *n: told.append(n), **HERE)
    assert told[-1] == (4, 4)
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    assert before.items() <= after.items()
    assert len(after) == 6
    same = second.sel(damping=0.1, stiffness=[50, 100])
    np.testing.assert_array_equal(same["seconds"], first["seconds"])  # read, not measured again
    told.clear()
    msd.sweep(swept.build, grid, tmp_path, report=lambda *n: told.append(n), **HERE)
    assert told == []


def test_what_goes_wrong_is_a_row_and_the_others_go_on(tmp_path):
    grid = {"stiffness": [100.0, -1.0, 1e7]}
    options = {"substeps": 20, "allow_unstable": True, **HERE}
    found = msd.sweep(swept.build, grid, tmp_path, **options)
    assert found["status"].values.tolist() == ["done", "failed", "diverged"]
    assert "stiffness is -1" in found["message"].values[1]
    assert "diverged at" in found["message"].values[2]
    np.testing.assert_array_equal(np.isnan(found["total_J"]), [False, True, True])
    assert len(list((tmp_path / "runs").iterdir())) == 2  # what failed is tried again, what diverged is known
    told = []
    msd.sweep(swept.build, grid, tmp_path, report=lambda *n: told.append(n), **options)
    assert told == [(1, 1)]


def test_a_scene_that_exits_is_a_row_too(tmp_path):
    # It ended the sweep, and with it the program.
    found = msd.sweep(swept.exiting, {"stiffness": [100.0, 300.0]}, tmp_path, **HERE)
    assert found["status"].values.tolist() == ["done", "failed"]
    assert found["message"].values[1] == "SystemExit: too stiff"


def test_runs_are_kept_whole_if_asked_for(tmp_path):
    found = msd.sweep(swept.build, {"count": [3, 4]}, tmp_path, keep="run", **HERE)
    for count in (3, 4):
        folder = tmp_path / "runs" / found["run"].sel(count=count).item()
        with msd.Trajectory(folder / "trajectory.vtkhdf") as trajectory:
            assert trajectory.positions[:].shape == (7, count, 3)


def nested():
    def build(stiffness=1.0):
        return swept.build(stiffness=stiffness)

    return build


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        (("none", GRID), {}, "scene is 'none'; it must be a name"),
        ((3, GRID), {}, "scene is 3; it must be the name of a scene"),
        ((swept.build, {"stifness": [1]}), {}, "a name in grid is 'stifness'; it must be one of 'stiffness'"),
        ((swept.build, GRID), {"parameters": {"size": 3}}, "a name in parameters is 'size'"),
        ((swept.build, GRID), {"parameters": {"stiffness": 3}}, "stiffness is in grid, and given for all points"),
        ((swept.build, GRID), {"color": 3}, "an option is 'color'; it must be one of 'duration'"),
        ((swept.build, GRID), {"keep": "all"}, "keep is 'all'"),
        ((swept.build, GRID), {"jobs": 0}, "jobs is 0; it must be a whole number of at least 1"),
        ((swept.build, GRID), {"executor": 3}, "executor is 3; it must have `submit`"),
        ((nested(), GRID), {}, "scene cannot be given to worker processes"),
        ((swept.build, GRID), {"observe": {"a": lambda s: 1.0}}, "observe['a'] cannot be given to worker"),
    ],
)
def test_what_is_wrong_is_said_before_a_file_is_touched(tmp_path, arguments, options, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        msd.sweep(*arguments, tmp_path / "out", **options)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "diary.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="holds something that is no sweep"):
        msd.sweep(swept.build, GRID, tmp_path, **HERE)
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


def killing(tmp_path: Path, stiffness: float) -> dict:
    """Return parameters by which the first worker that comes to a stiffness is killed."""
    mark = tmp_path / "mark"
    mark.mkdir()
    (mark / f"kill-{stiffness:g}").touch()
    return {"mark": str(mark)}


def quiet_sweep(tmp_path: Path, parameters: dict):
    """Return what a sweep finds in this process, where nothing kills it."""
    return msd.sweep(swept.build, GRID, tmp_path / "alone", parameters=parameters, **HERE)


@pytest.mark.slow
def test_two_workers_of_which_one_is_killed_end_complete_and_equal(tmp_path):
    parameters = killing(tmp_path, 100.0)
    found = msd.sweep(swept.build, GRID, tmp_path / "out", parameters=parameters, jobs=2, device="cpu")
    assert not list((tmp_path / "mark").glob("kill-*"))  # it did happen
    assert (found["status"] == "done").all()
    swept.assert_alike(found, quiet_sweep(tmp_path, parameters))
    assert not list((tmp_path / "out" / "runs").glob(".unfinished*"))


def always_lost():
    os._exit(3)


@pytest.mark.slow  # processes are started
def test_workers_leave_each_other_their_cores(monkeypatch):
    monkeypatch.delenv(THREADS, raising=False)
    monkeypatch.setattr("msdwarp.studies.workers.cores", lambda: 7)
    with Workers(2) as workers:
        assert workers.submit(os.getenv, THREADS).result(600) == "3"


@pytest.mark.slow
def test_a_lost_call_fails_alone_and_its_worker_is_replaced():
    with Workers(1, ["7"]) as workers:
        calls = [workers.submit(os.getenv, "CUDA_VISIBLE_DEVICES"), workers.submit(always_lost)]
        calls.append(workers.submit(os.getpid))
        assert calls[0].result() == "7"
        with pytest.raises(RuntimeError):
            calls[1].result()
        assert calls[2].result() != os.getpid()


@pytest.mark.slow
def test_a_sweep_that_ends_amid_a_run_leaves_no_half_of_it(tmp_path):
    points = [Point({"k": k}, None) for k in range(200)]
    with ThreadPoolExecutor(2) as workers:
        calls = [workers.submit(run_point, lambda *_: {}, point, tmp_path, False) for point in points]
        while not all(call.done() for call in calls):
            remove_unfinished(tmp_path)
    assert all(stored_row(folder) for folder in tmp_path.iterdir())
    assert {call.result()["status"] for call in calls} <= {"done", "failed"}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask's own
def test_dask_loses_a_worker_and_the_sweep_does_not(tmp_path):
    distributed = pytest.importorskip("distributed")
    parameters = killing(tmp_path, 200.0)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        found = msd.sweep(
            swept.build, GRID, tmp_path / "out", parameters=parameters, executor=client, device="cpu"
        )
    assert not list((tmp_path / "mark").glob("kill-*"))
    assert (found["status"] == "done").all()
    swept.assert_alike(found, quiet_sweep(tmp_path, parameters))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of submitit's own
def test_submitit_loses_a_job_and_the_sweep_does_not(tmp_path, monkeypatch):
    submitit = pytest.importorskip("submitit")
    parameters = killing(tmp_path, 50.0)
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join(filter(None, sys.path))
    )  # its jobs are processes from scratch
    executor = submitit.LocalExecutor(tmp_path / "jobs")
    executor.update_parameters(timeout_min=5)
    monkeypatch.setattr(submitit.Job, "_results_timeout_s", 1)  # a killed job writes none
    found = msd.sweep(swept.build, GRID, tmp_path / "out", parameters=parameters, executor=executor, device="cpu")
    assert not list((tmp_path / "mark").glob("kill-*"))
    assert (found["status"] == "done").all()
    swept.assert_alike(found, quiet_sweep(tmp_path, parameters))
