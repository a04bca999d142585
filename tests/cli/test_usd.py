"""USD: what another program reads is what pictures show: bodies, obstacles, colors, ground and camera."""

import numpy as np
import pytest
from trajectories import drawing_of

from msdwarp import Look, Plane, Scene, Sphere, System, Trajectory, TrajectoryWriter, box, sheet
from msdwarp.files import export
from msdwarp.textures import gingham
from msdwarp.world import FINISHES

usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
geometry = pytest.importorskip("pxr.UsdGeom")
shade = pytest.importorskip("pxr.UsdShade")


def scene_of(kind: str) -> Scene:
    """Return a scene: with textures and an obstacle, or with a camera that follows a body."""
    if kind == "followed":
        cube = box((3, 3, 3), 0.1).translate((0, 0, 1.0)).named("cube")
        return Scene(system=cube, colliders=[Plane()], look=Look(follow="cube"))
    two = sheet((4, 4), 0.1).named("a cloth") + box((3, 3, 3), 0.1).translate((0, 0, 0.5)).named("cube")
    looks = {
        "a cloth": Look(texture=gingham("#c03020", "#f4f1e8")),
        "cube": Look(color="#3366cc", smooth=False, finish="glass"),
    }
    return Scene(system=two, colliders=[Plane(offset=-1.0), Sphere((0, 0, -0.5), 0.2)], looks=looks)


@pytest.fixture(params=["textures", "followed"])
def drawn(tmp_path, request):
    """Yield a scene, its trajectory of four frames, and the stage of its USD file."""
    scene, random = scene_of(request.param), np.random.default_rng(0)
    system = scene.system
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=25) as writer:
        for k in range(4):
            position = system.position + 0.02 * random.normal(size=system.position.shape) + 0.1 * k
            writer.write(
                (k / 25, position.astype(np.float32), random.normal(size=position.shape).astype(np.float32))
            )
    with Trajectory(writer.path) as trajectory:
        path = tmp_path / "b.usd"
        export(trajectory, path, "usd", draw=drawing_of(trajectory, scene))
        yield scene, trajectory, usd.Stage.Open(str(path))


def meshes(stage):
    return [geometry.Mesh(one) for one in stage.Traverse() if one.IsA(geometry.Mesh)]


