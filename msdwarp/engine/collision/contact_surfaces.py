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

UNLIMITED = 1e30
"""A rate above that of any damper [1/s]."""


class ContactSurfaces:
    """The surfaces of the bodies of a system, in one world or many."""

    data: Any = None
    """The struct of the arrays; None before `upload`."""

    def __init__(self, model: Model, surfaces: TouchingSurfaces) -> None:
        self.on_host, self.by_row = surfaces, surfaces_by_row(model, surfaces)
        """The surfaces; and the surfaces with the stiffness and thickness of each row of worlds."""
        bodies, corner = len(surfaces.closed), surfaces.corner
        self.triangles = bool((corner[:, 1] != corner[:, 2]).any())
        self.grains = bool((corner == corner[:, :1]).all()) and len(corner) == bodies
        """Whether each body is a grain; then facets and bodies have the same indices."""
        # A lattice is at least one spacing thick. A point beyond its middle has entered from the other side.
        self.depth = [np.where(one.closed, 0.5 * one.spacing, 0.0) for one in self.by_row]
        """Largest depth from which each body pushes a point out [m], by row."""
        self.body_of_point, self.body_of_facet = surfaces.body[surfaces.ends[:, 0]], surfaces.body[corner[:, 0]]
        on_points = np.bincount(self.body_of_point, minlength=bodies)
        self.density = bearing_vertices(surfaces) / np.maximum(on_points, 1)
        """Independent vertices per point of each body."""

    def upload(self, data: Any, model: Model, each: Repeated, hops: NDArray[np.int64]) -> None:
        """Fill the struct that kernels read; each body has no self-contact within its number `hops` of edges."""
        self.data, surfaces, scalar = data, self.on_host, model.scalar
        vertices, bodies = len(surfaces.particle), len(surfaces.closed)
        present = surfaces.weight != 0
        data.first = each.starts(present.sum(axis=1))
        data.particle = each.alike(surfaces.particle[present], int, model.stride)
        data.weight = each.alike(surfaces.weight[present], scalar)
        inverse = np.broadcast_to(1.0 / model.row_of("mass"), (len(model.row_of("mass")), model.particle_count))
        data.mobility = each.by_row((surfaces.weight**2 * inverse[:, surfaces.particle]).sum(axis=2), scalar)
        first, near = neighbourhoods(surfaces, hops)
        data.first_near, data.near = each.starts(np.diff(first)), each.alike(near, int, vertices)
        if surfaces.closed.any():  # only contact with closed bodies reads triangles around a vertex
            facet, first = facets_around(surfaces)
            data.first_facet = each.starts(np.diff(first))
            data.facet = each.alike(facet, int, len(surfaces.corner))
        data.body_of = each.alike(surfaces.body, int, bodies)
        data.x, data.v = (in_records(model.worlds * vertices, model.dim, scalar, model.device) for _ in "xv")
        start = np.einsum("vk,rvkd->rvd", surfaces.weight, model.row_of("position")[:, surfaces.particle])
        wp.copy(data.x, each.by_row(start.astype(model.dtype), model.vector))
        data.force = wp.zeros((model.worlds * vertices, 3), dtype=wp.int64, device=model.device)
        mass = np.full((len(model.row_of("mass")), model.stride), np.inf)
        mass[:, : model.particle_count] = model.row_of("mass")
        data.inverse_mass = each.by_row(1.0 / mass, scalar)
        data.damping_limit = wp.full(model.worlds, UNLIMITED, dtype=scalar, device=model.device)
        data.ends, data.share = each.alike(surfaces.ends, wp.vec2i, vertices), each.alike(surfaces.share, scalar)
        data.body = each.alike(self.body_of_point, int, bodies)
        data.corner = each.alike(surfaces.corner, wp.vec3i, vertices)
        data.owner = each.alike(self.body_of_facet, int, bodies)
        data.closed = each.alike(surfaces.closed.astype(np.int32), int)
        data.depth, data.density = each.by_row(np.array(self.depth), scalar), each.alike(self.density, scalar)
        for name in ("stiffness", "radius"):
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
    bodies = len(surfaces.closed)
    carriers = np.unique(surfaces.particle[surfaces.weight != 0])
    carrying = np.bincount(surfaces.body_of_particle[carriers], minlength=bodies)
    return np.minimum(carrying, np.bincount(surfaces.body, minlength=bodies))


def facets_around(surfaces: TouchingSurfaces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles around each vertex, concatenated by vertex, and row starts by vertex."""
    corner = surfaces.corner
    triangles = np.flatnonzero(corner[:, 1] != corner[:, 2])
    order, first = rows(corner[triangles].reshape(-1), len(surfaces.particle))
    return np.repeat(triangles, 3)[order], first


def neighbourhoods(
    surfaces: TouchingSurfaces, hops: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row starts, and the neighbours of each vertex: all within `hops` edges, and the vertex itself."""
    count, corner = len(surfaces.particle), surfaces.corner
    edges = np.concatenate([corner[:, [k, k - 1]] for k in range(3)]).astype(np.int64)
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    degree = np.bincount(edges[:, 0], minlength=count)
    first = np.append(0, np.cumsum(degree))
    vertex = near = np.arange(count)
    for hop in range(1, int(hops.max(initial=0)) + 1):
        on = hops[surfaces.body[vertex]] >= hop
        further = degree[near[on]]
        begins = np.repeat(first[near[on]] - np.append(0, np.cumsum(further)[:-1]), further)
        added = edges[begins + np.arange(len(begins)), 1]
        both = np.concatenate([vertex, np.repeat(vertex[on], further)]), np.concatenate([near, added])
        vertex, near = np.divmod(np.unique(both[0] * count + both[1]), count)
    return np.append(0, np.cumsum(np.bincount(vertex, minlength=count))), near
