"""Ways out: every file for other programs has the triangles and colors of pictures, whatever is beside what."""

import io
import json
import struct
from dataclasses import replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from msdwarp import (
    RUBBER,
    Look,
    Plane,
    Scene,
    Sphere,
    System,
    TrajectoryWriter,
    ball,
    box,
    chain,
    cloth,
    from_mesh,
    rod,
    sheet,
    shell,
)
from msdwarp.cli.commands.quantities import round_up
from msdwarp.cli.options import Options
from msdwarp.cli.picture_options import Pictures
from msdwarp.pictures import ColorScale, Drawing
from msdwarp.shapes import icosphere
from msdwarp.textures import gingham
from msdwarp.world import scene_as_stored

pv = pytest.importorskip("pyvista")
SQUARE = [(0.0, 0.0), (0.4, 0.0), (0.4, 0.4), (0.0, 0.4)]
BROKE, APART = 0.5, 0.4


def torn(body):
    """Return a body whose connections across its middle break at 0.5 s."""
    left = body.position[:, 0] < body.position[:, 0].mean() - 0.02
    return body.replace(broken_at=np.where(np.diff(left[body.connections], axis=1)[:, 0], BROKE, np.inf))


KINDS = {
    "torn box": torn(box((4, 3, 3), 0.1)),
    "torn box of few springs": torn(box((5, 3, 3), 0.1, neighbors=6)),
    "torn sheet": torn(sheet((5, 4), 0.1)),
    "torn shell": torn(shell(icosphere(0.2, 2))),
    "torn chain": torn(chain(6, 0.1)),
    "torn ball": torn(ball(0.2, 0.1)),  # which stays whole
    "cloth": cloth(SQUARE, 0.1),
    "mesh": from_mesh(icosphere(0.2, 1), 0.1),
    "rod": rod(5, 0.1, radius=0.01, material=RUBBER),
    "grains": System(position=np.random.default_rng(0).uniform(size=(7, 3))),
    "net": torn(sheet((4, 4), 0.1, neighbors=4).replace(surface=None)),
}
FLAT = {
    "torn sheet": torn(sheet((5, 4), 0.1, dim=2)),
    "cloth": cloth(SQUARE, 0.1, dim=2),
    "rod": rod(5, 0.1, radius=0.01, material=RUBBER, dim=2),
    "torn chain": torn(chain(6, 0.1, dim=2)),
}


def moved(bodies, time):
    """Return the positions of bodies at a time: halves of what has torn fly apart, all others grow a little."""
    positions = []
    for body in bodies:
        flies = body.broken.any() and (body.surface is None or body.surface.weights is None)
        way = np.sign(body.position - body.position.mean(axis=0)) * [1.0, *[0.0] * (body.dim - 1)]
        positions.append(body.position + (APART * (flies and time > BROKE) + 0.02 * time) * way)
    return np.concatenate(positions).astype(np.float32)


def triangles_in_pictures(scene, position, time, coloring="texture", values=None, *, ropes=True):
    """Return the corners of the body's triangles that have an area, and their colors, [triangle_count, 3, 3].

    Colors are NaN where there is a texture. Without `ropes`, what curves can show is left out.
    """
    drawing = Drawing(scene, coloring)
    drawing.follow(position, time, values)
    colors = drawing.colors.numpy().copy()
    for part in drawing.body if drawing.texture is not None else ():
        colors[part.vertices] = np.nan if part.finish.texture is not None else part.finish.color
    faces = np.concatenate(
        [np.zeros((0, 3), int), *(part.triangles for part in drawing.body if ropes or not part.of_rope)]
    )
    return with_area(drawing.points.numpy()[faces], colors[faces])


def with_area(corners, *others):
    """Return those triangles that are more than a line, and what belongs to them."""
    a, b, c = np.moveaxis(np.asarray(corners, float), 1, 0)
    wide = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-8  # m²: springs are 0.1 m long, tubes 4 mm thick
    return [each[wide] for each in (corners, *others)]


def in_order(corners):
    return corners[np.lexsort(np.round(corners.reshape(-1, 9).T, 4))]


def pairs(kinds):
    return [
        pytest.param(*(kinds[name] for name in both), id=" and ".join(both)) for both in combinations(kinds, 2)
    ]


