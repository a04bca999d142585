"""Export: what other programs would read is what was simulated."""

import json

import numpy as np
import pytest
from trajectories import drawing_of, largest_file

from msdwarp import Scene, System, Trajectory, ball, box, chain, sheet
from msdwarp.files.export import export
from msdwarp.files.writer import TrajectoryWriter
from msdwarp.pictures import Drawing

pv = pytest.importorskip("pyvista")

SYSTEMS = {"box": box((4, 3, 3)), "plane": sheet((3, 3), dim=2), "ball": ball(1.0, 0.5), "chain": chain(5)}


@pytest.fixture(params=SYSTEMS)
def trajectory(tmp_path, request):
    system = SYSTEMS[request.param]
    random = np.random.default_rng(0)
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=30) as writer:
        for k in range(6):
            position = (system.position + 0.1 * random.normal(size=system.position.shape)).astype(np.float32)
            writer.write((k / 30, position, -position))
    with Trajectory(writer.path) as found:
        yield found


def shown(trajectory, k):
    """Return corners of the triangles of frame k in space, shape [cell_count, 3, 3]: of a surface by hand."""
    system, position = trajectory.system, trajectory.positions[k]
    if system.surface is None:
        drawing = Drawing(Scene(system=system), "texture")
        drawing.follow(position)
        return drawing.points.numpy()[drawing.triangles]
    points, cells = system.surface.points(position), system.surface.triangles
    spatial = np.zeros((len(points), 3))
    spatial[:, [0, 2] if system.dim == 2 else [0, 1, 2]] = points
    return spatial.astype(np.float32)[cells]


def test_one_frame_has_the_name_as_it_is(tmp_path, trajectory):
    (path,) = export(trajectory, tmp_path / "b.gltf", "gltf", -1, draw=drawing_of(trajectory))
    assert path == tmp_path / "b.gltf"
    document = json.loads(path.read_text())
    parts, accessors = document["meshes"][0]["primitives"], document["accessors"]
    cells = shown(trajectory, 5)
    assert sum(accessors[part["indices"]]["count"] for part in parts) == 3 * len(cells)
    bounds = [[accessors[part["attributes"]["POSITION"]][name] for part in parts] for name in ("min", "max")]
    low, high = np.min(bounds[0], axis=0), np.max(bounds[1], axis=0)
    np.testing.assert_allclose([low, high], [cells.min(axis=(0, 1)), cells.max(axis=(0, 1))], atol=1e-6)


def test_textures_fit(tmp_path, trajectory):
    surface = trajectory.system.surface
    if surface is None:
        pytest.skip("it has no surface")
    for to in ("obj", "ply"):
        (path,) = export(trajectory, tmp_path / f"b.{to}", to, 0, draw=drawing_of(trajectory))
        np.testing.assert_allclose(pv.read(path).point_data["TCoords"], surface.uv, atol=1e-5)


def test_numpy_arrays_of_all_frames(tmp_path, trajectory):
    (path,) = export(trajectory, tmp_path / "b.npz", "npz", [0, 4, -1])
    with np.load(path) as found:
        np.testing.assert_array_equal(found["times"], trajectory.times[[0, 4, 5]])
        np.testing.assert_array_equal(found["positions"], trajectory.positions[[0, 4, 5]])
        np.testing.assert_array_equal(found["velocities"], trajectory.velocities[[0, 4, 5]])
        np.testing.assert_array_equal(found["connections"], trajectory.system.connections)
        assert found["positions"].dtype == np.float32


@pytest.mark.parametrize("trajectory", ["box"], indirect=True)
def test_wrong_arguments_are_named(tmp_path, trajectory, monkeypatch):
    for (name, to, frames), said in [
        (("b.obj", "fbx", 0), "to is 'fbx'; it must be one of 'obj', 'stl', 'ply', 'gltf', 'usd', 'npz'"),
        (("b.stl", "obj", 0), r"path is .*b\.stl; it must end in \.obj"),
        (("b.obj", "obj", 6), "frames is 6; the trajectory has 6: 0 to 5"),
        (("b.obj", "obj", slice(4, 2)), r"frames is slice\(4, 2, None\); none of the 6 frames"),
    ]:
        with pytest.raises(ValueError, match=said):
            export(trajectory, tmp_path / name, to, frames, draw=drawing_of(trajectory))
    with pytest.raises(ValueError, match="draw is None; where to is 'obj' it must be a function"):
        export(trajectory, tmp_path / "b.obj", "obj")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"needs the extra `usd`: pip install 'msdwarp\[usd\]'"):
        export(trajectory, tmp_path / "b.usd", "usd", draw=drawing_of(trajectory))
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtkhdf"]


@pytest.mark.parametrize("trajectory", ["box"], indirect=True)
def test_nothing_is_replaced_without_force(tmp_path, trajectory):
    (tmp_path / "b_0003.obj").write_text("another's")
    with pytest.raises(FileExistsError, match=r"b_0003\.obj, which exists"):
        export(trajectory, tmp_path / "b.obj", "obj", draw=drawing_of(trajectory))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.vtkhdf", "b_0003.obj"]
    assert len(export(trajectory, tmp_path / "b.obj", "obj", force=True, draw=drawing_of(trajectory))) == 6


def test_particles_alone_hold_nothing_to_draw(tmp_path):
    system = System(position=[[0.0, 0, 0], [1, 0, 0]])
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=30) as writer:
        writer.write((0.0, system.position, system.velocity))
    with Trajectory(writer.path) as found:
        with pytest.raises(ValueError, match="neither a surface nor connections"):
            export(found, tmp_path / "b.obj", "obj")
        assert export(found, tmp_path / "b.npz", "npz")


@pytest.mark.parametrize("to", ["obj", "stl", "ply", "gltf", "npz"])
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, to):
    system, path = box((12, 12, 12)), tmp_path / f"b.{to}"
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=30) as writer:
        writer.write((0.0, system.position, system.velocity))
    with Trajectory(writer.path) as trajectory:
        drawn, _ = drawing_of(trajectory)([0], False)
        drawn = list(drawn)  # before kernels that are compiled find no room
        with largest_file(8192), pytest.raises(OSError, match=rf"b\.{to} could not be written: "):
            export(trajectory, path, to, 0, draw=lambda *_: (drawn, {}))
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtkhdf"]
