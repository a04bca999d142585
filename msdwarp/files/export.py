"""Export: a trajectory's frames in the formats of other programs."""

import base64
import importlib.util
import json
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import in_space
from ..disk import failure_named, replacing, reserve
from .trajectory import Trajectory


def export(
    trajectory: Trajectory,
    path: str | Path,
    to: str,
    frames: int | slice | Sequence[int] = slice(None),
    *,
    force: bool = False,
    draw_usd: Callable[[Path, list[int], Path], None] | None = None,
) -> list[Path]:
    """Write frames in another format: the surface, or the connections if there is none. Return the files.

    For obj, stl, ply and gltf each frame is a file, `cube_0012.obj` for frame 12; usd and npz (positions,
    velocities, times and connections) have one file for all. `draw_usd` writes a usd file: its arguments are
    the folder for images, the frames' indices, and the path. Raise ValueError if the format is unknown, is not
    the path's suffix, cannot store the body, or needs a missing package, or if a frame does not exist. Raise
    FileExistsError if a file exists and `force` is False. Each file is written whole or not at all.
    """
    path = Path(path)
    checks.one_of("to", to, (*_MESHES, *_WHOLE))
    if path.suffix != f".{to}":
        raise ValueError(f"path is {path}; it must end in .{to}, as the format does")
    if to != "npz" and trajectory.system.surface is None and not trajectory.system.connection_count:
        raise ValueError("the trajectory has neither a surface nor connections: only npz can hold it")
    if to in ("stl", "ply") and trajectory.system.surface is None:
        raise ValueError(
            f"to is {to!r}, which holds triangles; without a surface it must be obj, gltf, usd or npz"
        )
    if to == "usd" and draw_usd is None:
        raise ValueError("draw_usd is None; where to is 'usd' it must be a function that writes the file")
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
            if to == "usd" and draw_usd is not None:
                draw_usd(textures, numbers, unfinished)
            else:
                _npz(trajectory, numbers, unfinished)
        return paths
    for one, (points, cells, uv) in zip(paths, _shown(trajectory, numbers), strict=True):
        with failure_named(one), replacing(one) as unfinished:
            _MESHES[to](unfinished, points, cells, uv)
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


def _shown(trajectory: Trajectory, numbers: Iterable[int]) -> Iterator[tuple[NDArray, NDArray, NDArray | None]]:
    """Yield, frame by frame, points [m], cells of two or three points, and texture coordinates."""
    surface, connections = trajectory.system.surface, trajectory.system.connections
    for k in numbers:
        position = finite_values(trajectory, k, "position")
        if surface is None:
            yield in_space(position), connections, None
        else:
            yield in_space(surface.points(position)), surface.triangles, surface.uv


def finite_values(trajectory: Trajectory, k: int, name: str) -> NDArray:
    """Return positions or velocities in frame k; raise ValueError if an entry is not finite."""
    values: NDArray = getattr(trajectory.frame(k), name)
    checks.every(f"frame {k} of {trajectory.path} is damaged: {name}", values, np.isfinite(values), "finite")
    return values


def _by_pyvista(path: Path, points: NDArray, cells: NDArray, uv: NDArray | None) -> None:
    import pyvista as pv

    counted = np.insert(cells, 0, cells.shape[1], axis=1).ravel()
    mesh = pv.PolyData(points, faces=counted) if cells.shape[1] == 3 else pv.PolyData(points, lines=counted)
    if uv is not None:
        mesh.active_texture_coordinates = uv.astype(np.float32)
    # VTK does not report a full disk, so room for long lines of text is reserved first.
    with path.open("wb") as file:
        reserve(file.fileno(), 0, 200 * (mesh.n_points + mesh.n_cells), path.parent)
    mesh.save(path)


def _gltf(path: Path, points: NDArray, cells: NDArray, uv: NDArray | None) -> None:
    vertices, corners = points.astype("<f4").tobytes(), cells.astype("<u4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(vertices + corners).decode()
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    shape = {"attributes": {"POSITION": 0}, "indices": 1, "mode": 4 if cells.shape[1] == 3 else 1}
    document = {
        "asset": {"version": "2.0", "generator": "msdwarp"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [-(0.5**0.5), 0, 0, 0.5**0.5]}],  # a quarter turn: in glTF y is up
        "meshes": [{"primitives": [shape]}],
        "buffers": [{"uri": uri, "byteLength": len(vertices + corners)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(vertices), "target": 34962},
            {"buffer": 0, "byteOffset": len(vertices), "byteLength": len(corners), "target": 34963},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3", **bounds},
            {"bufferView": 1, "componentType": 5125, "count": cells.size, "type": "SCALAR"},
        ],
    }
    path.write_text(json.dumps(document))


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
