"""USD: meshes and ropes that move, materials, a camera and lights, for Blender and other programs."""

# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
# USD is optional, and its modules are compiled and have no types.

from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .drawn import DrawnFrame, DrawnMesh, free_name, linear

HORIZONTAL_APERTURE = 36.0
"""Width of the camera's film [mm], as in a photo camera."""
SUN, SKY = 0.5, 0.6
"""Intensities of the lights: a key light from one direction, and the sky from all directions."""
NEAREST = 1e-4
"""Least distance that the camera shows, over the largest: a ground reaches behind the camera."""
SUN_ANGLE = 5.7
"""Angular width of the key light [degrees], as in pictures (`pictures.light.SOFTNESS`)."""


def write_usd(
    path: Path,
    fps: float,
    numbers: Sequence[int],
    frames: Iterable[DrawnFrame],
    *,
    up: str,
    scale: float,
    textures: Path,
    view_angle: float,
    aspect: float,
    sun: NDArray,
    background: NDArray,
) -> None:
    """Write a scene with frames to a USD file; time codes are frame indices.

    The axis `up` points up, and a metre is `scale` units. Ropes are curves. Velocities of bodies are stored for
    motion blur. Images go into the folder `textures` beside the file. `view_angle` is the vertical angle of view
    [degrees], `aspect` the picture's width over its height, `sun` a unit vector towards the key light, and
    `background` the sky's sRGB color, in 0 … 1.
    """
    from pxr import Gf, Usd, UsdGeom, UsdLux

    path.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, getattr(UsdGeom.Tokens, up))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0 / scale)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(min(numbers))
    stage.SetEndTimeCode(max(numbers))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/scene").GetPrim())

    camera = UsdGeom.Camera.Define(stage, "/scene/camera")
    height = HORIZONTAL_APERTURE / aspect
    camera.CreateHorizontalApertureAttr(HORIZONTAL_APERTURE)
    camera.CreateVerticalApertureAttr(height)
    camera.CreateFocalLengthAttr(height / 2 / np.tan(np.radians(view_angle) / 2))
    placed = camera.AddTransformOp()
    light = UsdLux.DistantLight.Define(stage, "/scene/sun")
    light.CreateIntensityAttr(SUN)
    light.CreateAngleAttr(SUN_ANGLE)
    light.CreateNormalizeAttr(True)  # otherwise a smaller sun is weaker
    light.AddOrientOp().Set(Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, sun))).GetQuat()))
    sky = UsdLux.DomeLight.Define(stage, "/scene/sky")
    sky.CreateIntensityAttr(SKY)
    sky.CreateColorAttr(Gf.Vec3f(*map(float, linear(background))))

    names, shapes, depths = set[str](), list[Any](), list[float]()
    for k, (meshes, view) in zip(numbers, frames, strict=True):
        first = not shapes
        shapes = shapes or [_defined(stage, mesh, _free_name(mesh.name, names), textures) for mesh in meshes]
        for mesh, shape in zip(meshes, shapes, strict=True):
            depth = (view[3] - mesh.points) @ view[2]
            depths += [depth.min(), depth.max()]
            if first or mesh.moves:
                _set_frame(shape, mesh, k if mesh.moves else Usd.TimeCode.Default(), first)
        placed.Set(Gf.Matrix4d(*np.column_stack([view, [0, 0, 0, 1]]).ravel().tolist()), k)
    far = 1.1 * max(depths)
    camera.CreateClippingRangeAttr(Gf.Vec2f(max(0.9 * min(depths), NEAREST * far), far))
    stage.Save()


def _defined(stage: Any, mesh: DrawnMesh, name: str, textures: Path) -> Any:
    """Return a new mesh or, of a rope, new curves of a stage, with material and color."""
    from pxr import Sdf, UsdGeom, Vt

    at, tokens = f"/scene/{name}", UsdGeom.Tokens
    if mesh.radius:
        shape = UsdGeom.BasisCurves.Define(stage, at)
        shape.CreateTypeAttr(tokens.linear)
        shape.CreateWidthsAttr(Vt.FloatArray([2 * mesh.radius]))
        shape.SetWidthsInterpolation(tokens.constant)
    else:
        shape = UsdGeom.Mesh.Define(stage, at)
        shape.CreateSubdivisionSchemeAttr(tokens.none)
        shape.CreateDoubleSidedAttr(True)
        shape.SetNormalsInterpolation(tokens.vertex)
    colors = shape.CreateDisplayColorPrimvar(tokens.constant if mesh.color.ndim == 1 else tokens.vertex)
    colors.Set(_vectors(Vt, linear(np.atleast_2d(mesh.color))))
    if mesh.texture is not None:
        textures.mkdir(exist_ok=True)
        Image.fromarray(np.ascontiguousarray(mesh.texture)).save(textures / f"{name}.png")
    if not mesh.radius:
        st = UsdGeom.PrimvarsAPI(shape).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, tokens.vertex)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv, dtype=np.float32)))
    _bind_material(stage, shape, name, mesh, f"./{textures.name}/{name}.png")
    return shape


