"""Bodies from the files of mesh generators and finite-element codes."""

from __future__ import annotations

import importlib
import io
import math
import re
import warnings
from contextlib import redirect_stderr, redirect_stdout
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Material, System
from .meshes import from_mesh

_BY_PYVISTA = frozenset((".vtu", ".vtk", ".vtp", ".stl", ".ply", ".obj"))
"""Suffixes of files that PyVista reads itself."""
_CORNERS = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5}
"""Corners of cells, by meshio's name without the number of points, in the order of VTK's Lagrange cells."""
_STRAIGHT, _LAGRANGE = (3, 5, 9, 10, 12, 13, 14), 68
"""VTK's numbers of these cells with straight edges; of the first of its Lagrange cells, before those of Bézier."""
_SECOND = (
    *("line3", "triangle6", "triangle7", "quad8", "quad9", "tetra10"),
    *("hexahedron20", "hexahedron24", "hexahedron27", "wedge15", "wedge18", "pyramid13"),
)
"""meshio's names of cells of second order that VTK has, too."""
_BYTES: dict[str, int] = {
    **dict.fromkeys(["char", "uchar", "int8", "uint8"], 1),
    **dict.fromkeys(["short", "ushort", "int16", "uint16"], 2),
    **dict.fromkeys(["int", "uint", "float", "int32", "uint32", "float32"], 4),
    **dict.fromkeys(["double", "float64"], 8),
}
"""Bytes of a number in a .ply file, by its type."""
_NEAR = math.sqrt(3) / 2
"""A particle is in a group if its distance from the named part is at most this, in spacings: half a diagonal."""


def from_volume(
    mesh: Any,
    spacing: float | None = None,
    *,
    across: int | None = None,
    scale: float = 1.0,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a body that fills a mesh of solid cells, such as a mesh generator's file, with particles.

    The outer surface of the solid cells, or of the triangles if there are none, is filled as by `from_mesh`. Solid
    cells may be mirrored: each shows where its inside is. Cells of third and higher order are taken by their
    corners. The lattice represents the material exactly. Springs along the edges of the file's tetrahedra could
    not: fitted to a material as well as possible, bars of tetrahedra were up to 22 % too soft, and finer meshes
    were no better.

    Named parts of the file, such as Gmsh's physical groups or the sets of a .inp file, are groups of the body. A
    particle belongs to a part that is at most half a cell's diagonal away.

    Parameters
    ----------
    mesh
        The path of a file, or a PyVista mesh. Files except VTK's, .stl, .ply and .obj (such as .msh, .inp,
        .med, .mesh ...) are read by meshio: `pip install 'msdwarp[meshes]'`.
    spacing, across, neighbors, material, mass, total_mass, stiffness, damping
        As for `from_mesh`.
    scale
        Length of the file's unit [m]: 0.001 for millimetres.

    Raises
    ------
    ValueError
        If the file does not exist, cannot be read, or has no closed surface; or an argument is out of range.
    ModuleNotFoundError
        If the format needs meshio, which is not installed.
    """
    scale = checks.positive("scale", scale)
    if isinstance(mesh, str | PathLike):
        surface, parts = _read(Path(mesh))
    elif hasattr(mesh, "cast_to_unstructured_grid"):
        surface, parts = _outside(mesh), {}
    else:
        raise ValueError(f"mesh is a {type(mesh).__name__}; it must be the path of a file, or a PyVista mesh")
    surface = surface.scale(scale)
    constants = {"material": material, "mass": mass, "total_mass": total_mass}
    constants |= {"stiffness": stiffness, "damping": damping}
    try:
        body = from_mesh(surface, spacing, across=across, neighbors=neighbors, **constants)
    except ValueError as error:
        if not isinstance(mesh, str | PathLike) or not str(error).startswith("mesh "):
            raise
        raise ValueError(f"mesh is {str(mesh)!r}: {error}") from error
    edge = spacing if spacing is not None else float(np.ptp(surface.points, axis=0).max()) / (across or 1)
    groups = {}
    for name, part in parts.items():
        near = np.flatnonzero(_distances(part.scale(scale), body.position) <= _NEAR * edge)
        if len(near):
            groups[name] = near
    return body.replace(groups=groups)


def _read(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return (surface of the mesh, mesh of each named part by name).

    Readers raise, print and exit in many ways: all becomes one ValueError.
    """
    pyvista = importlib.import_module("pyvista")
    if not path.is_file():
        raise ValueError(f"mesh is {str(path)!r}; it must be the path of a mesh file, and there is none")
    meshio: Any = None
    if path.suffix.lower() not in _BY_PYVISTA:
        meshio = checks.imported("meshio", f"{path.suffix} files need meshio: pip install 'msdwarp[meshes]'")
    said, log = io.StringIO(), importlib.import_module("vtkmodules.vtkCommonCore").vtkLogger
    before = log.GetCurrentVerbosityCutoff()
    log.SetStderrVerbosity(log.VERBOSITY_OFF)
    try:
        caught = pyvista.VtkErrorCatcher(raise_errors=True, send_to_logging=False)
        with redirect_stdout(said), redirect_stderr(said), warnings.catch_warnings(action="ignore"), caught:
            if meshio is not None:
                grid, parts = _parts(_read_by(meshio, path))
            else:
                if path.suffix.lower() == ".ply":
                    _check_length(path.read_bytes())
                grid, parts = pyvista.get_reader(path).read(), {}
        return _outside(grid), parts
    except (Exception, SystemExit) as error:
        reason = repr(error) if isinstance(error, LookupError | AttributeError | TypeError) else str(error)
        if isinstance(error, SystemExit) or not reason:
            reason = said.getvalue().strip() or repr(error)
        if by_vtk := re.search(r"\(0x\w+\): (.*)", reason):
            reason = by_vtk[1]  # the first of its errors
        reason = " ".join(re.sub(r" \(0x\w+\)", "", reason).split())
        raise ValueError(f"mesh is {str(path)!r}, which cannot be read as a mesh: {reason}") from error
    finally:
        log.SetStderrVerbosity(before)


