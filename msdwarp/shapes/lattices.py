"""Lattices: bodies whose particles lie on a regular lattice, centred at the origin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Cells, Material, Surface, System, mask_of, uniform
from .bending import flexural_rigidity, resisting_bending
from .grid import (
    cell_corners,
    cell_fractions,
    check_memory,
    count_pieces,
    first_loose,
    grid_surface,
    lattice_connections,
    lattice_directions,
    whole_cells,
)


def section_of(
    material: Material | None, constants: Mapping[str, Any], sections: Mapping[str, float | None]
) -> float:
    """Return a chain's cross section [m²] or a sheet's thickness [m]; 1 without material or for a solid.

    Raises ValueError unless a body has either constants only, or a material with all its dimensions.
    """
    given, why = sections, "without a material it must be left out"
    if material is not None:
        checks.instance("material", material, Material, "msdwarp.RUBBER")
        given, why = constants, "with a material, which determines it, it must be left out"
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} is {value!r}; {why}")
    if material is None:
        return 1.0
    for name, value in sections.items():
        if value is None:
            raise ValueError(f"{name} is None; with a material it must be a number above 0")
    return math.prod(checks.positive(name, value) for name, value in sections.items() if value is not None)


def _lattice(
    shape: Sequence[int],
    spacing: float | Sequence[float],
    diagonals: bool,
    dim: int,
    surface: Surface | None,
    material: Material | None,
    section: float,
    constants: Mapping[str, Any],
    mask: NDArray[np.bool_] | None = None,
    bending: float | str | None = None,
) -> System:
    """Return the lattice of `shape` points, or of points where a mask is True, with `dim` coordinates."""
    spacings = _spacings(spacing, len(shape))
    rigidity = flexural_rigidity(bending, material, section, diagonals, dim)
    if (material is not None or rigidity) and len(set(spacings)) > 1:
        what, whose = ("bending", "the") if material is None else ("a material", "a Material's")
        raise ValueError(
            f"spacing is {spacing!r}; with {what} it must be the same along all axes: {whose} stiffness is "
            "derived for such cells"
        )
    if material is not None and material.poissons_ratio is not None and len(shape) > 1 and not diagonals:
        raise ValueError(
            f"material has poissons_ratio={material.poissons_ratio:g}; it needs neighbors="
            f"{(8, 26)[len(shape) - 2]}: without diagonals nothing resists shear"
        )
    position = np.zeros((*shape[::-1], dim))  # z, y, x
    axes = [one * (np.arange(n) - (n - 1) / 2) for one, n in zip(spacings, shape, strict=True)]
    for k, coordinates in enumerate(np.meshgrid(*axes[::-1], indexing="ij", sparse=True)[::-1]):
        position[..., k] = coordinates
    position = position.reshape(-1, dim) if mask is None else position[mask.T]
    directions = lattice_directions(len(shape), diagonals=diagonals)
    # A material fills whole cells, so particles are not joined across a gap.
    whole = None if material is None or mask is None else whole_cells(mask)
    if mask is not None and whole is not None and (loose := first_loose(mask, whole)):
        raise ValueError(
            f"mask{list(loose)} is True, but it is a corner of no whole cell; a material fills whole cells"
        )
    connections, slices = lattice_connections(shape, directions, mask, whole)
    if mask is not None:
        _check_one_piece(mask, connections)
    rest_length = np.empty(len(connections))
    for name, step in directions.items():
        along = [one for one, s in zip(spacings, step, strict=True) if s]
        longest = max(along)  # factored out, so that for equal spacings lengths are exactly 1, √2 or √3 times it
        rest_length[slices[name]] = longest * np.sqrt(sum((one / longest) ** 2 for one in along))
    for name, values in {"position": position, "rest_length": rest_length}.items():
        checks.within(name, values, checks.FINITE)  # a large spacing may overflow
    lattice = System.trusted(
        position=position, connections=connections, rest_length=rest_length, surface=surface, directions=(slices,)
    )
    mask = np.ones(shape, dtype=bool) if mask is None else mask
    if material is not None:
        constants = _constants_of(material, section, mask, spacings[0], diagonals)
    given = {name: value for name, value in constants.items() if value is not None}
    if (total := given.pop("total_mass", None)) is not None:
        if "mass" in given:
            raise ValueError(f"total_mass is {total!r}; with mass, that of each particle, it must be left out")
        given["mass"] = checks.positive("total_mass", total) / lattice.particle_count
    lattice = lattice.replace(**given)
    if not rigidity:
        return lattice
    return resisting_bending(lattice, mask, spacings[0], rigidity, diagonals=diagonals, solid=material is not None)


def _constants_of(
    material: Material, section: float, mask: NDArray[np.bool_], spacing: float, diagonals: bool
) -> dict[str, Any]:
    """Return a material lattice's mass, stiffness and damping, each summed over adjacent cells, and its cells."""
    whole, axes = whole_cells(mask), mask.ndim
    by_axes = material.cell_stiffness(axes, spacing, section, diagonals=diagonals)
    steps = lattice_directions(axes, diagonals=diagonals).values()
    each = [by_axes[np.count_nonzero(step) - 1] * cell_fractions(whole, step) for step in steps]
    stiffness = np.concatenate(each)
    longest = max(int(np.ptp(points)) for points in np.nonzero(mask))
    time = material.damping_time(spacing * longest, axes)
    return {
        "mass": material.cell_mass(axes, spacing, section) * cell_fractions(whole, (0,) * axes),
        "stiffness": stiffness,
        "damping": time * stiffness,
        "cells": _cells_of(material, section, mask, whole, spacing, time),
    }


