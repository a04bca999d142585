"""USD: meshes that move, materials, a camera and lights, for Blender and other programs."""

# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
# USD is optional, and its modules are compiled and have no types.

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

HORIZONTAL_APERTURE = 36.0
"""Width of the camera's film [mm], as in a photo camera."""
SUN, SKY = 0.5, 0.6
"""Intensities of the lights: a key light from one direction, and the sky from all directions."""
NEAREST = 1e-4
"""Least distance that the camera shows, over the largest: a ground reaches behind the camera."""
SUN_ANGLE = 5.7
"""Angular width of the key light [degrees], as in pictures (`pictures.light.SOFTNESS`)."""


class DrawnMesh(NamedTuple):
    """A mesh in a frame, as pictures show it. Its `points`, `normals`, `color` and `visible` may change."""

    name: str
    points: NDArray
    """Vertices [m], shape [vertex_count, 3]."""
    normals: NDArray | None
    """Unit normals at the vertices; None for the normals of triangles."""
    triangles: NDArray[np.int32]
    """Vertices of each triangle, shape [triangle_count, 3]."""
    uv: NDArray
    """Texture coordinates of the vertices, shape [vertex_count, 2]."""
    color: NDArray
    """sRGB in 0 … 1, shape [3] or, if it may change, [vertex_count, 3]."""
    texture: NDArray[np.uint8] | None = None
    gloss: float = 0.0
    roughness: float = 0.9
    """Parameter of UsdPreviewSurface, like the next two, 0 … 1."""
    metallic: float = 0.0
    opacity: float = 1.0
    moves: bool = False
    visible: NDArray[np.bool_] | None = None
    """Whether each triangle is visible, shape [triangle_count]; None if all are in all frames."""


DrawnFrame = tuple[list[DrawnMesh], NDArray]
"""The meshes, and the camera. Its rows: right, up and back, and its position [m]; shape [4, 3]."""


def write_usd(
    path: Path,
    fps: float,
    numbers: Sequence[int],
    frames: Iterable[DrawnFrame],
    *,
    textures: Path,
    view_angle: float,
    aspect: float,
    sun: NDArray,
    background: NDArray,
) -> None:
    """Write a scene with frames to a USD file, in metres, z up; time codes are frame indices.

    Images go into the folder `textures` beside the file. `view_angle` is the vertical angle of view [degrees],
    `aspect` the picture's width over its height. `sun` is a unit vector towards the key light. `background` is
    the sky's sRGB color, in 0 … 1.
    """
    from pxr import Gf, Usd, UsdGeom, UsdLux, Vt

    path.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
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
        for mesh, (shape, colors) in zip(meshes, shapes, strict=True):
            depth = (view[3] - mesh.points) @ view[2]
            depths += [depth.min(), depth.max()]
            if not (first or mesh.moves):
                continue
            time = k if mesh.moves else Usd.TimeCode.Default()
            shape.CreatePointsAttr().Set(_vectors(Vt, mesh.points), time)
            corners = np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)])
            shape.CreateExtentAttr().Set(_vectors(Vt, corners), time)
            if mesh.normals is not None:
                shape.CreateNormalsAttr().Set(_vectors(Vt, mesh.normals), time)
            if mesh.color.ndim > 1:
                colors.Set(_vectors(Vt, linear(mesh.color)), time)
            if mesh.visible is not None:
                faces = np.ascontiguousarray(mesh.triangles[mesh.visible].ravel())
                shape.GetFaceVertexCountsAttr().Set(Vt.IntArray([3] * (len(faces) // 3)), time)
                shape.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(faces), time)
        placed.Set(Gf.Matrix4d(*np.column_stack([view, [0, 0, 0, 1]]).ravel().tolist()), k)
    far = 1.1 * max(depths)
    camera.CreateClippingRangeAttr(Gf.Vec2f(max(0.9 * min(depths), NEAREST * far), far))
    stage.Save()


def _defined(stage: Any, mesh: DrawnMesh, name: str, textures: Path) -> tuple[Any, Any]:
    """Return a new mesh of a stage, with its material, and its colors."""
    from pxr import Sdf, UsdGeom, Vt

    shape = UsdGeom.Mesh.Define(stage, f"/scene/{name}")
    shape.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(mesh.triangles)))
    shape.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(mesh.triangles.ravel())))
    shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    shape.CreateDoubleSidedAttr(True)
    shape.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    constant = mesh.color.ndim == 1
    colors = shape.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant if constant else UsdGeom.Tokens.vertex)
    colors.Set(_vectors(Vt, linear(np.atleast_2d(mesh.color))))
    if mesh.texture is not None:
        textures.mkdir(exist_ok=True)
        Image.fromarray(np.ascontiguousarray(mesh.texture)).save(textures / f"{name}.png")
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        st = UsdGeom.PrimvarsAPI(shape).CreatePrimvar("st", kind, UsdGeom.Tokens.vertex)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv, dtype=np.float32)))
    _bind_material(stage, shape, name, mesh, f"./{textures.name}/{name}.png")
    return shape, colors


def linear(color: NDArray) -> NDArray:
    """Return linear colors, as in USD and glTF, given sRGB colors, both in 0 … 1 (IEC 61966-2-1)."""
    return np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)


def _vectors(Vt: Any, values: NDArray) -> Any:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def _free_name(wanted: str, taken: set[str]) -> str:
    """Return a name allowed by USD that is not taken yet, and add it to `taken`."""
    from pxr import Tf

    base = name = Tf.MakeValidIdentifier(wanted)
    k = 1
    while name in taken | {"camera", "sun", "sky"}:
        k += 1
        name = f"{base}_{k}"
    taken.add(name)
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