def _set_frame(shape: Any, mesh: DrawnMesh, time: Any, first: bool) -> None:
    """Set what a mesh or a rope has in a frame; what no frame changes, in the first alone."""
    from pxr import Usd, Vt

    points, velocities, low, high = mesh.points, mesh.velocities, mesh.points.min(axis=0), mesh.points.max(axis=0)
    shown, parts = mesh.triangles, Usd.TimeCode.Default()
    if mesh.visible is not None:
        shown, parts = mesh.triangles[mesh.visible], time
    if mesh.radius:
        lines = polylines(shown)
        order = np.concatenate([np.zeros(0, int), *lines])
        points, low, high = points[order], low - mesh.radius, high + mesh.radius
        velocities = None if velocities is None else velocities[order]
        if first or mesh.visible is not None:
            shape.CreateCurveVertexCountsAttr().Set(Vt.IntArray([len(line) for line in lines]), parts)
    elif first or mesh.visible is not None:
        shape.CreateFaceVertexCountsAttr().Set(Vt.IntArray([3] * len(shown)), parts)
        shape.CreateFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(shown.ravel())), parts)
    shape.CreatePointsAttr().Set(_vectors(Vt, points), time)
    shape.CreateExtentAttr().Set(_vectors(Vt, np.array([low, high])), time)
    if velocities is not None:
        shape.CreateVelocitiesAttr().Set(_vectors(Vt, velocities), time)
    if mesh.normals is not None:
        shape.CreateNormalsAttr().Set(_vectors(Vt, mesh.normals), time)
    if mesh.color.ndim > 1:
        shape.GetDisplayColorAttr().Set(_vectors(Vt, linear(mesh.color)), time)


def polylines(springs: NDArray[np.int32]) -> list[NDArray[np.intp]]:
    """Return springs, shape [any, 2], joined to lines of points, each from an end or a fork to the next."""
    beside: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for k, (one, other) in enumerate(springs.tolist()):
        beside[one].append((other, k))
        beside[other].append((one, k))
    lines, used = [], [False] * len(springs)
    ends = [point for point, around in beside.items() if len(around) != 2]
    for start in (*ends, *beside):  # what is left after the ends are loops
        for at, k in beside[start]:
            if used[k]:
                continue
            used[k], line = True, [start, at]
            while len(beside[at]) == 2 and (further := [one for one in beside[at] if not used[one[1]]]):
                at, k = further[0]
                used[k] = True
                line.append(at)
            lines.append(np.array(line))
    return lines


def _vectors(Vt: Any, values: NDArray) -> Any:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def _free_name(wanted: str, taken: set[str]) -> str:
    """Return a name allowed by USD that is not taken yet, and add it to `taken`."""
    from pxr import Tf

    taken.add(name := free_name(Tf.MakeValidIdentifier(wanted), taken | {"camera", "sun", "sky", "materials"}))
    return name


def _bind_material(stage: Any, shape: Any, name: str, mesh: DrawnMesh, image: str) -> None:
    """Give a mesh a material with its texture or vertex colors."""
    from pxr import Sdf, UsdShade

    types, at = Sdf.ValueTypeNames, f"/scene/materials/{name}"
    material = UsdShade.Material.Define(stage, at)
    surface = UsdShade.Shader.Define(stage, f"{at}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", types.Float).Set(mesh.roughness)
    surface.CreateInput("metallic", types.Float).Set(mesh.metallic)
    surface.CreateInput("opacity", types.Float).Set(mesh.opacity)
    surface.CreateInput("specular", types.Float).Set(0.5 * min(1.0, 2 * mesh.gloss))
    seen = surface.CreateInput("diffuseColor", types.Color3f)
    reader = UsdShade.Shader.Define(stage, f"{at}/reader")
    if mesh.texture is None:
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateInput("varname", types.String).Set("displayColor")
        seen.ConnectToSource(reader.CreateOutput("result", types.Float3))
    else:
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", types.String).Set("st")
        picture = UsdShade.Shader.Define(stage, f"{at}/image")
        picture.CreateIdAttr("UsdUVTexture")
        picture.CreateInput("file", types.Asset).Set(image)
        for way in ("wrapS", "wrapT"):
            picture.CreateInput(way, types.Token).Set("repeat")
        picture.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
        seen.ConnectToSource(picture.CreateOutput("rgb", types.Float3))
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)