def _cells_of(
    material: Material,
    section: float,
    mask: NDArray[np.bool_],
    whole: NDArray[np.bool_],
    spacing: float,
    time: float,
) -> Cells | None:
    """Return the cells of a material's lattice, damped with the time β [s]; None if springs suffice."""
    modulus = material.cell_modulus(mask.ndim, section)
    if modulus == 0.0:
        return None
    corners = cell_corners(mask, whole)
    damping = time * material.damped_modulus(mask.ndim, section)
    volume = uniform(spacing**mask.ndim, len(corners))
    return Cells(corners=corners, rest_volume=volume, modulus=modulus, damping=damping)


def _spacings(spacing: float | Sequence[float], axes: int) -> tuple[float, ...]:
    """Return the spacing along each axis, given one number, or one for each axis."""
    if axes == 1 or not (isinstance(spacing, list | tuple) or np.ndim(spacing) > 0):
        return (checks.positive("spacing", cast(float, spacing)),) * axes
    each = cast(Sequence[float], spacing)
    if len(each) != axes:
        raise ValueError(
            f"spacing is {checks.repr_short(spacing)}; it must be a number, or {axes}: one for each axis"
        )
    return tuple(checks.positive(f"spacing[{k}]", one) for k, one in enumerate(each))


def _check_shape(shape: Sequence[int], axes: int, neighbors: int, *extra: object) -> None:
    """Check the number of particles along each axis, and that particles and connections fit into memory."""
    if not isinstance(shape, Sequence) or len(shape) != axes:
        raise ValueError(f"shape is {shape!r}; it must be {axes} numbers of particles")
    for k, n in enumerate(shape):
        checks.count(f"shape[{k}]", n, 2)
    check_memory("shape", shape, math.prod(shape), neighbors, *extra)


def chain(
    count: int,
    spacing: float = 1.0,
    *,
    material: Material | None = None,
    area: float | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    dim: int = 3,
) -> System:
    """Return `count` particles in a row along x, centred at the origin, each connected with the next.

    Parameters
    ----------
    count
        Number of particles, at least 2.
    spacing
        Distance of neighbours and rest length [m].
    material, mass, total_mass, stiffness, damping
        A `Material`, or the constants of each particle [kg] and each connection [N/m], [N s/m]; see `System`. By
        default 1, 1000 and 0. `total_mass`, in place of `mass`, is shared equally by the particles [kg].
    area
        Cross section [m²]; only with a material.
    dim
        Number of coordinates: 1, 2 or 3.
    """
    checks.one_of("dim", dim, (1, 2, 3))
    count = checks.count("count", count, 2)
    check_memory("count", count, count, 2, material)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    section = section_of(material, constants, {"area": area})
    return _lattice((count,), spacing, False, dim, None, material, section, constants)


def sheet(
    shape: tuple[int, int],
    spacing: float | Sequence[float] = 1.0,
    *,
    neighbors: int = 8,
    material: Material | None = None,
    thickness: float | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    bending: float | str | None = None,
    dim: int = 3,
) -> System:
    """Return a rectangular sheet of particles in the x-y plane, centred at the origin.

    Parameters
    ----------
    shape
        Number of particles along x and y, each at least 2.
    spacing
        Distance of neighbours along an axis [m]: one number, or one for each axis (with a material, all equal).
    neighbors
        4 connects neighbours along the axes (such a sheet collapses by shearing: figure 7 of the 2014 report); 8
        adds the diagonals (figure 8).
    material, mass, total_mass, stiffness, damping
        A `Material`, or the constants of each particle [kg] and each connection [N/m], [N s/m], as for `chain`.
    thickness
        Thickness [m]; only with a material.
    bending
        Bending resistance: the flexural rigidity D [N m], or "material" for D = E t³ / (12 (1 − ν²)). By default
        there is none. It uses springs between second neighbours, which push while connections between neighbours
        pull; `msdwarp.shapes.bending` derives both, and the error. Arrays of stiffness and damping apply only to
        the connections between neighbours.
    dim
        Number of coordinates: 2 or 3.
    """
    checks.one_of("dim", dim, (2, 3))
    checks.one_of("neighbors", neighbors, (4, 8))
    _check_shape(shape, 2, neighbors, material, bending)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    section, surface = section_of(material, constants, {"thickness": thickness}), grid_surface(shape)
    return _lattice(shape, spacing, neighbors == 8, dim, surface, material, section, constants, bending=bending)


