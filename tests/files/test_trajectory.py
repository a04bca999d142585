"""Trajectories: what is written comes back bit for bit, to us and to VTK."""

import shutil
from contextlib import suppress
from dataclasses import fields

import h5py
import numpy as np
import pytest
from trajectories import KINDS, SYSTEMS, assert_same, frames, in_space, vtk_frames, write

from msdwarp import CoulombDamper, QuadraticDamper, Simulation, System, Trajectory, TrajectoryWriter, ball, box
from msdwarp.files import vtkhdf

pv = pytest.importorskip("pyvista")

# What is written comes back.


@pytest.mark.parametrize(("dtype", "compress"), KINDS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_frames_and_system_come_back(tmp_path, name, dtype, compress):
    system, attributes = SYSTEMS[name], {"scene": name, "list": [1, 2.5, None], "seed": 1 << 80, "limit": np.inf}
    path = write(tmp_path / "a.vtkhdf", system, 5, dtype, compress=compress, attributes=attributes)
    with Trajectory(path) as found:
        assert len(found) == len(found.positions) == 5
        assert (found.fps, found.attributes) == (60, attributes)
        expected = list(frames(system, 5, dtype))
        np.testing.assert_array_equal(found.times, [frame.time for frame in expected])
        for frame, wanted in zip(found, expected, strict=True):
            assert_same(frame, wanted)
        assert_same(found[-1], expected[-1])
        for frame, wanted in zip(found[4:0:-2], expected[4:0:-2], strict=True):
            assert_same(frame, wanted)
        with pytest.raises(IndexError):
            found.frame(5)
        assert_same_systems(found.system, system)


def assert_same_systems(found, system):
    for field in fields(System):
        got, wanted = getattr(found, field.name), getattr(system, field.name)
        if isinstance(wanted, np.ndarray):
            assert (got.dtype, got.shape) == (wanted.dtype, wanted.shape)
            assert got.strides[:1] == wanted.strides[:1], "what is the same everywhere is stored once"
            np.testing.assert_array_equal(got, wanted)
        elif field.name == "surface" and wanted is not None:
            for part in fields(wanted):
                np.testing.assert_array_equal(getattr(got, part.name), getattr(wanted, part.name))
        elif field.name == "groups":
            assert list(got) == list(wanted)
            for key in wanted:
                np.testing.assert_array_equal(got[key], wanted[key])
        else:
            assert got == wanted, field.name


def test_everything_a_system_can_have_comes_back(tmp_path):
    first = box((3, 3, 2), damping=2.0).pin([0]).named("a/b").rotate(0.3, (1, 2, 3))
    rest = first.rest_length * np.linspace(0.9, 1.1, first.connection_count)
    first = first.replace(
        rest_length=rest, original_length=first.rest_length, yield_strain=0.1, relaxation_time=0.0
    )
    for damper in (CoulombDamper(0.2), QuadraticDamper(3.0)):
        system = first.replace(damper=damper) + ball(1.0, 0.5).named("")
        path = write(tmp_path / f"{type(damper).__name__}.vtkhdf", system)
        with Trajectory(path) as found:
            assert_same_systems(found.system, system)


def test_every_nth_frame_and_an_unknown_number_of_frames(tmp_path, monkeypatch, vtk_output):
    monkeypatch.setattr(vtkhdf, "FORESEEN", 3)
    system = SYSTEMS["box"]
    for options in ({}, {"frame_count": 3}, {"frame_count": 20}):  # more and fewer than were foreseen
        path = write(tmp_path / "a.vtkhdf", system, 20, every=2, force=True, **options)
        with Trajectory(path) as found:
            assert (len(found), found.fps) == (10, 30)
            for frame, wanted in zip(found, list(frames(system, 20))[::2], strict=True):
                assert_same(frame, wanted)
        assert [when for when, _ in vtk_frames(path)] == [k / 30 for k in range(10)]
    assert vtk_output.GetOutput() == ""


def test_strain_follows_rest_lengths_that_move(tmp_path):
    system = box((3, 3, 2)).replace(yield_strain=0.01)
    frame = next(frames(system, 1, "float64"))
    length = system.replace(position=frame.position).length
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60) as writer:
        writer.write(frame)
        writer.write(frame._replace(time=1.0), length / (2 * system.rest_length) - 1)
    with Trajectory(writer.path) as found:
        for strain, rest in zip(found.strains[:], (system.rest_length, 2 * system.rest_length), strict=True):
            np.testing.assert_allclose(strain, length / rest - 1, atol=1e-14)


