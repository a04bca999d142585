"""ContactSurfaces: vertices, points, facets and bodies for contact, and their constants on a device."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces
from ..device.csr import rows
from ..device.vector_arrays import in_records
from ..model.model import Model
from .tables_by_world import Repeated, surfaces_by_row


class ContactSurfaces:
    """The surfaces of the bodies of a system, in one world or many."""

    data: Any = None
    """The struct of the arrays; None before `upload`."""

    def __init__(self, model: Model, surfaces: TouchingSurfaces, shape: NDArray[np.float64]) -> None:
        self.on_host, self.by_row = surfaces, surfaces_by_row(model, surfaces)
        """The surfaces; and the surfaces with the stiffness and thickness of each row of worlds."""
        corner = surfaces.corner
        self.triangles = bool((corner[:, 1] != corner[:, 2]).any())
        self.grains = bool((corner == corner[:, :1]).all()) and len(corner) == len(surfaces.solid)
        """Whether each body is a grain; then facets and bodies have the same indices."""
        self.body_of_point, self.body_of_facet = surfaces.body[surfaces.ends[:, 0]], surfaces.body[corner[:, 0]]
        self.shape = surfaces.points(shape)
        """Positions of the vertices for particles at `shape` [m]."""
        _, self._midpoint = sides_between(surfaces)
        self.density = densities(surfaces, self.shape, self.body_of_point, self._midpoint)
        """Stiffness of each point as a fraction of that of an independent vertex, in proportion to its area."""
        self.around = np.zeros(len(surfaces.particle))
        """Sum of this at each vertex, over the points around it."""
        np.add.at(self.around, surfaces.ends[:, 0], self.density * (1 - surfaces.fraction))
        np.add.at(self.around, surfaces.ends[:, 1], self.density * surfaces.fraction)

    def upload(self, data: Any, model: Model, each: Repeated, hops: NDArray[np.int64]) -> None:
        """Fill the struct that kernels read; each body has no self-contact within its number `hops` of edges."""
        self.data, surfaces, scalar = data, self.on_host, model.scalar
        vertices, bodies = len(surfaces.particle), len(surfaces.solid)
        present = surfaces.weight != 0
        data.first = each.starts(present.sum(axis=1))
        data.particle = each.alike(surfaces.particle[present], int, model.stride)
        data.weight = each.alike(surfaces.weight[present], scalar)
        inverse = np.broadcast_to(1.0 / model.row_of("mass"), (len(model.row_of("mass")), model.particle_count))
        data.mobility = each.by_row((surfaces.weight**2 * inverse[:, surfaces.particle]).sum(axis=2), scalar)
        first, near = neighbourhoods(surfaces, hops)
        data.first_near, data.near = each.starts(np.diff(first)), each.alike(near, int, vertices)
        data.tangled = wp.zeros(model.worlds * vertices, dtype=int, device=model.device)
        data.body_of = each.alike(surfaces.body, int, bodies)
        data.x, data.v = (in_records(model.worlds * vertices, model.dim, scalar, model.device) for _ in "xv")
        start = np.einsum("vk,rvkd->rvd", surfaces.weight, model.row_of("position")[:, surfaces.particle])
        wp.copy(data.x, each.by_row(start.astype(model.dtype), model.vector))
        data.force, data.touching = (
            wp.zeros((model.worlds * vertices, many), dtype=wp.int64, device=model.device) for many in (3, 2)
        )
        mass = np.full((len(model.row_of("mass")), model.stride), np.inf)
        mass[:, : model.particle_count] = model.row_of("mass")
        data.inverse_mass = each.by_row(1.0 / mass, scalar)
        data.ends, data.fraction = (
            each.alike(surfaces.ends, wp.vec2i, vertices),
            each.alike(surfaces.fraction, scalar),
        )
        data.body = each.alike(self.body_of_point, int, bodies)
        data.density = each.alike(self.density, scalar)
        first, second = self.around[surfaces.ends].T
        data.crowd = each.alike(first + surfaces.fraction * (second - first), scalar)
        host = hosts(surfaces, self._midpoint)
        data.host = each.alike(np.where(host < 0, -(2**30), host), int, len(surfaces.corner))  # below 0 in all
        data.corner = each.alike(surfaces.corner, wp.vec3i, vertices)
        data.owner = each.alike(self.body_of_facet, int, bodies)
        data.solid = each.alike(surfaces.solid.astype(np.int32), int)
        for name in ("stiffness", "radius", "spacing"):
            setattr(data, name, each.by_row(np.array([getattr(one, name) for one in self.by_row]), scalar))

    def by_particle(self, data: Any, model: Model) -> NDArray[np.bool_]:
        """Write the vertices that depend on each particle of a world; return a mask of particles with any."""
        surfaces, device = self.on_host, model.device
        present = surfaces.weight != 0
        order, first = rows(surfaces.particle[present], model.particle_count)
        vertex = np.repeat(np.arange(len(present)), present.sum(axis=1))
        data.first, data.vertex = (wp.array(one, dtype=int, device=device) for one in (first, vertex[order]))
        data.weight = wp.array(surfaces.weight[present][order], dtype=model.scalar, device=device)
        return np.diff(first) > 0


def bearing_vertices(surfaces: TouchingSurfaces) -> NDArray[np.int64]:
    """Return the number of independent vertices of each body: at most the number of particles they depend on."""
    bodies = len(surfaces.solid)
    carriers = np.unique(surfaces.particle[surfaces.weight != 0])
    carrying = np.bincount(surfaces.body_of_particle[carriers], minlength=bodies)
    return np.minimum(carrying, np.bincount(surfaces.body, minlength=bodies))


def densities(
    surfaces: TouchingSurfaces,
    x: NDArray[np.float64],
    body: NDArray[np.int32],
    midpoint: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the stiffness of contact at each point, as a fraction of its body's contact stiffness.

    It is proportional to the area around the point, and sums in a body to its number of independent vertices. Half
    of a triangle's area, or of a segment's length, belongs to its corners. The other half belongs to the midpoints
    of its sides, where these are points. Vertices are at x [m], shape [vertex_count, 3]; `midpoint` is from
    `sides_between`.
    """
    corner = surfaces.corner
    a, b, c = x[corner].transpose(1, 0, 2)
    triangle, grain = corner[:, 1] != corner[:, 2], corner[:, 0] == corner[:, 1]
    size = np.where(triangle, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1), np.linalg.norm(b - a, axis=1))
    half = 0.5 * np.where(grain, 1.0, size)
    corners, sides = np.where(triangle, 3, np.where(grain, 1, 2)), np.where(triangle, 3, np.where(grain, 0, 1))
    own = np.zeros(len(body))
    for k in range(3):
        present = k < corners
        np.add.at(own, corner[present, k], half[present] / corners[present])
    for k in range(3):
        present = (k < sides) & (midpoint[:, k] >= 0)
        np.add.at(own, midpoint[present, k], half[present] / sides[present])
    total = np.bincount(body, own, len(surfaces.solid))
    return own * (bearing_vertices(surfaces) / np.maximum(total, 1e-300))[body]