def box(
    shape: tuple[int, int, int],
    spacing: float | Sequence[float] = 1.0,
    *,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a solid block of particles, centred at the origin.

    The texture has the six faces in three columns and two rows: −x, +x, −y in the lower row and +y, −z, +z in the
    upper one.

    Parameters
    ----------
    shape
        Number of particles along x, y and z, each at least 2.
    spacing
        Distance of neighbours along an axis [m]: one number, or one for each axis (with a material, all equal).
    neighbors
        6 connects neighbours along the axes (such a block collapses by shearing); 26 adds the diagonals of faces
        and cells.
    material, mass, total_mass, stiffness, damping
        A `Material`, or the constants of each particle [kg] and each connection [N/m], [N s/m], as for `chain`.
    """
    checks.one_of("neighbors", neighbors, (6, 26))
    _check_shape(shape, 3, neighbors, material)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    section = section_of(material, constants, {})
    return _lattice(shape, spacing, neighbors == 26, 3, grid_surface(shape), material, section, constants)


def lattice(
    mask: ArrayLike,
    spacing: float | Sequence[float] = 1.0,
    *,
    neighbors: int | None = None,
    material: Material | None = None,
    thickness: float | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    bending: float | str | None = None,
    dim: int | None = None,
    surface: Surface | None = None,
) -> System:
    """Return a body of any shape, cut from a lattice.

    Particles are numbered without gaps, with x varying fastest, then y, then z. The origin is the centre of the
    whole mask.

    Parameters
    ----------
    mask
        Which points of the lattice are particles: bool, shape [nx, ny, nz] for a solid body, [nx, ny] for
        a sheet in the x-y plane.
    spacing
        Distance of neighbours along an axis [m]: one number, or one for each axis (with a material, all equal).
    neighbors
        26 or 6 for a solid body, 8 or 4 for a sheet, as for `box` and `sheet`; by default the larger.
    material, mass, total_mass, stiffness, damping
        A `Material`, or the constants of each particle [kg] and each connection [N/m], [N s/m], as for `chain`. A
        material fills the complete cells, which have particles at all corners. Every particle must belong to a
        complete cell, and particles without a common cell are not connected.
    thickness
        Thickness of a sheet [m]; only with a material.
    bending
        Bending resistance of a sheet, as for `sheet`.
    dim
        Number of coordinates: 3, or 2 for a sheet; by default 3.
    surface
        The triangles that are drawn. By default the outer faces of the complete cells, with the texture layout of
        `box`; for a sheet its complete cells, facing up. None if there is no complete cell.

    Raises
    ------
    ValueError
        If a particle is connected with no other, or the body is in pieces.
    """
    try:
        points = np.array(mask)
    except ValueError as error:
        raise ValueError(f"mask must be an array of True and False, not {mask!r}") from error
    if points.dtype != bool or points.ndim not in (2, 3):
        raise ValueError(
            f"mask has shape {points.shape} and type {points.dtype}; "
            "it must hold True and False in the shape (nx, ny) or (nx, ny, nz)"
        )
    if not points.any():
        raise ValueError("mask is False everywhere; it must have at least two particles")
    axes = points.ndim
    allowed = {2: (8, 4), 3: (26, 6)}[axes]
    neighbors = allowed[0] if neighbors is None else neighbors
    checks.one_of("neighbors", neighbors, allowed)
    check_memory("mask's shape", points.shape, int(np.count_nonzero(points)), neighbors, material, bending)
    dim = 3 if dim is None else dim
    checks.one_of("dim", dim, (2, 3) if axes == 2 else (3,))
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    section = section_of(material, constants, {"thickness": thickness} if axes == 2 else {})
    for name, value in {"thickness": thickness, "bending": bending}.items():
        if axes == 3 and value is not None:
            raise ValueError(f"{name} is {value!r}; for a solid body it must be left out")
    surface = grid_surface(points.shape, points) if surface is None else surface
    kind = (dim, surface, material, section, constants)
    return _lattice(points.shape, spacing, neighbors == allowed[0], *kind, points, bending)


def _check_one_piece(mask: NDArray[np.bool_], connections: NDArray[np.int32]) -> None:
    """Check that connections join all the particles of a mask."""
    joined = mask_of(connections, int(mask.sum()))
    if not joined.all():
        alone = np.argwhere(mask.T)[np.argmin(joined)][::-1].tolist()
        raise ValueError(
            f"mask{alone} is True, but none of its neighbours is; every particle must be joined with another"
        )
    pieces = count_pieces(len(joined), connections)
    if pieces > 1:
        raise ValueError(
            f"mask is {pieces} pieces that no connection joins; it must be one (systems can be added)"
        )
