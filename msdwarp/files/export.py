"""Export: a trajectory's frames in the formats of other programs."""

import base64
import importlib.util
import io
import json
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..disk import failure_named, replacing, reserve
from .trajectory import Trajectory
from .usd import DrawnFrame, DrawnMesh, linear, write_usd


def export(
    trajectory: Trajectory,
    path: str | Path,
    to: str,
    frames: int | slice | Sequence[int] = slice(None),
    *,
    force: bool = False,
    draw: Callable[[list[int], bool], tuple[Iterable[DrawnFrame], dict[str, Any]]] | None = None,
) -> list[Path]:
    """Write frames in another format, with the triangles and colors of pictures. Return the files.

    For obj, stl, ply and gltf each frame is a file, `cube_0012.obj` for frame 12, with the bodies; usd, with the
    whole scene, and npz (positions, velocities, times and connections) have one file for all. All but npz need
    `draw`, which takes the frames' indices, and whether to draw the whole scene or the bodies alone; it returns
    the frames, and arguments of `write_usd`.

    Raise ValueError if the format is unknown, is not the path's suffix, or needs a missing package or `draw`, or
    if a frame does not exist. Raise FileExistsError if a file exists and `force` is False. Each file is written
    whole or not at all.
    """
    path = Path(path)
    checks.one_of("to", to, (*_MESHES, *_WHOLE))
    if path.suffix != f".{to}":
        raise ValueError(f"path is {path}; it must end in .{to}, as the format does")
    if to != "npz" and trajectory.system.surface is None and not trajectory.system.connection_count:
        raise ValueError("the trajectory has neither a surface nor connections: only npz can hold it")
    if to != "npz" and draw is None:
        raise ValueError(f"draw is None; where to is {to!r} it must be a function that draws frames")
    if to == "usd" and importlib.util.find_spec("pxr") is None:
        raise ValueError("to is 'usd', which needs the extra `usd`: pip install 'msdwarp[usd]'")
    numbers = _numbers(frames, len(trajectory))
    paths = [path]
    if to in _MESHES and not isinstance(frames, int):
        paths = [path.with_name(f"{path.stem}_{k:04d}{path.suffix}") for k in numbers]
    textures = path.with_name(f"{path.stem}_textures")
    for one in (*paths, *([textures] if to == "usd" else [])):
        if one.exists() and not force:
            raise FileExistsError(f"path is {one}, which exists; name another file or add --force")
    path.parent.mkdir(parents=True, exist_ok=True)
    if to in _WHOLE:
        with failure_named(path), replacing(path) as unfinished:
            if draw is not None and to == "usd":
                drawn, stage = draw(numbers, True)
                write_usd(unfinished, trajectory.fps, numbers, drawn, textures=textures, **stage)
            else:
                _npz(trajectory, numbers, unfinished)
        return paths
    assert draw is not None
    for one, (meshes, _) in zip(paths, draw(numbers, False)[0], strict=True):
        with failure_named(one), replacing(one) as unfinished:
            _MESHES[to](unfinished, [_seen(mesh) for mesh in meshes if mesh.visible is None or mesh.visible.any()])
    return paths


def _numbers(frames: int | slice | Sequence[int], count: int) -> list[int]:
    """Return the indices of frames; negative ones, which count from the end, are converted to positive ones."""
    if not count:
        raise ValueError("the trajectory has no frames to export")
    try:
        numbers = np.atleast_1d(np.arange(count)[frames]).tolist()
    except IndexError as error:
        raise ValueError(f"frames is {frames}; the trajectory has {count}: 0 to {count - 1}") from error
    if not numbers:
        raise ValueError(f"frames is {frames}; none of the {count} frames is among it")
    return numbers


def _seen(mesh: DrawnMesh) -> DrawnMesh:
    """Return a mesh without what is hidden, with colors at its vertices."""
    triangles = mesh.triangles if mesh.visible is None else mesh.triangles[mesh.visible]
    used, triangles = np.unique(triangles, return_inverse=True)
    color = np.broadcast_to(mesh.color, mesh.points.shape)[used]
    triangles = triangles.reshape(-1, 3)
    return mesh._replace(points=mesh.points[used], uv=mesh.uv[used], color=color, triangles=triangles)


def finite_values(trajectory: Trajectory, k: int, name: str) -> NDArray:
    """Return positions or velocities in frame k; raise ValueError if an entry is not finite."""
    values: NDArray = getattr(trajectory.frame(k), name)
    checks.every(f"frame {k} of {trajectory.path} is damaged: {name}", values, np.isfinite(values), "finite")
    return values


def _by_pyvista(path: Path, meshes: Sequence[DrawnMesh]) -> None:
    import pyvista as pv

    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    points = _joined([mesh.points for mesh in meshes], 3)
    triangles = _joined([mesh.triangles + k for mesh, k in zip(meshes, first, strict=False)], 3)
    whole = pv.PolyData.from_regular_faces(points, triangles.astype(int))
    whole.active_texture_coordinates = _joined([mesh.uv for mesh in meshes], 2).astype(np.float32)
    paint: dict[str, Any] = {}
    if path.suffix == ".ply" and meshes:
        paint["texture"] = (255 * _joined([_colors(mesh) for mesh in meshes], 3) + 0.5).astype(np.uint8)
    # VTK does not report a full disk, so room for long lines of text is reserved first.
    with path.open("wb") as file:
        reserve(file.fileno(), 0, 200 * (whole.n_points + whole.n_cells), path.parent)
    whole.save(path, **paint)