def _read_by(meshio: Any, path: Path) -> Any:
    """Return a file as a mesh of meshio, whose reader of NASTRAN files needs help."""
    if path.suffix.lower() not in (".bdf", ".fem", ".nas"):
        return meshio.read(path)
    text = re.sub(r"(?m)^[ \t]*,", "+,", path.read_text())  # lines of free format that continue the one before
    if "ENDDATA" not in text:  # meshio would wait for it
        raise ValueError("the file ends without ENDDATA")
    if not re.search(r"(?m)^[ \t]*BEGIN BULK", text):
        text = f"BEGIN BULK\n{text}"
    return meshio.read(io.StringIO(text), file_format="nastran")


def _check_length(ply: bytes) -> None:
    """Raise ValueError if a binary .ply file is shorter than its header says; VTK would end the process."""
    head, _, body = ply.partition(b"end_header\n")
    least = rows = 0
    for kind, *words in (line.split() for line in head.decode("latin-1").splitlines() if line.strip()):
        if kind == "element":
            rows = int(words[1])
        elif kind == "property":
            least += rows * (
                _BYTES.get(words[1], 1) + 3 * _BYTES.get(words[2], 1) if words[0] == "list" else _BYTES[words[0]]
            )
    if b"format ascii" not in head and len(body) < least:
        raise ValueError(f"the file ends after {len(body)} bytes of {least}")


def _parts(read: Any) -> tuple[Any, dict[str, Any]]:
    """Return (PyVista mesh of all cells, mesh of each named part by name) of `read`, a meshio mesh."""
    pyvista = importlib.import_module("pyvista")
    blocks = []
    for block in read.cells:
        name = block.type.rstrip("0123456789")
        straight = name in _CORNERS and block.type not in _SECOND
        blocks.append((name, block.data[:, : _CORNERS[name]]) if straight else (block.type, block.data))
    grid, parts = pyvista.from_meshio(type(read)(read.points, blocks)), {}
    for name, chosen in _named_cells(read).items():
        if len(chosen):
            parts[name] = grid.extract_cells(chosen)
    for name, points in read.point_sets.items():
        if len(points):
            parts[name] = pyvista.PolyData(np.asarray(read.points, dtype=np.float64)[points])
    return grid, parts