def test_the_camera_sees_the_body_in_its_middle(drawn):
    scene, trajectory, stage = drawn
    assert (stage.GetTimeCodesPerSecond(), stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (25, 0, 3)
    (camera,) = (geometry.Camera(one) for one in stage.Traverse() if one.IsA(geometry.Camera))
    views = []
    for k in (0, 3):
        lens = camera.GetCamera(k)
        assert lens.GetFieldOfView(lens.FOVVertical) == pytest.approx(
            scene.look.field_of_view, abs=1e-3
        )  # float32 lengths [mm]
        views.append(np.array(lens.transform))
        *_, points = (np.array(one.GetPointsAttr().Get(k)) for one in meshes(stage)[:1])
        depth = -(np.insert(points, 3, 1.0, axis=1) @ np.linalg.inv(views[-1]))[:, 2]
        near, far = camera.GetClippingRangeAttr().Get()
        assert 0 < near < depth.min() < depth.max() < far < 100 * depth.max()  # a ground reaches further
        away = (np.append(points.mean(axis=0), 1.0) @ np.linalg.inv(views[-1]))[:3]
        assert away[2] < 0  # in front: a camera looks along -z
        assert np.abs(away[:2] / away[2]).max() < np.tan(np.radians(30))  # within the picture, 16 : 9
    moved = views[1][3, :3] - views[0][3, :3]
    if scene.look.follow is None:
        np.testing.assert_array_equal(moved, 0.0)
    else:
        first, last = (trajectory.positions[k].mean(axis=0) for k in (0, 3))
        np.testing.assert_allclose(moved, last - first, atol=1e-6)


@pytest.mark.parametrize("drawn", ["textures"], indirect=True)
def test_materials_have_textures_and_colors(drawn, tmp_path):
    _, _, stage = drawn
    names = [one.GetPrim().GetName() for one in meshes(stage)]
    assert names == ["a_cloth", "cube", "obstacle", "ground"]
    assert [path.name for path in (tmp_path / "b_textures").iterdir()] == ["a_cloth.png"]
    for name, image in (("a_cloth", "./b_textures/a_cloth.png"), ("cube", None)):
        material, _ = shade.MaterialBindingAPI(stage.GetPrimAtPath(f"/scene/{name}")).ComputeBoundMaterial()
        assert material.GetPath() == f"/scene/materials/{name}"
        surface = shade.Shader(stage.GetPrimAtPath(f"/scene/materials/{name}/surface"))
        found = [surface.GetInput(one).Get() for one in ("roughness", "metallic", "opacity")]
        # A matt one has the roughness of its gloss; inputs are float32.
        made_of = FINISHES["glass"] if name == "cube" else FINISHES["matt"]._replace(roughness=0.65)
        assert found == pytest.approx([made_of.roughness, made_of.metallic, made_of.opacity], abs=1e-6)
        texture = stage.GetPrimAtPath(f"/scene/materials/{name}/image")
        assert (shade.Shader(texture).GetInput("file").Get().path if texture else None) == image
    still = stage.GetPrimAtPath("/scene/obstacle").GetAttribute("points")
    assert still.GetNumTimeSamples() == 0  # it does not move, and is stored once
    (tmp_path / "b.usd").unlink()
    trajectory = drawn[1]
    with pytest.raises(FileExistsError, match="b_textures, which exists"):
        export(trajectory, tmp_path / "b.usd", "usd", draw=lambda *_: None)


def test_ropes_are_curves_that_tear(tmp_path):
    """A loop, and a rope that tears between its third and fourth particle; both have velocities."""
    x = np.linspace(0.0, 0.5, 6)
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]])
    rope = System(position=np.stack([x, 0 * x, 0 * x], axis=1), connections=ends)
    ring = System(position=[[0.0, 1, 0], [0.1, 1, 0], [0, 1, 0.1]], connections=[[0, 1], [1, 2], [0, 2]])
    system = rope + ring
    times = np.where(np.arange(8) == 2, 0.5 / 25, np.inf)
    system = system.replace(break_strain=np.where(times < 1, 1.0, np.inf))
    scene = Scene(system=system, look=Look(color="#3366cc", tube=0.01))
    velocity = system.position + np.array([1.0, 2.0, 3.0])
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=25) as writer:
        for k in range(2):
            writer.write((k / 25, system.position + np.array([0, 0, 0.1 * k]), velocity), broken_at=times)
    with Trajectory(writer.path) as trajectory:
        export(trajectory, tmp_path / "b.usd", "usd", up="y", scale=100.0, draw=drawing_of(trajectory, scene))
    stage = usd.Stage.Open(str(tmp_path / "b.usd"))
    assert (geometry.GetStageUpAxis(stage), geometry.GetStageMetersPerUnit(stage)) == ("Y", pytest.approx(0.01))
    assert not meshes(stage)
    curves = [geometry.BasisCurves(one) for one in stage.Traverse() if one.IsA(geometry.BasisCurves)]
    for one, points, counts in zip(
        curves, ([0, 1, 2, 3, 4, 5], [6, 7, 8, 6]), ([[6], [3, 3]], [[4], [4]]), strict=True
    ):
        assert one.GetWidthsAttr().Get() == pytest.approx([2.0])  # [cm]
        for k in range(2):
            assert list(one.GetCurveVertexCountsAttr().Get(k)) == counts[k]
            for values, attribute in (
                (system.position + np.array([0, 0, 0.1 * k]), one.GetPointsAttr()),
                (velocity, one.GetVelocitiesAttr()),
            ):
                x, y, z = 100 * values[points].T
                np.testing.assert_allclose(attribute.Get(k), np.stack([x, z, -y], axis=1), rtol=1e-6, atol=1e-5)


def test_the_camera_follows_a_cut_body_that_travels(tmp_path):
    cube = box((5, 5, 5), 0.1).named("cube")
    scene = Scene(system=cube, colliders=[Plane(offset=-0.25)], look=Look(cut=Plane((0, -1, 0))))
    way = 0.25 * np.arange(40)[:, None] * (1, 0, 0)
    with TrajectoryWriter(tmp_path / "a.vtkhdf", cube, fps=20) as writer:
        for k, shift in enumerate(way):
            writer.write((k / 20, cube.position + shift, np.zeros((125, 3))))
    with Trajectory(writer.path) as trajectory:
        export(trajectory, tmp_path / "b.usd", "usd", draw=drawing_of(trajectory, scene))
    stage = usd.Stage.Open(str(tmp_path / "b.usd"))
    (camera,) = (geometry.Camera(one) for one in stage.Traverse() if one.IsA(geometry.Camera))
    (body, *_) = meshes(stage)
    for k in (0, 20, 39):
        points = np.array(body.GetPointsAttr().Get(k)) - way[k]
        assert points[:, 1].min() > -1e-6  # float32
        view = np.linalg.inv(np.array(camera.GetCamera(k).transform))
        across, up, back = (np.append(way[k], 1.0) @ view)[:3]
        assert max(abs(across), abs(up)) < -0.1 * back  # near the middle of the picture
        assert -back < 3.0  # at rest a camera that sees 10 m would be 12 m away


def test_vertices_have_the_velocities_of_their_particles(drawn):
    _, trajectory, stage = drawn
    body = stage.GetPrimAtPath("/scene/cube")
    points, velocities = (np.array(body.GetAttribute(name).Get(2)) for name in ("points", "velocities"))
    (frame,) = (one for k, one in enumerate(trajectory) if k == 2)
    nearest = np.linalg.norm(points[:, None] - frame.position, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(velocities, frame.velocity[nearest].astype(np.float32))
