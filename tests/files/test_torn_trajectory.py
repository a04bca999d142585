"""What a file says of connections that break: when each did, once for all frames."""

import h5py
import numpy as np
import pytest
from trajectories import vtk_frames

from msdwarp import Simulation, System, Trajectory, TrajectoryWriter, sheet
from msdwarp.bodies import Edges, broken_before
from msdwarp.simulation.readback import Readback


def torn() -> System:
    """Return a sheet that is pulled apart along a line of its middle, and has a cut."""
    body = sheet((6, 5), 0.1, mass=0.01, stiffness=200.0, damping=0.02)
    left = body.position[:, 0] < 0.0
    seam = np.flatnonzero(left[body.connections[:, 0]] != left[body.connections[:, 1]])
    broken_at, strain = np.full((2, body.connection_count), np.inf)
    broken_at[seam[0]], strain[seam] = 0.0, 0.1
    velocity = np.where(left, -1.0, 1.0)[:, None] * (4.0, 1.0, 0.0) * (1 + body.position[:, 1:2])
    return body.with_velocity(velocity).replace(break_strain=strain, broken_at=broken_at)


def record(path, frames: int = 8, *, compress: bool = False, **options) -> Simulation:
    simulation = Simulation(torn(), device="cpu", gravity=0.0, fps=600, substeps=4)
    readback = Readback(simulation)
    with TrajectoryWriter(path, simulation.system, fps=600, compress=compress, **options) as writer:
        for k in range(frames):
            if k:
                simulation.step()
            if k >= options.get("behind", 0):
                writer.write_pending(readback.take())
    return simulation


@pytest.mark.parametrize("compress", [False, True])
def test_it_says_when_each_connection_broke(tmp_path, compress):
    simulation = record(tmp_path / "a.vtkhdf", compress=compress)
    with Trajectory(tmp_path / "a.vtkhdf") as found:
        np.testing.assert_array_equal(found.broken_at, simulation.snapshot().broken_at)
        assert found.system.broken.sum() == 1
        np.testing.assert_array_equal(found.system.break_strain, simulation.system.break_strain)
        assert len(np.unique(found.broken_at)) > 3
        for k, time in enumerate(found.times):
            np.testing.assert_array_equal(np.isnan(found.strains[k]), broken_before(found.broken_at, time))


def test_a_file_that_grows_says_it_so_far(tmp_path):
    path = tmp_path / "a.vtkhdf"
    simulation = Simulation(torn(), device="cpu", gravity=0.0, fps=600, substeps=4)
    with TrajectoryWriter(path, simulation.system, fps=600) as writer:
        for _ in range(4):
            simulation.step()
            now = simulation.snapshot()
            writer.write(simulation.frame(), broken_at=now.broken_at)
            writer.flush()
            with Trajectory(path) as found:
                np.testing.assert_array_equal(found.broken_at, now.broken_at)


def test_what_breaks_behind_the_frames_kept_is_whole_again_where_another_comes(tmp_path):
    whole, path = tmp_path / "whole.vtkhdf", tmp_path / "a.vtkhdf"
    record(whole)
    record(path)
    with Trajectory(whole) as found:
        system, broken_at, times, other = found.system, found.broken_at, found.times, found[2]
    record(path, 4, behind=2)
    with Trajectory(path) as found:
        assert len(found) == len(times)  # those were the same again
        np.testing.assert_array_equal(found.broken_at, broken_at)
    expected = np.where(broken_before(broken_at, times[1]), broken_at, np.inf)
    with TrajectoryWriter(path, system, fps=600, behind=2) as writer:
        writer.write(other._replace(position=other.position + 1), broken_at=expected)
    with Trajectory(path) as found:
        assert len(found) == 3
        np.testing.assert_array_equal(found.broken_at, expected)
        assert 0 < np.isfinite(expected).sum() < np.isfinite(broken_at).sum()


def test_paraview_sees_it(tmp_path, vtk_output):
    simulation = record(tmp_path / "a.vtkhdf")
    system = simulation.snapshot()
    lines = system.connection_count
    for _, mesh in vtk_frames(tmp_path / "a.vtkhdf"):
        when = mesh.cell_data["broken_at"]
        np.testing.assert_array_equal(when[:lines], system.broken_at)
        np.testing.assert_array_equal(when[lines:], Edges(system).parted_at(system.broken_at))
    assert vtk_output.GetOutput() == ""


@pytest.mark.parametrize(("neighbours", "edge"), [(8, 1), (4, 0)])
def test_a_triangle_parts_when_its_corners_are_no_longer_joined(neighbours, edge):
    # Of three edges the second that breaks parts it, of two, where the diagonal is no connection, the first.
    body = sheet((2, 2), 1.0, neighbors=neighbours)
    surface, times = body.surface, np.arange(1.0, body.connection_count + 1)
    assert surface is not None
    joined = {frozenset(map(int, pair)): time for pair, time in zip(body.connections, times, strict=True)}
    expected = [
        sorted(joined.get(frozenset(map(int, (corners[k], corners[k - 1]))), np.inf) for k in range(3))[edge]
        for corners in surface.particle[surface.triangles]
    ]
    np.testing.assert_array_equal(Edges(body).parted_at(times), expected)


def test_a_file_of_what_cannot_tear_has_nothing_of_it(tmp_path):
    body = sheet((3, 3))
    with TrajectoryWriter(tmp_path / "a.vtkhdf", body, fps=600) as writer:
        writer.write((0.0, body.position, body.velocity))
    with Trajectory(tmp_path / "a.vtkhdf") as found:
        assert np.isinf(found.broken_at).all()
        assert not found.system.tears
    names: list[str] = []
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        file.visit(names.append)
    assert not [name for name in names if "break" in name or "broken" in name]