@pytest.mark.parametrize(("one", "other"), [*pairs(KINDS), *pairs(FLAT)])
def test_a_body_beside_another_is_drawn_as_it_is_alone(one, other):
    look = Look(color="#3050a0")  # so that connections of bodies without surface are always drawn alike
    other = other.translate((0.0,) * (other.dim - 1) + (2.0,))
    for time in (0.4, 0.6):
        alone = [
            triangles_in_pictures(Scene(system=each, look=look), moved([each], time), time)[0]
            for each in (one, other)
        ]
        position = moved((one, other), time)
        beside, _ = triangles_in_pictures(Scene(system=one + other, look=look), position, time)
        np.testing.assert_allclose(in_order(beside), in_order(np.concatenate(alone)), atol=1e-6)  # float32
        # Nothing spans the gap between halves: edges are at most diagonals of a cell, 0.18 m.
        assert np.ptp(beside, axis=1).max() < 0.19


# What each format holds: (corners of triangles, their colors or None, [(name, image), ...]).


def read_by_vtk(path):
    mesh = pv.read(path)
    faces = mesh.faces.reshape(-1, 4)[:, 1:]
    colors = mesh.point_data["RGB"][faces] / 255 if path.suffix == ".ply" else None
    return mesh.points[faces], colors, []


def read_glb(path, k):
    raw = path.read_bytes()
    (size,) = struct.unpack("<I", raw[12:16])
    document, data = json.loads(raw[20 : 20 + size]), raw[28 + size :]

    def bytes_of(view):
        return data[view["byteOffset"] :][: view["byteLength"]]

    def read(number):
        accessor = document["accessors"][number]
        kind = {5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        return np.frombuffer(bytes_of(document["bufferViews"][accessor["bufferView"]]), kind).reshape(
            accessor["count"], -1
        )

    corners, colors, images = [], [], []
    for node in document["nodes"]:
        for part in document["meshes"][node["mesh"]]["primitives"] if node["name"] != "obstacle" else ():
            faces, at = read(part["indices"]).reshape(-1, 3), part["attributes"]
            now = {name: read(number).copy() for name, number in at.items()}
            for name, number in part["targets"][k - 1].items() if k else ():
                now[name] += read(number)
            x, y, z = now["POSITION"].T
            corners.append(np.stack([x, -z, y], axis=1)[faces])  # in glTF y is up
            material = document["materials"][part["material"]]
            paint = material["pbrMetallicRoughness"]
            if "baseColorTexture" in paint:
                source = document["images"][document["textures"][paint["baseColorTexture"]["index"]]["source"]]
                image = np.array(Image.open(io.BytesIO(bytes_of(document["bufferViews"][source["bufferView"]]))))
                images.append((material["name"], image))
            plain = np.broadcast_to(paint["baseColorFactor"][:3], now["POSITION"].shape)
            colors.append(screen(now.get("COLOR_0", plain))[faces])
    return np.concatenate(corners), np.concatenate(colors), images


def read_usd(path, k):
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    from pxr import UsdGeom

    stage = usd.Stage.Open(str(path))
    corners, colors, images = [], [], []
    for prim in stage.GetPrimAtPath("/scene").GetChildren():
        if not prim.IsA(UsdGeom.Mesh) or prim.GetName().startswith(("obstacle", "ground")):
            continue
        mesh, name = UsdGeom.Mesh(prim), prim.GetName()
        points, faces = np.array(mesh.GetPointsAttr().Get(k)), np.array(mesh.GetFaceVertexIndicesAttr().Get(k))
        faces = faces.reshape(-1, 3).astype(int)
        corners.append(points[faces])
        paint = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Get(k))
        texture = stage.GetPrimAtPath(f"/scene/materials/{name}/image")
        if texture:
            images.append((name, np.array(Image.open(path.parent / f"{path.stem}_textures" / f"{name}.png"))))
        colors.append(np.broadcast_to(screen(paint) if not texture else np.ones(3), points.shape)[faces])
    return np.concatenate(corners), np.concatenate(colors), images


def screen(color):
    """Return sRGB colors, given linear ones."""
    return np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055)


def in_a_row(kinds):
    return [body.translate((0.0,) * (body.dim - 1) + (1.0 * k,)) for k, body in enumerate(kinds.values())]


def scene_of(kinds, textured=None, colliders=()):
    """Return a scene of all bodies in a row, each with a color of its own, or one with a texture."""
    named = [body.named(name) for name, body in zip(kinds, in_a_row(kinds), strict=True)]
    looks, system = {}, reduce(add, named)
    for k, name in enumerate(kinds):
        looks[name] = Look(color=f"#{40 + 15 * k:02x}6080")
    if textured:
        looks[textured] = Look(texture=gingham("#c03020", "#f4f1e8"))
    return Scene(system=system, looks=looks, colliders=colliders)


