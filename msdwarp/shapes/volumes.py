"""Bodies from the files of mesh generators and finite-element codes."""

from __future__ import annotations

import importlib
import math
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
_NEAR = math.sqrt(3) / 2
"""A particle is in a group if its distance from the named part is at most this, in spacings: half a diagonal."""


def from_volume(
    mesh: Any,
    spacing: float | None = None,
    *,
    across: int | None = None,
    scale: float = 1.0,
    neighbours: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a body that fills a mesh of solid cells, such as a mesh generator's file, with particles.

    The outer surface of the solid cells, or of the triangles if there are none, is filled as by `from_mesh`. The
    lattice represents the material exactly. Springs along the edges of the file's tetrahedra could not: fitted to
    a material as well as possible, bars of tetrahedra were up to 22 % too soft, and finer meshes were no better.

    Named parts of the file, such as Gmsh's physical groups or the sets of a .inp file, are groups of the body. A
    particle belongs to a part that is at most half a cell's diagonal away.

    Parameters
    ----------
    mesh
        The path of a file, or a PyVista mesh. Files except VTK's, .stl, .ply and .obj (such as .msh, .inp,
        .med, .mesh ...) are read by meshio: `pip install 'msdwarp[meshes]'`.
    spacing, across, neighbours, material, mass, stiffness, damping
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
        grid, parts = _read(Path(mesh))
    elif hasattr(mesh, "cast_to_unstructured_grid"):
        grid, parts = mesh.cast_to_unstructured_grid(), {}
    else:
        raise ValueError(f"mesh is a {type(mesh).__name__}; it must be the path of a file, or a PyVista mesh")
    surface = _outside(grid).scale(scale)
    constants = {"material": material, "mass": mass, "stiffness": stiffness, "damping": damping}
    body = from_mesh(surface, spacing, across=across, neighbours=neighbours, **constants)
    edge = spacing if spacing is not None else float(np.ptp(surface.points, axis=0).max()) / (across or 1)
    groups = {}
    for name, part in parts.items():
        near = np.flatnonzero(_distances(part.scale(scale), body.position) <= _NEAR * edge)
        if len(near):
            groups[name] = near
    return body.replace(groups=groups)


def _read(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return (PyVista mesh of all cells, mesh of each named part by name)."""
    pyvista = importlib.import_module("pyvista")
    if not path.is_file():
        raise ValueError(f"mesh is {str(path)!r}; it must be the path of a mesh file, and there is none")
    meshio: Any = None
    if path.suffix.lower() not in _BY_PYVISTA:
        meshio = checks.imported("meshio", f"{path.suffix} files need meshio: pip install 'msdwarp[meshes]'")
    try:
        if meshio is None:
            return pyvista.read(path).cast_to_unstructured_grid(), {}
        read = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio raises its own errors, and exits for some files
        raise ValueError(f"mesh is {str(path)!r}, which cannot be read as a mesh: {error}") from error
    named, parts = _named_cells(read), {}  # taken first, since PyVista removes the sets
    grid = pyvista.from_meshio(read)
    for name, chosen in named.items():
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
        found[name] = [first + np.flatnonzero(of == tag) for first, of, block in kinds if block.dim == dimension]
    return {name: np.concatenate([*one, []]).astype(np.int64) for name, one in found.items()}


def _outside(grid: Any) -> Any:
    """Return the outer surface of a mesh's solid cells, or of its triangles if it has none."""
    # PyVista's own function has different arguments in different versions.
    skin_of = importlib.import_module("vtkmodules.vtkFiltersGeometry").vtkDataSetSurfaceFilter()
    wrap = importlib.import_module("pyvista").wrap
    kinds, first = np.unique(grid.celltypes, return_index=True)
    dimension = np.array([grid.get_cell(int(k)).dimension for k in first])
    for wanted in (3, 2):
        chosen = np.isin(grid.celltypes, kinds[dimension == wanted])
        if chosen.any():
            skin_of.SetInputData(grid.extract_cells(np.flatnonzero(chosen)))
            skin_of.Update()
            return wrap(skin_of.GetOutput()).triangulate()
    raise ValueError(f"mesh has {len(grid.celltypes)} cells, none solid nor a face; it must have some")


def _distances(part: Any, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point from a mesh [m], 0 inside its solid cells."""
    if getattr(part, "n_verts", -1) == part.n_cells:  # a part of points only
        numbers = [part.find_closest_point(one) for one in x]
        return np.linalg.norm(part.points[numbers] - x, axis=1)
    _, nearest = part.find_closest_cell(x, return_closest_point=True)
    return np.linalg.norm(nearest - x, axis=1)
