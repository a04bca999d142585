"""Volumes and energies of cells, by Gauss's quadrature: shares nothing with the package but the numbers."""

import itertools

import numpy as np

from msdwarp import Cells, System

# Corners of VTK's hexahedron in the unit cube, and of its quadrilateral in the unit square.
SOLID = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
FLAT = SOLID[:4, :2]
GAUSS = (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3))


def _slopes(at: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the gradient of each corner's shape function at a point, shape [corners, d]."""
    share = np.where(corners == 1, at, 1 - at)
    sign = np.where(corners == 1, 1.0, -1.0)
    return np.stack(
        [sign[:, k] * np.delete(share, k, axis=1).prod(axis=1) for k in range(corners.shape[1])], axis=1
    )


def gradients(cells: Cells, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the volume of each cell, area of flat ones, and its gradients by the corners, shape [n, 8, d].

    ∫ det(∂x/∂ξ) dξ over the cell: quadratic along each axis, so that two points are exact. The area of a flat cell
    in space is that of its mean: of ∫ ∂x/∂ξ × ∂x/∂η.
    """
    flat, n, dim = cells.corners[:, 7] < 0, len(cells.corners), x.shape[1]
    volume, gradient = np.zeros(n), np.zeros((n, 8, dim))
    if not flat.all():
        for at in itertools.product(GAUSS, repeat=3):
            slopes = _slopes(np.array(at), SOLID)
            jacobian = np.einsum("nci,cj->nij", x[cells.corners[~flat]], slopes)
            cofactors = np.stack([np.cross(jacobian[..., k - 2], jacobian[..., k - 1]) for k in range(3)], axis=-1)
            volume[~flat] += np.linalg.det(jacobian) / 8
            gradient[~flat] += np.einsum("nij,cj->nci", cofactors, slopes) / 8
    quads = np.pad(x[cells.corners[flat, :4]], ((0, 0), (0, 0), (0, 3 - dim)))
    points = [_slopes(np.array(at), FLAT) for at in itertools.product(GAUSS, repeat=2)]
    along = [
        (np.einsum("nci,c->ni", quads, one[:, 0]), np.einsum("nci,c->ni", quads, one[:, 1])) for one in points
    ]
    area = sum(np.cross(*one) for one in along) / 4
    size = np.linalg.norm(area, axis=1) if dim == 3 else area[:, 2]
    unit = area / np.abs(size)[:, None] if dim == 3 else np.tile((0.0, 0.0, 1.0), (len(area), 1))
    volume[flat] = size
    for (first, second), one in zip(along, points, strict=True):
        for c in range(4):
            change = one[c, 0] * np.cross(second, unit) + one[c, 1] * np.cross(unit, first)
            gradient[flat, c] += change[:, :dim] / 4
    return volume, gradient


def density(modulus: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Return w(J) of each cell [J/m³]: the integral of w' from 1."""
    d = ratio - 1
    squeezed = np.log(1 + d * d) / 2
    stretched = np.log((1 + ratio * ratio) / 2) + np.pi / 2 - 2 * np.arctan(ratio)
    crushed = np.where(ratio.real < 1 / 3, 10 * (1 / 3 - ratio) ** 3, 0)
    return modulus * np.where(modulus >= 0, d * d / 2 + crushed, np.where(d.real < 0, squeezed, stretched))


def energy(cells: Cells, x: np.ndarray) -> np.ndarray:
    """Return the energy of cells [J]."""
    return (cells.rest_volume * density(cells.modulus, gradients(cells, x)[0] / cells.rest_volume)).sum()


def forces(system: System, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the force of cells on every particle [N]."""
    cells = system.cells
    assert cells is not None
    volume, gradient = gradients(cells, x)
    there = (cells.corners >= 0)[..., None]
    rate = (gradient * np.where(there, v[cells.corners], 0)).sum(axis=(1, 2))
    ratio, modulus, step = volume / cells.rest_volume, cells.modulus, 1e-4
    up, same, down = (density(modulus, ratio + one * step) for one in (1, 0, -1))
    curvature = (up - 2 * same + down) / step**2  # only damping depends on it, and only if it is not constant
    share = np.where(modulus >= 0, 1 + 60 * np.maximum(1 / 3 - ratio, 0), np.maximum(curvature / modulus, 0))
    slope = density(modulus, ratio + 1e-30j).imag / 1e-30  # exact but for rounding
    pressure = slope + cells.damping * share * rate / cells.rest_volume
    total = np.zeros_like(x)
    for c in range(8):
        here = there[:, c, 0]
        np.add.at(total, cells.corners[here, c], -pressure[here, None] * gradient[here, c])
    return total