def stored(path, scene, bodies, color):
    """Write a run of two frames, before and after bodies break, whose pictures are in a color."""
    options = replace(Options(), pictures=Pictures(color=color, full_strain=0.3))
    whole = scene.system.replace(break_strain=9.0, broken_at=np.inf)
    times, positions = (0.4, 0.6), []
    with TrajectoryWriter(
        path, whole, fps=5, attributes={"options": options.as_stored()}, scene=scene_as_stored(scene, times)
    ) as writer:
        for time in times:
            positions.append(moved(bodies, time))
            broken_at = np.where(scene.system.broken_at < time, scene.system.broken_at, np.inf)
            writer.write((time, positions[-1], positions[-1]), broken_at=broken_at)
    return times, positions


@pytest.mark.each_value
@pytest.mark.parametrize("to", ["obj", "stl", "ply", "glb", "usd"])
@pytest.mark.parametrize("color", [None, "strain", "velocity"])
@pytest.mark.parametrize("kind", ["solid", "flat", "on obstacles", "cut"])
def test_a_file_has_the_triangles_and_colors_of_pictures(msdwarp, tmp_path, to, color, kind):
    colliders = [Sphere((0.0, 0.1, 2.0), 0.12)] if kind == "on obstacles" else []
    kinds = FLAT if kind == "flat" else KINDS
    scene = scene_of(kinds, "torn sheet" if color is None else None, colliders)
    times, positions = stored(tmp_path / "a.vtkhdf", scene, in_a_row(kinds), color)
    flags, cut = (("--cut", "0,-1,0,0.03"), Plane((0, -1, 0), 0.03)) if kind == "cut" else ((), None)
    code, _, err = msdwarp("export", "a.vtkhdf", "--to", to, *flags)
    assert (code, err) == (0, "")
    scene = replace(scene, look=replace(scene.look, full_strain=0.3, cut=cut))
    for k, (time, position) in enumerate(zip(times, positions, strict=True)):
        coloring, values = color or "texture", None
        if color == "velocity":  # which is written as the positions; the scale ends at most of the largest
            speeds = [np.linalg.norm(each.astype(float), axis=1) for each in positions]
            full = round_up(max(np.quantile(each, 0.99) for each in speeds))
            coloring, values = ColorScale("speed", full), speeds[k]
        ropes = to != "usd" or color is not None  # curves have one color
        corners, colors = triangles_in_pictures(scene, position, time, coloring, values, ropes=ropes)
        if to in ("usd", "glb"):
            found = {"usd": read_usd, "glb": read_glb}[to](tmp_path / f"a.{to}", k)
        else:
            found = read_by_vtk(tmp_path / f"a_{k:04d}.{to}")
        drawn, *paint = with_area(*(each for each in found[:2] if each is not None))
        # Files have the triangles body by body. Further frames of glb are differences, rounded to float32.
        apart, order = cKDTree(drawn.reshape(-1, 9)).query(corners.reshape(-1, 9))
        assert apart.max(initial=0.0) < 1e-5
        np.testing.assert_array_equal(np.sort(order), np.arange(len(drawn)))
        paint = [each[order] for each in paint]
        if color is None and to in ("glb", "usd"):
            ((name, image),) = found[2]
            assert name.replace("_", " ") == "torn sheet"
            np.testing.assert_array_equal(image, gingham("#c03020", "#f4f1e8"))
        if paint:
            plain = np.isfinite(colors)
            np.testing.assert_allclose(paint[0][plain], colors[plain], atol=0.003)  # of 256 steps


@pytest.mark.parametrize("to", ["obj", "stl", "ply", "glb", "usd"])
def test_of_what_is_all_dust_a_file_has_no_triangles(msdwarp, tmp_path, to):
    cube = box((3, 3, 3), 0.1)
    scene = Scene(system=cube.replace(broken_at=BROKE))
    stored(tmp_path / "a.vtkhdf", scene, [cube], None)
    code, _, err = msdwarp("export", "a.vtkhdf", "--to", to, "--frame", "1")
    assert (code, err) == (0, "")
    path = tmp_path / f"a.{to}"
    if to == "glb":
        assert json.loads(path.read_bytes()[20:]).keys() == {"asset", "scene", "scenes"}
    elif to == "usd":
        assert len(read_usd(path, 1)[0]) == 0
    else:
        assert pv.read(path).n_cells == 0