def _joined(arrays: list[NDArray], width: int) -> NDArray:
    return np.concatenate([np.zeros((0, width)), *arrays])


def _colors(mesh: DrawnMesh) -> NDArray:
    """Return the colors of a mesh at its vertices, of a texture too, in 0 … 1, shape [vertex_count, 3]."""
    if (image := mesh.texture) is None:
        return mesh.color
    size = np.array(image.shape[1::-1])
    column, row = np.clip(size * ([0.0, 1.0] + [1, -1] * mesh.uv), 0, size - 1).astype(int).T
    return image[row, column] / 255


def _gltf(path: Path, meshes: Sequence[DrawnMesh]) -> None:
    """Write meshes, each with a material: a texture, or colors at the vertices."""
    buffers, views, accessors, primitives, materials, images = (list[Any]() for _ in range(6))

    def stored(values: NDArray, kind: str, **more: Any) -> int:
        """Add an array; return the number of its accessor."""
        number, whole = len(buffers), kind == "SCALAR"
        data = values.astype("<u4" if whole else "<f4").tobytes()
        buffers.append({"uri": _data_uri("application/octet-stream", data), "byteLength": len(data)})
        views.append({"buffer": number, "byteLength": len(data), "target": 34963 if whole else 34962})
        accessor = {"bufferView": number, "componentType": 5125 if whole else 5126, "type": kind}
        accessors.append({**accessor, "count": len(values), **more})
        return number

    for k, mesh in enumerate(meshes):
        low, high = mesh.points.min(axis=0).tolist(), mesh.points.max(axis=0).tolist()
        attributes = {"POSITION": stored(mesh.points, "VEC3", min=low, max=high)}
        indices = stored(mesh.triangles.ravel(), "SCALAR")
        paint: dict[str, Any] = {"metallicFactor": mesh.metallic, "roughnessFactor": mesh.roughness}
        paint["baseColorFactor"] = [1.0, 1.0, 1.0, mesh.opacity]
        if mesh.texture is None:
            attributes["COLOR_0"] = stored(linear(mesh.color), "VEC3")
        else:
            attributes["TEXCOORD_0"] = stored(np.array([0.0, 1.0]) + [1, -1] * mesh.uv, "VEC2")  # from the top
            paint["baseColorTexture"] = {"index": len(images)}
            Image.fromarray(np.ascontiguousarray(mesh.texture)).save(png := io.BytesIO(), "png")
            images.append({"uri": _data_uri("image/png", png.getvalue())})
        blend = "OPAQUE" if mesh.opacity == 1 else "BLEND"
        shade = {"name": mesh.name, "pbrMetallicRoughness": paint, "alphaMode": blend, "doubleSided": True}
        materials.append(shade)
        primitives.append({"attributes": attributes, "indices": indices, "material": k})
    document = {
        "nodes": [{"mesh": 0, "rotation": [-(0.5**0.5), 0, 0, 0.5**0.5]}],  # a quarter turn: in glTF y is up
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "textures": [{"source": k} for k in range(len(images))],
        "images": images,
        "buffers": buffers,
        "bufferViews": views,
        "accessors": accessors,
    }
    document = {name: values for name, values in document.items() if values and meshes}  # none may be empty
    scene = {"scene": 0, "scenes": [{"nodes": [0]} if meshes else {}]}
    path.write_text(json.dumps({"asset": {"version": "2.0", "generator": "msdwarp"}, **scene, **document}))


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64," + base64.b64encode(data).decode()


def _npz(trajectory: Trajectory, numbers: list[int], path: Path) -> None:
    """Write frames as NumPy arrays; one frame is in memory at a time."""
    system = trajectory.system
    arrays: dict[str, Any] = {"times": trajectory.times[numbers], "connections": system.connections}
    if system.surface is not None and system.surface.weights is None:
        arrays["triangles"] = system.surface.particle[system.surface.triangles]
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(values))
        for plural, name in (("positions", "position"), ("velocities", "velocity")):
            values = getattr(trajectory, plural)
            shape = (len(numbers), *values.shape[1:])
            header = {"descr": np.lib.format.dtype_to_descr(values.dtype), "fortran_order": False, "shape": shape}
            with archive.open(f"{plural}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_2_0(file, header)
                for k in numbers:
                    file.write(np.ascontiguousarray(finite_values(trajectory, k, name)).tobytes())


_MESHES = {"obj": _by_pyvista, "stl": _by_pyvista, "ply": _by_pyvista, "gltf": _gltf}
"""Formats with one file per frame, by name."""
_WHOLE = ("usd", "npz")
"""Formats with one file for all frames."""
