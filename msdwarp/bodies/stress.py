"""Stress of bodies with cells, from positions alone."""

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .cells import NONE
from .springs import LINEAR_SPRING
from .system import System


def stress(system: System, position: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the Cauchy stress at each particle, shape [particle_count, d, d], in [Pa], in sheets [N/m].

    A cell's stress is the virial of its elastic forces per volume, (Σ T l n nᵀ)/V + w', for tensions T along n of
    connections between its corners, divided equally among the cells around (Hardy, J. Chem. Phys. 76 (1982) 622).
    A particle has the volume-weighted mean of its cells, and 0 without cells: exact for homogeneous strain.
    Dampers, and connections that lie in no cell, are excluded.

    Parameters
    ----------
    system
        A system with `cells`, such as a body of a `Material` with a Poisson's ratio.
    position
        Positions [m], shape [particle_count, d]; by default the system's positions.

    Raises
    ------
    ValueError
        If the system has no cells, or its springs are not linear.
    """
    checks.instance("system", system, System, "box((5, 5, 5), 0.1, material=rubber)")
    cells = system.cells
    if cells is None or system.spring != LINEAR_SPRING:
        missing = "no cells" if cells is None else f"spring={system.spring!r}"
        raise ValueError(
            f"system has {missing}; for stress it must have linear springs, and cells: those of a Material with "
            "poissons_ratio"
        )
    x = system.position if position is None else checks.broadcast("position", position, system.position.shape)
    volume = np.abs(cells.volumes(x))
    virial = _virials(system, x) + (cells.slopes(x) * volume)[:, None, None] * _planes(system, x)
    total, weights = np.zeros((len(x), *virial.shape[1:])), np.zeros(len(x))
    for k in range(cells.corners.shape[1]):
        here = cells.corners[:, k] != NONE
        np.add.at(total, cells.corners[here, k], virial[here])
        np.add.at(weights, cells.corners[here, k], volume[here])
    return total / np.where(weights > 0, weights, np.inf)[:, None, None]


def _virials(system: System, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Σ tension · length · n nᵀ of connections between a cell's corners [J], shape [cell_count, d, d]."""
    cells, ends = system.cells, system.connections
    assert cells is not None
    apart = x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(apart, axis=1)
    pull = np.where(system.broken, 0.0, system.stiffness * (length - system.rest_length))
    each = (pull / np.where(length > 0, length, 1))[:, None, None] * apart[:, :, None] * apart[:, None, :]
    cell, pair, pair_of = _joined_corners(system)
    joined = np.zeros((int(pair_of.max(initial=-1)) + 1, *each.shape[1:]))
    np.add.at(joined, pair_of, each)
    result = np.zeros((len(cells), *each.shape[1:]))
    np.add.at(result, cell, joined[pair] / np.bincount(pair, minlength=len(joined))[pair][:, None, None])
    return result


def connection_fractions(system: System, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the fraction of each connection that chosen cells have; all cells around it have equal fractions."""
    cell, pair, pair_of = _joined_corners(system)
    count = int(pair_of.max(initial=-1)) + 1
    of_chosen, of_all = np.bincount(pair[chosen[cell]], minlength=count), np.bincount(pair, minlength=count)
    return (of_chosen / np.maximum(of_all, 1))[pair_of]


def _joined_corners(system: System) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return (cell, pair) for each pair of connected corners of a cell, and the pair of each connection."""
    cells, count = system.cells, system.particle_count
    assert cells is not None
    ends = np.sort(system.connections.astype(np.int64), axis=1)
    different, pair_of = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    two = np.array(list(itertools.combinations(range(cells.corners.shape[1]), 2)))
    pairs = np.sort(cells.corners[:, two].astype(np.int64), axis=2)
    names = pairs[..., 0] * count + pairs[..., 1]
    cell = np.broadcast_to(np.arange(len(cells))[:, None], names.shape)
    apart = (pairs[..., 0] != NONE) & (pairs[..., 0] != pairs[..., 1])
    once = np.unique(np.stack([cell[apart], names[apart]]), axis=1)
    at = np.minimum(np.searchsorted(different, once[1]), len(different) - 1)
    known = different[at] == once[1]
    return once[0, known], at[known], pair_of.ravel()


def von_mises(stress: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the von Mises stress √(3/2 s:s) of stresses, shape [..., d, d], with their deviator s in 3D."""
    stress = checks.array("stress", stress)
    dim = stress.shape[-1] if stress.ndim > 1 else 0
    if not 1 <= dim <= 3 or stress.shape[-2] != dim:
        raise ValueError(f"stress has shape {stress.shape}; it must be (..., d, d), with d = 1, 2 or 3")
    pressure = np.trace(stress, axis1=-2, axis2=-1) / 3
    squares = (stress**2).sum(axis=(-2, -1)) - 3 * pressure**2  # |s|², also for plane stress
    return np.sqrt(np.maximum(1.5 * squares, 0.0)) if dim > 1 else np.abs(stress[..., 0, 0])


def _planes(system: System, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the projection on the plane of each flat cell, and the identity for each solid cell."""
    cells = system.cells
    assert cells is not None
    result = np.tile(np.eye(x.shape[1]), (len(cells), 1, 1))
    if x.shape[1] == 3 and cells.flat.any():
        quad = x[cells.corners[cells.flat, :4]]
        normal = np.cross(quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1])
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.where(size > 0, size, 1)
        result[cells.flat] -= normal[:, :, None] * normal[:, None, :]
    return result
