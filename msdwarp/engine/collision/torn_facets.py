"""TornFacets: leaves out of contact the triangles and segments whose springs have broken."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, connection_between
from ...kernels.collision.vertices import TearingFacets, leave_out_torn
from ..model.model import Model
from .contact_surfaces import parts_of_facets
from .tables_by_world import Repeated

NEVER = 4
"""More broken springs than a facet has sides."""
NONE = -(2**30)
"""Below 0 in all worlds."""


class TornFacets:
    """Leaves out of contact, from the next frame on, the facets of sheets and ropes that have torn.

    A triangle tears when two of its sides break; if one side has no spring, when the first of the others breaks.
    Pictures follow the same rule (`bodies.Edges`). Solid bodies keep their surfaces.

    `contact` is the device's struct of contact, `pairs` that of near pairs, `broken_at` as in `Fracture`.
    """

    def __init__(
        self, model: Model, surfaces: TouchingSurfaces, contact: Any, pairs: Any, broken_at: wp.array
    ) -> None:
        self._model, self._given = model, [contact, pairs]
        data, each = TearingFacets(), Repeated(model)
        self._data = data
        corner = surfaces.corner
        springs = _springs(model, surfaces, np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1))
        triangle = corner[:, 1] != corner[:, 2]
        springs[~triangle, 1:] = NONE  # the sides of a segment are one spring
        found = (springs >= 0).sum(axis=1)
        least = np.where(found == 3, 2, 1)
        least[(found == 0) | surfaces.solid[surfaces.body[corner[:, 0]]]] = NEVER
        data.broken_at = broken_at
        data.spring = each.alike(springs, int, model.connection_count)
        data.least = each.alike(least, int)
        data.corner, (part, _) = wp.clone(contact.surfaces.corner), parts_of_facets(surfaces)
        order, counts = np.argsort(part, axis=None, kind="stable"), np.bincount(part[part >= 0])
        data.part = each.alike(np.where(part < 0, NONE, part), int, len(counts))
        data.first, data.around = each.starts(counts), each.alike(order[-counts.sum() :] // 6, int, len(corner))
        along = _springs(model, surfaces, surfaces.ends)
        along[surfaces.solid[surfaces.body[surfaces.ends[:, 0]]]] = NONE
        data.along = each.alike(along, int, model.connection_count)
        data.fraction = each.alike(surfaces.fraction, wp.float64)

    def leave_out(self, launch_parts: Callable[..., None]) -> None:
        """Launch the update of facets and points by `NeighborList.launch_parts`."""
        kernel = leave_out_torn(self._model.scalar)
        launch_parts(kernel, max(len(self._data.corner), len(self._data.along)), [*self._given, self._data], [])


def _springs(model: Model, surfaces: TouchingSurfaces, ends: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the spring between pairs of vertices, shape [..., 2], in the device's order; NONE if none.

    There is none at a vertex that is a mean of several particles.
    """
    whole = (surfaces.weight != 0).sum(axis=1) == 1
    particle = np.take_along_axis(surfaces.particle, np.abs(surfaces.weight).argmax(axis=1)[:, None], axis=1)[:, 0]
    found = connection_between(model.system, particle[ends])
    on_device = model.in_system_order(np.arange(model.connection_count))[found]
    return np.where(whole[ends].all(axis=-1) & (found >= 0), on_device, NONE)