def test_strain_can_be_left_out(tmp_path, vtk_output):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"], strain=False)
    with Trajectory(path) as found, pytest.raises(ValueError, match="without strain"):
        _ = found.strains
    assert all(not mesh.cell_data for _, mesh in vtk_frames(path))
    assert vtk_output.GetOutput() == ""


KEYS = [
    3,
    -1,
    (-1, 5),
    (..., 1),
    (slice(None, None, 7), slice(3, 9), 0),
    (slice(None, None, -3), slice(None, None, -2)),
]
KEYS += [slice(5, 5), (slice(2, 9), 4), (slice(1, 4), ...), [3, 1], (2, 3, 1), (slice(None), slice(5, 5)), ()]
KEYS += [(slice(None, None, 2), 4, slice(0, 2)), np.arange(12) % 5 == 0, np.int64(3), (slice(None, None, -1), 4)]
KEYS += [(slice(None), [5, 2, 2]), (..., 3, slice(None))]


@pytest.mark.parametrize("name", ["line", "plane", "box", "embedded"])
def test_arrays_on_disk_are_indexed_as_those_in_memory(tmp_path, name):
    system = SYSTEMS[name].translate([1.0] * SYSTEMS[name].dim)
    expected = np.array([frame.position for frame in frames(system, 12)])
    with Trajectory(write(tmp_path / "a.vtkhdf", system, 12)) as found:
        view = found.positions
        assert (view.shape, view.dtype, view.ndim) == (expected.shape, expected.dtype, 3)
        np.testing.assert_array_equal(np.asarray(view), expected)
        for key in KEYS:
            try:
                wanted = expected[key]
            except IndexError:
                with pytest.raises(IndexError):
                    view[key]
            else:
                got = view[key]
                assert np.shape(got) == wanted.shape, key
                np.testing.assert_array_equal(got, wanted, str(key))
        several = view[[0, 3], [1, 2, 0]]  # each index for its own axis
        np.testing.assert_array_equal(several, expected[np.ix_([0, 3], [1, 2, 0])])
        with pytest.raises(IndexError, match="4 indices"):
            view[0, 0, 0, 0]
        assert found.strains[2, 1].shape == ()


# VTK reads it.


@pytest.mark.parametrize(("dtype", "compress"), KINDS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_vtk_reads_every_frame_bit_for_bit(tmp_path, name, dtype, compress, vtk_output):
    system = SYSTEMS[name]
    n, lines, surface = system.particle_count, system.connection_count, system.surface
    path = write(tmp_path / "a.vtkhdf", system, 5, dtype, compress=compress, frame_count=5)
    expected = list(frames(system, 5, dtype))
    for (when, mesh), frame in zip(vtk_frames(path), expected, strict=True):
        assert (when, mesh.points.dtype) == (frame.time, dtype)
        np.testing.assert_array_equal(mesh.points[:n], in_space(frame.position))
        np.testing.assert_array_equal(mesh.point_data["velocity"][:n], in_space(frame.velocity))
        np.testing.assert_array_equal(mesh.lines.reshape(-1, 3)[:, 1:], system.connections)
        assert mesh.n_verts == (n if not lines and surface is None else 0)
        if surface is not None:
            corners = mesh.points[mesh.faces.reshape(-1, 4)[:, 1:]]
            wanted = in_space(surface.points(frame.position).astype(dtype))[surface.triangles]
            np.testing.assert_array_equal(corners, wanted)
        if lines:
            strain = mesh.cell_data["strain"]
            moved = system.replace(position=frame.position.astype(np.float64)).strain
            np.testing.assert_allclose(strain[:lines], moved, atol=1e-5 if dtype == "float32" else 1e-14)
            assert np.isnan(strain[lines:]).all()
    reader = pv.get_reader(path)
    for k, frame in enumerate(expected):
        reader.reader.SetStep(k)
        np.testing.assert_array_equal(reader.read().points[:n], in_space(frame.position))
    assert vtk_output.GetOutput() == ""


@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
def test_a_simulation_is_read_bit_for_bit(tmp_path, precision, vtk_output):
    simulation = Simulation(box((3, 3, 3)), device="cpu", precision=precision, substeps=40)
    kept = []
    with TrajectoryWriter(tmp_path / "a.vtkhdf", simulation.system, fps=60) as writer:
        for frame in simulation.frames(0.2):
            writer.write(frame)
            kept.append(frame)
    for (when, mesh), frame in zip(vtk_frames(writer.path), kept, strict=True):
        assert when == frame.time
        np.testing.assert_array_equal(mesh.points, frame.position)
    assert vtk_output.GetOutput() == ""


def test_a_file_of_one_frame(tmp_path, vtk_output):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 1)
    ((_, mesh),) = vtk_frames(path)
    np.testing.assert_array_equal(mesh.points, next(frames(SYSTEMS["box"], 1)).position)
    assert vtk_output.GetOutput() == ""


