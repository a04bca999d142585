"""Triangles of a system's surface on a device, and their vertices, for loads that act on them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import Facets, facets_of
from ...kernels.loads.surface_triangles import mix_vertices, triangles
from ...world import EnclosedGas, Load, Pressure, Wind
from ..device.csr import rows
from ..device.device import upload_fields
from ..model.effect import Effect
from ..model.model import Model


class Faces:
    """Triangles of a surface that several loads act on, concatenated by load."""

    def __init__(self, parts: Sequence[Facets], particle_count: int) -> None:
        self.facets, self._count = parts[0], particle_count
        """The facets of the first load; all loads use the same vertices."""
        self.mixed: bool = parts[0].mixed
        """Whether vertices are weighted means of particles; else they are particles."""
        self.corner: NDArray[np.int32] = np.concatenate([one.corner for one in parts])
        """The vertices of each triangle, shape [triangle_count, 3]."""
        self.closed: NDArray[np.bool_] = np.concatenate([one.closed for one in parts])
        """Whether each triangle belongs to a closed surface, shape [triangle_count]."""
        self.of: NDArray[np.int64] = np.repeat(np.arange(len(parts)), [len(one.corner) for one in parts])
        """Index of each triangle's load, shape [triangle_count]."""
        self.ends: NDArray[np.int64] = np.cumsum([0, *(len(one.corner) for one in parts)])
        """Index of each load's first triangle, then the total number, shape [load_count + 1]."""

    def members(self) -> NDArray[np.bool_]:
        """Return a mask of the particles that belong to a triangle, shape [particle_count]."""
        corners = np.zeros(len(self.facets.particle))
        corners[self.corner.ravel()] = 1.0
        return self.bound(corners) > 0

    def bound(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return bounds of a matrix's row sums by particle, given row sums by vertex; see `Facets.bound`."""
        return self.facets.bound(sums, self._count) if self.mixed else sums

    def add_to_corners(self, values: NDArray[np.float64], corner: NDArray[np.int32] | None = None) -> NDArray:
        """Return the sum at each vertex of values of the triangles around it."""
        result = np.zeros((len(self.facets.particle), *values.shape[1:]))
        np.add.at(result, self.corner if corner is None else corner, values[:, None])
        return result

    def on(self, model: Model, vertices: "EmbeddedVertices | None") -> tuple[Any, tuple[str, ...]]:
        """Return the struct of these triangles, and its arrays that have a part for each world."""
        triangle = np.repeat(np.arange(len(self.corner)), 3)
        particle, total = self.corner.ravel(), np.zeros(0)
        if self.mixed:  # a particle's weight in a triangle is the sum of its weights in the triangle's corners
            entry = triangle[:, None] * np.int64(self._count) + self.facets.particle[particle]
            weight = self.facets.weight[particle] / 3
            different, number = np.unique(entry[weight != 0], return_inverse=True)
            total = np.bincount(number, weights=weight[weight != 0])
            triangle, particle = np.divmod(different, self._count)
        order, first = rows(particle, self._count)
        faces = triangles(model.dim, model.scalar, self.mixed)()
        upload_fields(faces, model.device, corner=self.corner, first=first, number=triangle[order])
        if vertices is None:
            return faces, ()
        upload_fields(faces, model.device, weight=total[order])
        faces.x, faces.v = vertices.x, vertices.v
        return faces, ("faces.x", "faces.v")


def area_vectors(corner: NDArray[np.int32], x: NDArray) -> NDArray[np.float64]:
    """Return the area vector of each triangle [m²], shape [triangle_count, 3], for vertices at x [m]."""
    a, b, c = (np.asarray(x[corner[:, k]], dtype=np.float64) for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def embedded_vertices_of(model: Model, loads: Sequence[Load]) -> "EmbeddedVertices | None":
    """Return the effect that loads on a surface with embedded vertices need; None if there are none."""
    on_facets = any(
        isinstance(one, Pressure | EnclosedGas) or (isinstance(one, Wind) and one.area is None) for one in loads
    )
    return EmbeddedVertices(model) if on_facets and facets_of(model.system).mixed else None


class EmbeddedVertices(Effect):
    """Computes a surface's vertices before forces are evaluated; loads read vertices like particles."""

    def __init__(self, model: Model) -> None:
        self._model, self.term, facets = model, None, facets_of(model.system)
        self._mix = model.kernels.note(mix_vertices(model.dim, model.scalar, model.compensated))
        self._particle = wp.array(facets.particle, dtype=int, device=model.device)
        self._weight = wp.array(facets.weight, dtype=model.scalar, device=model.device)
        count = model.worlds * len(facets.particle)
        self.x, self.v = (wp.zeros(count, dtype=model.vector, device=model.device) for _ in range(2))
        """Positions [m] and velocities [m/s] of the vertices, of all worlds."""

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the kernel that computes positions and velocities of vertices from x and v of particles."""
        inputs = [self._particle, self._weight, self._model.stride, compensation, x, v]
        wp.launch(self._mix, len(self.x), inputs, [self.x, self.v], device=self._model.device)
