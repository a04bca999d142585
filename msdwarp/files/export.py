"""Export: a trajectory's frames in the formats of other programs."""

import importlib.util
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..disk import reserve, writing
from .drawn import UP, DrawnFrame, DrawnMesh, material_names, placed
from .gltf import write_glb
from .obj import write_mtl, write_obj
from .trajectory import Trajectory
from .usd import write_usd


def export(
    trajectory: Trajectory,
    path: str | Path,
    to: str,
    frames: int | slice | Sequence[int] = slice(None),
    *,
    up: str | None = None,
    scale: float = 1.0,
    force: bool = False,
    draw: Callable[[list[int], str], tuple[Iterable[DrawnFrame], dict[str, Any]]] | None = None,
) -> list[Path]:
    """Write frames in another format, with the triangles and colors of pictures. Return the files with frames.

    For obj, stl and ply each frame is a file, `cube_0012.obj` for frame 12, with the bodies; glb, with obstacles
    too, usd, with the whole scene, and npz (positions, velocities, times and connections) have one file for all.
    Beside it obj has a file of materials, and obj and usd a folder of images. All but npz need `draw`, which takes
    the frames' indices and the format; it returns the frames, and arguments of `write_usd`. `up` is the axis that
    points up, "y" or "z", by default y in glb and z in all others; lengths are in metres, multiplied by `scale`.
    npz has positions as simulated.

    Raise ValueError if the format is unknown, is not the path's suffix, or needs a missing package or `draw`, if a
    frame does not exist, or if `up` or `scale` is out of range. Raise FileExistsError if a file exists and `force`
    is False. Each file is written whole or not at all.
    """
    path = Path(path)
    checks.one_of("to", to, (*_MESHES, *_WHOLE))
    if path.suffix != f".{to}":
        raise ValueError(f"path is {path}; it must end in .{to}, as the format does")
    if to != "npz" and draw is None:
        raise ValueError(f"draw is None; where to is {to!r} it must be a function that draws frames")
    if to == "usd" and importlib.util.find_spec("pxr") is None:
        raise ValueError("to is 'usd', which needs the extra `usd`: pip install 'msdwarp[usd]'")
    checks.one_of("up", up, (None, *UP))
    checks.positive("scale", scale)
    if to == "npz" and (up, scale) != (None, 1.0):
        raise ValueError("up or scale is given; where to is 'npz' they must not be: it holds what was simulated")
    up = up or ("y" if to == "glb" else "z")
    numbers = _numbers(frames, len(trajectory))
    paths = [path]
    if to in _MESHES and not isinstance(frames, int):
        paths = [path.with_name(f"{path.stem}_{k:04d}{path.suffix}") for k in numbers]
    textures, library = path.with_name(f"{path.stem}_textures"), path.with_suffix(".mtl")
    beside = {"usd": [textures], "obj": [library, textures]}.get(to, [])
    for one in (*paths, *beside):
        if one.exists() and not force:
            raise FileExistsError(f"path is {one}, which exists; name another file or add --force")
    path.parent.mkdir(parents=True, exist_ok=True)
    if to == "npz":
        with writing(path) as unfinished:
            _npz(trajectory, numbers, unfinished)
        return paths
    assert draw is not None
    drawn, stage = draw(numbers, to)
    drawn = (placed(frame, up, scale) for frame in drawn)
    if to in _WHOLE:
        with writing(path) as unfinished:
            if to == "usd":
                stage = {**stage, "sun": stage["sun"] @ UP[up]}
                about = {"textures": textures, "up": up, "scale": scale}
                write_usd(unfinished, trajectory.fps, numbers, drawn, **about, **stage)
            else:
                moving = (meshes if len(numbers) > 1 else _shown(meshes) for meshes, _ in drawn)
                write_glb(unfinished, trajectory.times[numbers].tolist(), moving)
        return paths
    for k, (one, (meshes, _)) in enumerate(zip(paths, drawn, strict=True)):
        names = material_names(meshes)
        with writing(one) as unfinished:
            if to == "obj":
                write_obj(unfinished, _shown(meshes), names, library.name)
            else:
                _by_pyvista(unfinished, _shown(meshes))
        if to == "obj" and not k:  # all frames have the same materials
            with writing(library) as unfinished:
                write_mtl(unfinished, {names[mesh.material]: mesh for mesh in meshes}, textures)
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


def _shown(meshes: Sequence[DrawnMesh]) -> list[DrawnMesh]:
    """Return the meshes without what is hidden."""
    return [mesh.seen for mesh in meshes if mesh.visible is None or mesh.visible.any()]


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
        paint["texture"] = (255 * _joined([mesh.vertex_colors for mesh in meshes], 3) + 0.5).astype(np.uint8)
    # VTK does not report a full disk, so room for long lines of text is reserved first.
    with path.open("wb") as file:
        reserve(file.fileno(), 0, 200 * (whole.n_points + whole.n_cells), path.parent)
    whole.save(path, **paint)


def _joined(arrays: list[NDArray], width: int) -> NDArray:
    return np.concatenate([np.zeros((0, width)), *arrays])


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


_MESHES = ("obj", "stl", "ply")
"""Formats with one file per frame."""
_WHOLE = ("glb", "usd", "npz")
"""Formats with one file for all frames."""
