"""Export: what other programs would read is what was simulated."""

import json
import struct

import numpy as np
import pytest
from trajectories import drawing_of, largest_file

from msdwarp import Look, Scene, System, Trajectory, ball, box, chain, sheet
from msdwarp.files.export import export
from msdwarp.files.writer import TrajectoryWriter
from msdwarp.pictures import Drawing
from msdwarp.textures import gingham

pv = pytest.importorskip("pyvista")

SYSTEMS = {"box": box((4, 3, 3)), "plane": sheet((3, 3), dim=2), "ball": ball(1.0, 0.5), "chain": chain(5)}
SYSTEMS["grains"] = System(position=[[0.0, 0, 0], [1, 0, 0], [0, 1, 1]])


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


def read_glb(path):
    """Return the document of a binary glTF file, and a function that returns the values of an accessor."""
    raw = path.read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sII I4s", raw[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(raw), b"JSON")
    document, data = json.loads(raw[20 : 20 + size]), raw[20 + size + 8 :]
    assert document["buffers"][0]["byteLength"] == len(data)

    def values(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        array = np.frombuffer(data[view["byteOffset"] :][: view["byteLength"]], kind).reshape(
            accessor["count"], -1
        )
        np.testing.assert_array_equal(array.min(axis=0), np.array(accessor["min"], kind))
        np.testing.assert_array_equal(array.max(axis=0), np.array(accessor["max"], kind))
        return array

    return document, values


def test_an_animated_file_has_each_frame(tmp_path, trajectory):
    chosen = [1, 2, 5]
    (path,) = export(trajectory, tmp_path / "b.glb", "glb", chosen, draw=drawing_of(trajectory))
    document, values = read_glb(path)
    (animation,) = document["animations"]
    (sampler,) = animation["samplers"]
    np.testing.assert_allclose(values(sampler["input"])[:, 0], np.array([0, 1, 4]) / 30, atol=1e-6)
    weights = values(sampler["output"]).reshape(3, 2)
    (mesh,) = document["meshes"]
    assert [one["target"] for one in animation["channels"]] == [{"node": 0, "path": "weights"}]
    for k, number in enumerate(chosen):
        corners = []
        for part in mesh["primitives"]:
            at = {name: values(part["attributes"][name]).astype(float) for name in ("POSITION", "NORMAL")}
            for name, value in at.items():
                for share, target in zip(weights[k], part["targets"], strict=True):
                    value += share * values(target[name])
            np.testing.assert_allclose(np.linalg.norm(at["NORMAL"], axis=1), 1, atol=1e-5)
            corners.append(at["POSITION"][values(part["indices"]).ravel()])
        found = np.concatenate(corners).reshape(-1, 3, 3)
        expected = shown(trajectory, number)
        turned = np.stack([expected[..., 0], expected[..., 2], -expected[..., 1]], axis=-1)  # y is up
        np.testing.assert_allclose(found, turned, atol=1e-6)


def test_objects_have_normals_groups_and_materials(tmp_path):
    cube, cloth = box((3, 3, 3), 0.1).named("a cube"), sheet((3, 3), 0.1).translate((0, 0, 1.0)).named("cloth")
    looks = {"cloth": Look(texture=gingham("#c03020", "#f4f1e8", size=64)), "a cube": Look(color="#3366cc")}
    scene = Scene(system=cube + cloth, looks=looks)
    with TrajectoryWriter(tmp_path / "a.vtkhdf", scene.system, fps=30) as writer:
        writer.write((0.0, scene.system.position, scene.system.velocity))
    with Trajectory(writer.path) as found:
        for body, objects in (((), ["cloth", "a_cube"]), (("cloth",), ["cloth"])):
            draw = drawing_of(found, scene, body=body)
            (path,) = export(found, tmp_path / "b.obj", "obj", 0, up="y", scale=100.0, force=True, draw=draw)
            lines = [line.split() for line in path.read_text().splitlines()]
            for word in ("o", "g", "usemtl"):
                assert [line[1] for line in lines if line[0] == word] == objects
        mesh = pv.read(path)
        sheet_at = cloth.surface.points(cloth.position)
        np.testing.assert_allclose(mesh.points, 100 * sheet_at[:, [0, 2, 1]] * [1, 1, -1], atol=1e-4)
        np.testing.assert_allclose(np.abs(mesh.point_data["Normals"]), [[0, 1, 0]] * mesh.n_points, atol=1e-6)
        export(found, tmp_path / "b.obj", "obj", 0, force=True, draw=drawing_of(found, scene))
    materials = (tmp_path / "b.mtl").read_text()
    assert "newmtl a_cube\nKd 0.2 0.4 0.8\n" in materials
    assert "map_Kd b_textures/cloth.png" in materials
    assert (tmp_path / "b_textures" / "cloth.png").exists()


def test_textures_fit(tmp_path, trajectory):
    surface = trajectory.system.surface
    if surface is None:
        pytest.skip("it has no surface")
    for to in ("obj", "ply"):
        (path,) = export(trajectory, tmp_path / f"b.{to}", to, 0, draw=drawing_of(trajectory))
        found = pv.read(path).point_data
        (at,) = {"TCoords", "body"} & set(found.keys())  # in OBJ they have the name of the material
        np.testing.assert_allclose(found[at], surface.uv, atol=1e-5)


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
        (("b.obj", "fbx", 0), "to is 'fbx'; it must be one of 'obj', 'stl', 'ply', 'glb', 'usd', 'npz'"),
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


@pytest.mark.parametrize("to", ["obj", "stl", "ply", "glb", "npz"])
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, to):
    system, path = box((12, 12, 12)), tmp_path / f"b.{to}"
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=30) as writer:
        writer.write((0.0, system.position, system.velocity))
    with Trajectory(writer.path) as trajectory:
        drawn, _ = drawing_of(trajectory)([0], to)
        drawn = list(drawn)  # before kernels that are compiled find no room
        with largest_file(8192), pytest.raises(OSError, match=rf"b\.{to} could not be written: "):
            export(trajectory, path, to, 0, draw=lambda *_: (drawn, {}))
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtkhdf"]