def test_other_files_are_refused_by_what_is_wrong(tmp_path):
    path = write(tmp_path / "good.vtkhdf", SYSTEMS["box"])
    with pytest.raises(FileNotFoundError):
        Trajectory(tmp_path / "none.vtkhdf")
    for content in (b"", b"\x89HDF", b"solid box"):
        (tmp_path / "bad").write_bytes(content)
        with pytest.raises(ValueError, match="it is no HDF5 file"):
            Trajectory(tmp_path / "bad")
    whole = path.read_bytes()
    for size in (len(whole) // 2, len(whole) - 1):
        (tmp_path / "bad").write_bytes(whole[:size])
        with pytest.raises(ValueError, match="cannot be read: it is cut short"):
            Trajectory(tmp_path / "bad")
    for change, said in [
        (lambda file: file.move("VTKHDF", "other"), "it has no group VTKHDF"),
        (lambda file: file.move("msdwarp", "other"), "VTKHDF of another program"),
        (lambda f: f["msdwarp"].attrs.modify("msdwarp_format", 2), r"format 2; this version reads 1: install a n"),
        (lambda file: file["msdwarp"].attrs.modify("msdwarp_format", 0), r"format 0; this version reads 1$"),
        (lambda file: file["VTKHDF"].move("Points", "other"), "damaged.*Points"),
        (lambda file: file["msdwarp"].move("attributes", "other"), "damaged.*attributes"),
    ]:
        shutil.copy(path, tmp_path / "bad")
        with h5py.File(tmp_path / "bad", "r+") as file:
            change(file)
        with pytest.raises(ValueError, match=said):
            Trajectory(tmp_path / "bad")


@pytest.mark.slow
def test_damage_anywhere_in_the_head_is_an_error_of_one_kind(tmp_path):
    whole = write(tmp_path / "a.vtkhdf", SYSTEMS["box"]).read_bytes()
    for place in range(0, 4000, 80):
        (tmp_path / "bad.vtkhdf").write_bytes(whole[:place] + bytes(80 * [0xFF]) + whole[place + 80 :])
        with suppress(ValueError), Trajectory(tmp_path / "bad.vtkhdf") as found:
            _ = found.system


def test_a_damaged_system_is_refused_when_it_is_asked_for(tmp_path):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"])
    with h5py.File(path, "r+") as file:
        del file["msdwarp/system/mass"]
        file["msdwarp/system/mass"] = -1.0  # as another program may: with no checksum
    with Trajectory(path) as found:
        assert len(found) == 5
        with pytest.raises(ValueError, match="damaged trajectory: its system cannot be read: mass"):
            _ = found.system


def test_the_file_in_plain_h5py(tmp_path):
    system = SYSTEMS["box"]
    path = write(tmp_path / "a.vtkhdf", system, 3)
    with h5py.File(path) as file:
        n = file["msdwarp"].attrs["particle_count"]
        points = file["VTKHDF/Points"][:].reshape(len(file["VTKHDF/Steps/Values"]), -1, 3)[:, :n]
        np.testing.assert_array_equal(points, [frame.position for frame in frames(system, 3)])
    assert path.read_bytes()[8] == 0  # the oldest superblock: a newer one does not open after a crash