def _named_cells(read: Any) -> dict[str, NDArray[np.int64]]:
    """Return the cells of each set of `read`, a meshio mesh, and of each Gmsh physical group, by name."""
    starts = np.cumsum([0, *(len(block.data) for block in read.cells)])[:-1]
    found: dict[str, list[NDArray]] = {}
    for name, by_block in read.cell_sets.items():
        if ":" not in name:  # "gmsh:bounding_entities" is no set
            chosen = [np.zeros(0, dtype=np.int64) if one is None else np.asarray(one) for one in by_block]
            found[name] = [first + one for first, one in zip(starts, chosen, strict=False)]
    tags = read.cell_data.get("gmsh:physical", [])
    for name, (tag, dimension) in read.field_data.items() if len(tags) else ():
        kinds = zip(starts, tags, read.cells, strict=True)
        tagged = [first + np.flatnonzero(of == tag) for first, of, block in kinds if block.dim == dimension]
        found.setdefault(name, tagged)  # files of version 4.1 have sets, too; tags are of a cell's first group
    return {name: np.concatenate([*one, []]).astype(np.int64) for name, one in found.items()}


def _outside(mesh: Any) -> Any:
    """Return the outer surface of a mesh's solid cells, or of its triangles if it has none."""
    # PyVista's own function has different arguments in different versions.
    skin_of = importlib.import_module("vtkmodules.vtkFiltersGeometry").vtkDataSetSurfaceFilter()
    skin_of.PassThroughCellIdsOn()
    pyvista = importlib.import_module("pyvista")
    grid = _straight(mesh if hasattr(mesh, "celltypes") else mesh.cast_to_unstructured_grid())
    kinds, first = np.unique(grid.celltypes, return_index=True)
    dimension = np.array([grid.get_cell(int(k)).dimension for k in first])
    for wanted in (3, 2):
        chosen = np.isin(grid.celltypes, kinds[dimension == wanted])
        if chosen.any():
            cells = grid.extract_cells(np.flatnonzero(chosen))
            skin_of.SetInputData(cells)
            skin_of.Update()
            surface = pyvista.wrap(skin_of.GetOutput()).triangulate()
            return surface if wanted == 2 else _turned(surface, cells)
    raise ValueError(f"mesh has {len(grid.celltypes)} cells, none solid nor a face; it must have some")


def _turned(surface: Any, cells: Any) -> Any:
    """Return the surface of solid cells with its triangles turned where a cell is beyond its faces: mirrored."""
    triangles, of = np.array(surface.regular_faces), surface.cell_data["vtkOriginalCellIds"]
    middle = cells.cell_centers().points[of].astype(np.float64)
    corners = np.asarray(surface.points, dtype=np.float64)[triangles] - middle[:, None]
    mirrored = np.bincount(of, np.linalg.det(corners))[of] < 0
    triangles[mirrored] = triangles[mirrored][:, ::-1]
    turned = surface.copy()
    turned.regular_faces = triangles
    return turned


def _straight(grid: Any) -> Any:
    """Return an unstructured mesh whose cells of third and higher order are reduced to their corners."""
    if not grid.n_cells:
        return grid
    pyvista, cells = importlib.import_module("pyvista"), grid.GetCells()
    corner, start = (pyvista.convert_array(one) for one in (cells.GetConnectivityArray(), cells.GetOffsetsArray()))
    if len(corner) and not 0 <= corner.min() <= corner.max() < grid.n_points:
        raise ValueError(f"a cell has point {corner.max()} of {grid.n_points}")
    curved = grid.celltypes >= _LAGRANGE
    if not curved.any():
        return grid
    kinds = (grid.celltypes[curved] - _LAGRANGE) % len(_CORNERS)
    made = {}
    for k, (kind, count) in enumerate(zip(_STRAIGHT, _CORNERS.values(), strict=True)):
        if (kinds == k).any():
            made[kind] = corner[start[:-1][curved][kinds == k][:, None] + np.arange(count)]
    return pyvista.UnstructuredGrid(made, grid.points)


def _distances(part: Any, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point from a mesh [m], 0 inside its solid cells."""
    if getattr(part, "n_verts", -1) == part.n_cells:  # a part of points only
        numbers = [part.find_closest_point(one) for one in x]
        return np.linalg.norm(part.points[numbers] - x, axis=1)
    _, nearest = part.find_closest_cell(x, return_closest_point=True)
    return np.linalg.norm(nearest - x, axis=1)
