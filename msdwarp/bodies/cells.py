"""Cells: parts of a body that resist a change of volume, in addition to springs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .uniform import joined

CORNERS = 8
"""Number of corners of a solid cell; a flat cell has half as many."""
NONE = -1
"""Entry for corners that a flat cell does not have."""
FACES = np.array([(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
"""Corners of the faces of a solid cell, counter-clockwise as seen from outside."""
_NUMBERS = ("rest_volume", "modulus", "damping")
"""Parameters of each cell."""


@dataclass(frozen=True, eq=False, init=False)
class Cells:
    """Cells of a body, which store energy if their volume V changes: W = V₀ w(V/V₀). Immutable.

    w(J) = κ (J − 1)²/2 for κ ≥ 0, and below J = 1/3 also 10 κ (1/3 − J)³, so that crushed cells do not turn
    inside out; `msdwarp.kernels.springs.cell_volumes` has w for κ < 0. A damper dissipates the power c V̇²/V₀
    (times w''/κ where w' is not linear). Springs resist shear, and alone give every body the same Poisson's ratio;
    cells add what another ratio needs: `Material.poissons_ratio` determines both.

    Parameters
    ----------
    corners
        Particles at the corners. Shape [cell_count, 8] for solid cells, in VTK's order of a hexahedron: around
        the bottom, counter-clockwise seen from above, then around the top. Repeated corners make a wedge (a, b, c,
        c, d, e, f, f) or a tetrahedron (a, b, c, c, d, d, d, d). Shape [cell_count, 4] for flat cells, in order
        around each: area takes the place of volume. Beside solid cells the last four corners of a flat one are −1.
    rest_volume
        Volume V₀ at which a cell exerts no force [m³], or area [m²], shape [cell_count].
    modulus
        κ [Pa], or [N/m] if flat, shape [cell_count]: what cells add to Lamé's λ. It may be negative.
    damping
        c [Pa s], or [N s/m] if flat, shape [cell_count]; of the sign of κ.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a volume is not positive, or an index is negative.
    """

    corners: NDArray[np.int32]
    rest_volume: NDArray[np.float64]
    modulus: NDArray[np.float64]
    damping: NDArray[np.float64]

    def __init__(
        self, *, corners: ArrayLike, rest_volume: ArrayLike, modulus: ArrayLike, damping: ArrayLike = 0.0
    ) -> None:
        object.__setattr__(self, "corners", _corners(corners))
        for name, value in {"rest_volume": rest_volume, "modulus": modulus, "damping": damping}.items():
            numbers = checks.broadcast(name, value, (len(self.corners),))
            checks.within(name, numbers, checks.FINITE, *((checks.NOT_TINY,) if name == "rest_volume" else ()))
            object.__setattr__(self, name, numbers)
        wrong_sign = self.modulus * self.damping < 0
        checks.every("damping", self.damping, ~wrong_sign, "0, or of the sign of modulus")

    def __len__(self) -> int:
        return len(self.corners)

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Mask of the flat cells, shape [cell_count]."""
        return self.corners[:, -1] == NONE

    def volumes(self, position: ArrayLike) -> NDArray[np.float64]:
        """Return the volume of each cell [m³], the area of flat ones [m²], for particles at `position` [m].

        The faces of solid cells are bilinear. The area of a flat cell is half the cross product of its diagonals;
        in two dimensions it is negative if corners are clockwise.
        """
        x = np.asarray(position, dtype=np.float64)
        result, flat = np.empty(len(self)), self.flat
        quad = x[self.corners[flat, :4]]
        first, second = quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1]
        if x.shape[1] == 2:
            result[flat] = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
        else:
            result[flat] = 0.5 * np.linalg.norm(np.cross(first, second), axis=1)
        if flat.all():
            return result
        solid = x[self.corners[~flat]]
        solid = solid - solid.mean(axis=1, keepdims=True)
        total = np.zeros(len(solid))
        for a, b, c, d in (solid[:, face].swapaxes(0, 1) for face in FACES):
            # A bilinear face encloses the mean volume of its two divisions into triangles.
            total += sum(np.einsum("ni,ni->n", p, np.cross(q, r)) for p, q, r in ((a, b, c), (a, c, d), (a, b, d)))
            total += np.einsum("ni,ni->n", b, np.cross(c, d))
        result[~flat] = total / 12
        return result

    def slopes(self, position: ArrayLike) -> NDArray[np.float64]:
        """Return w' of each cell [Pa], in flat ones [N/m]: minus the pressure, without the part of the damper."""
        ratio = self.volumes(position) / self.rest_volume
        d = ratio - 1
        negative = np.where(d < 0, d / (1 + d * d), 2 * d / (1 + ratio * ratio))
        return self.modulus * np.where(self.modulus < 0, negative, d - 30 * np.maximum(1 / 3 - ratio, 0) ** 2)

    def at_rest(self, position: ArrayLike, particles: NDArray[np.bool_] | None = None) -> Self:
        """Return these cells with the volumes at `position` [m] as rest volumes.

        With a mask of particles, only cells whose corners are all in the mask change.
        """
        volume = np.abs(self.volumes(position))
        if particles is not None:
            chosen = (particles[self.corners] | (self.corners == NONE)).all(axis=1)
            volume = np.where(chosen, volume, self.rest_volume)
        return replace(self, rest_volume=volume)

    def scaled(self, modulus: float, damping: float) -> Self:
        """Return these cells with modulus and damping multiplied by factors."""
        return replace(self, modulus=modulus * self.modulus, damping=damping * self.damping)

    def enlarged(self, factor: float) -> Self:
        """Return these cells when all lengths are multiplied by a factor."""
        return replace(self, rest_volume=self.rest_volume * factor ** np.where(self.flat, 2, 3))

    def renumbered(self, number: NDArray[np.integer]) -> Self:
        """Return these cells, sorted by their first corner, when particle k becomes `number[k]`."""
        corners = np.where(self.corners == NONE, NONE, number[self.corners])
        order = np.argsort(corners[:, 0], kind="stable")
        values = {name: getattr(self, name) for name in _NUMBERS}
        return replace(self, corners=corners[order], **{name: one[order] for name, one in values.items()})

    def behind(self, first: Cells | None, particles: int) -> Cells:
        """Return the cells of `first`, if any, then these, with particle indices increased by `particles`."""
        own = replace(self, corners=np.where(self.corners == NONE, NONE, self.corners + np.int32(particles)))
        if first is None:
            return own
        values = {name: joined(getattr(first, name), getattr(own, name)) for name in _NUMBERS}
        return Cells(corners=np.concatenate([first.corners, own.corners]), **values)


def _corners(value: ArrayLike) -> NDArray[np.int32]:
    """Return the corners of cells, shape [cell_count, 8]; raise ValueError if they are invalid."""
    allowed, widths = "(cell_count, 8), or (cell_count, 4) for flat cells", ((CORNERS // 2,), (CORNERS,))
    given = checks.whole_numbers("corners", value, allowed, lambda shape: shape[1:] in widths)
    corners = np.full((len(given), CORNERS), NONE, dtype=np.int64)
    corners[:, : given.shape[1]] = given
    lacking = corners == NONE
    right = (corners >= 0) | (lacking & lacking[:, 4:].all(axis=1, keepdims=True))
    right[:, :4] &= ~lacking[:, :4]
    allowed = "an index of a particle (or −1 in all of the last four)"
    checks.every("corners", corners, right & (corners < 2**31), allowed)
    return checks.as_int32(corners)
