"""TornFacets: leaves out of contact the triangles and segments whose springs have broken."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, connection_between
from ...kernels.collision import TearingFacets, leave_out_torn
from ..model.model import Model

NEVER = 4
"""More broken springs than a facet has sides."""


class TornFacets:
    """Leaves out of contact, from the next frame on, the facets of open surfaces and ropes that have torn.

    A triangle tears when two of its sides break, or the first if one has no spring, as it is drawn; see
    `bodies.Edges`. Closed bodies keep their surfaces, which must have an inside.

    `contact` is the device's struct of contact, `pairs` that of near pairs, `broken_at` as in `Fracture`.
    """

    def __init__(
        self, model: Model, surfaces: TouchingSurfaces, contact: Any, pairs: Any, broken_at: wp.array
    ) -> None:
        self._model, self._given, device = model, [contact, pairs], model.device
        data = self._data = TearingFacets()
        corner = surfaces.corner
        springs = _springs(model, surfaces, np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1))
        triangle = corner[:, 1] != corner[:, 2]
        springs[~triangle, 1:] = -1  # the sides of a segment are one spring
        found = (springs >= 0).sum(axis=1)
        least = np.where(found == 3, 2, 1)
        least[(found == 0) | surfaces.closed[surfaces.body[corner[:, 0]]]] = NEVER
        data.broken_at = broken_at
        data.spring = wp.array(self._in_worlds(springs), dtype=int, device=device)
        data.least = wp.array(np.tile(least, model.worlds), dtype=int, device=device)
        data.corner, data.owned = wp.clone(contact.surfaces.corner), wp.clone(pairs.owned)
        along = np.where(
            surfaces.closed[surfaces.body[surfaces.ends[:, 0]]], -1, _springs(model, surfaces, surfaces.ends)
        )
        data.along = wp.array(self._in_worlds(along), dtype=int, device=device)
        data.share = wp.array(np.tile(surfaces.share, model.worlds), dtype=wp.float64, device=device)

    def _in_worlds(self, springs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return indices of springs, −1 for none, for all worlds, concatenated."""
        world = np.arange(self._model.worlds).reshape(-1, *[1] * springs.ndim)
        each = np.where(springs < 0, -1, springs + world * self._model.connection_count)
        return each.reshape(-1, *springs.shape[1:])

    def leave_out(self, share: Callable[..., None]) -> None:
        """Launch the update of facets and points by `share`, which is `NeighborList.share`."""
        kernel = leave_out_torn(self._model.scalar, self._model.in_worlds)
        share(kernel, max(len(self._data.corner), len(self._data.along)), [*self._given, self._data], [])


def _springs(model: Model, surfaces: TouchingSurfaces, ends: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the spring between pairs of vertices, shape [..., 2], in the device's order; −1 if there is none.

    There is none at a vertex that is a mean of several particles.
    """
    whole = (surfaces.weight != 0).sum(axis=1) == 1
    particle = np.take_along_axis(surfaces.particle, np.abs(surfaces.weight).argmax(axis=1)[:, None], axis=1)[:, 0]
    found = connection_between(model.system, particle[ends])
    return np.where(
        whole[ends].all(axis=-1) & (found >= 0),
        model.in_system_order(np.arange(model.connection_count))[found],
        -1,
    )