def sides_between(surfaces: TouchingSurfaces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return a number for each side of each facet, and the contact point on its middle, -1: none.

    Both have the shape [facet_count, 3]. Facets on both sides of an edge have the same number for it.
    """
    vertices, corner = len(surfaces.particle), surfaces.corner

    def keys(ends: NDArray[np.integer]) -> NDArray[np.int64]:
        return np.sort(ends.astype(np.int64), axis=-1) @ np.array([vertices, 1])

    sides = np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1)
    key, of_side = np.unique(keys(sides), return_inverse=True)
    point, middles = np.full(len(key), -1), surfaces.ends[vertices:]
    point[np.searchsorted(key, keys(middles))] = vertices + np.arange(len(middles))
    return of_side.reshape(corner.shape), point[of_side].reshape(corner.shape)


def parts_of_facets(surfaces: TouchingSurfaces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return a number for each corner and side of each facet, and the contact points there; -1: there is none.

    Both have the shape [facet_count, 6]: three corners, then three sides. Facets that share a part have the same
    number for it. The corners of a segment are two and that of a grain is one, and both have one side.
    """
    corner, (side, midpoint) = surfaces.corner, sides_between(surfaces)
    part = np.concatenate([corner, len(surfaces.particle) + side], axis=1, dtype=np.int64)
    part[corner[:, 1] == corner[:, 2], 2] = part[corner[:, 0] == corner[:, 1], 1] = -1
    part[corner[:, 1] == corner[:, 2], 4:] = -1
    return part, np.concatenate([corner, midpoint], axis=1, dtype=np.int64)


def hosts(surfaces: TouchingSurfaces, midpoint: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each point a triangle on which it lies, -1 if it is on none; `midpoint` from `sides_between`."""
    corner, found = surfaces.corner, np.full(len(surfaces.ends) + 1, -1)  # the last stands for no point
    triangles = np.flatnonzero(corner[:, 1] != corner[:, 2])
    for points in (corner, midpoint):
        found[points[triangles]] = triangles[:, None]
    return found[:-1]


def neighbourhoods(
    surfaces: TouchingSurfaces, hops: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the row of each vertex starts, and rows: the vertices within `hops` edges, and itself."""
    count, corner = len(surfaces.particle), surfaces.corner
    vertex = near = np.arange(count)
    if not hops.any():
        return np.arange(count + 1), near
    a, b = np.concatenate([corner[:, [k, k + step]] for k in range(3) for step in (-1, -2)]).astype(np.int64).T
    from_end, to_end = np.divmod(np.unique((a * count + b)[a != b]), count)
    degree = np.bincount(from_end, minlength=count)
    first = np.append(0, np.cumsum(degree))
    for hop in range(1, int(hops.max(initial=0)) + 1):
        on = hops[surfaces.body[vertex]] >= hop
        further = degree[near[on]]
        begins = np.repeat(first[near[on]] - np.append(0, np.cumsum(further)[:-1]), further)
        added = to_end[begins + np.arange(len(begins))]
        both = np.concatenate([vertex, np.repeat(vertex[on], further)]), np.concatenate([near, added])
        vertex, near = np.divmod(np.unique(both[0] * count + both[1]), count)
    return np.append(0, np.cumsum(np.bincount(vertex, minlength=count))), near
