"""Contact tables of an ensemble: tables of one world repeated for all, and values that differ between worlds.

Tables concatenate the surfaces and bodies of all worlds; search trees have a branch for each world. So one search
serves all worlds, and none finds facets of another.
"""

from math import lcm
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, contact_surfaces, spring_means
from ..model.model import Model

MOST_NUMBERED = 2**31 - 1
"""Maximal number of points, facets or entries of all worlds: 32-bit indices."""


class Repeated:
    """Uploads tables of one world, repeated for each world of a model; a model without worlds counts as one."""

    def __init__(self, model: Model) -> None:
        self._worlds, self._device = model.worlds, model.device

    def alike(self, values: Any, kind: Any, further: int = 0) -> wp.array:
        """Upload values that are equal in all worlds; indices increase by `further` from one world to the next."""
        return self.by_row(np.asarray(values)[None], kind, further)

    def by_row(self, values: NDArray, kind: Any, further: int = 0) -> wp.array:
        """Upload rows, shape [rows, count, ...]: world w gets row w mod rows; see `alike` for `further`."""
        worlds, along = self._worlds, [1] * (values.ndim - 1)
        if values[0].size * worlds > MOST_NUMBERED:
            most = MOST_NUMBERED // values[0].size
            raise ValueError(f"worlds is {worlds}; it must be at most {most}, whose contacts can be numbered")
        each = np.tile(values, (worlds // len(values), *along))
        if further:
            each = each.astype(np.int64) + further * np.arange(worlds).reshape(-1, *along)
        return wp.array(np.ascontiguousarray(each.reshape(-1, *values.shape[2:])), dtype=kind, device=self._device)

    def starts(self, counts: NDArray[np.integer]) -> wp.array:
        """Upload where rows of the lengths `counts` start in a concatenated table, and the end of the last row."""
        first = np.append(0, np.cumsum(np.tile(counts, self._worlds)))
        return wp.array(first, dtype=int, device=self._device)


def surfaces_by_row(model: Model, surfaces: TouchingSurfaces) -> list[TouchingSurfaces]:
    """Return the surfaces for each row of stiffnesses and rest lengths of worlds; one if there are no worlds."""
    if not model.in_worlds:
        return [surfaces]
    system, rows = model.system, {name: model.row_of(name) for name in ("rest_length", "stiffness")}
    of_lengths = [surfaces]
    if len(rows["rest_length"]) > 1:
        of_lengths = [contact_surfaces(system.replace(rest_length=one)) for one in rows["rest_length"]]
    body = surfaces.body_of_particle
    means = [spring_means(system, body, one) for one in rows["stiffness"]]
    count = lcm(len(of_lengths), len(means))
    return [of_lengths[k % len(of_lengths)]._replace(stiffness=means[k % len(means)]) for k in range(count)]
