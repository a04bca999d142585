"""Sections: bodies cut by a plane where they are at the start; what is inside moves with the particles."""

import importlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import Surface, System, cells_of, connection_between, in_space, mask_of, pieces

FINE, APART = 0.6, 0.4
"""Largest distance of points on the rim of a section, and least distance of points inside from it, over the
spacing."""
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
"""Corners at the ends of the edges of a solid cell."""
_AT_ONCE = 1 << 22
"""Number of pairs of points that are compared at once: some tens of MB."""

Mixture = tuple[NDArray[np.int32], NDArray[np.float64]]
"""Particles and weights of points, both of shape [any, k]."""


class Clipped(NamedTuple):
    """The triangles of a surface on one side of a plane."""

    surface: Surface
    source: NDArray[np.intp]
    """The triangle of the whole surface that each one is part of, shape [triangle_count]."""
    rim: NDArray[np.int32]
    """Vertices of the sides in the plane that bound sections of solids, along their outlines, shape [any, 2]."""


class Section:
    """A plane normal·x = offset [m], with a unit normal, that cuts the bodies of a system where they are.

    What is above it, where its normal points to, is not drawn.
    """

    def __init__(self, system: System, normal: NDArray[np.float64], offset: float) -> None:
        self._system, self.normal = system, in_space(normal, np.float64)
        self.height = in_space(system.position, np.float64) @ self.normal - offset
        """Height of each particle above the plane [m], shape [particle_count]."""
        cells = cells_of(system) if system.dim == 3 else np.zeros((0, 8), dtype=np.int64)
        self._solid = mask_of(cells, system.particle_count)
        ends = cells[:, EDGES][np.diff(self.below[cells[:, EDGES]], axis=2)[..., 0]]
        self._edges = np.unique(np.sort(ends, axis=1), axis=0)
        """Particles at the ends of the edges of cells that the plane cuts, shape [any, 2]."""

    @property
    def below(self) -> NDArray[np.bool_]:
        """Mask of the particles that are not above the plane, shape [particle_count]."""
        return self.height <= 0

    def clip(self, surface: Surface) -> Clipped:
        """Return the part of a surface that is not above the plane."""
        particle, weights = surface.mixture
        height = (weights * self.height[particle]).sum(axis=1)
        of_solid = surface.triangles_in(self._solid)
        corners, above = surface.triangles.astype(np.int64), height[surface.triangles] > 0
        count = above.sum(axis=1)
        whole, source = np.flatnonzero(count == 0), np.arange(len(corners))
        # The corner that lies alone on its side of the plane comes first.
        first = np.where(count == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        a, b, c = np.take_along_axis(corners, (first[:, None] + np.arange(3)) % 3, axis=1).T
        one, two = (source[count == k] for k in (1, 2))
        cut = np.concatenate([one, two])
        ends = np.stack([np.stack([a[cut], b[cut]], axis=1), np.stack([a[cut], c[cut]], axis=1)], axis=1)
        pairs, number = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        p, q = (len(height) + number.reshape(-1, 2)).T
        n = len(one)
        left = [corners[whole]]
        left += [np.stack([b[one], c[one], q[:n]], axis=1), np.stack([b[one], q[:n], p[:n]], axis=1)]
        left += [np.stack([a[two], p[n:], q[n:]], axis=1)]
        i, j = pairs.T
        fraction = (height[i] / (height[i] - height[j]))[:, None]
        surface = Surface(
            particle=np.concatenate([np.tile(particle, (1, 2)), np.hstack([particle[i], particle[j]])]),
            weights=np.concatenate(
                [
                    np.hstack([weights, np.zeros(weights.shape)]),
                    np.hstack([(1 - fraction) * weights[i], fraction * weights[j]]),
                ]
            ),
            uv=np.concatenate([surface.uv, (1 - fraction) * surface.uv[i] + fraction * surface.uv[j]]),
            triangles=np.concatenate(left),
            normal_of=None
            if surface.normal_of is None
            else np.concatenate([surface.normal_of, len(height) + np.arange(len(pairs))]),
        )
        rim = np.concatenate([np.stack([q[:n], p[:n]], axis=1), np.stack([p[n:], q[n:]], axis=1)])
        return Clipped(surface, np.concatenate([whole, one, one, two]), rim[of_solid[cut]].astype(np.int32))

    def inside(self, clipped: Clipped) -> tuple[Surface | None, NDArray[np.float64] | None]:
        """Return the triangles in the plane within solids, None if there are none.

        Their corners are where the plane cuts edges of cells, and on the outlines. If the system tears, also
        return until when each is drawn [s]: until a connection breaks between its particles.
        """
        body = pieces(self._system.particle_count, self._system.connections)
        of_side, of_edge = (
            body[one] for one in (clipped.surface.mixture[0][clipped.rim[:, 0], 0], self._edges[:, 0])
        )
        found = None
        for one in np.unique(of_side):
            part = self._inside_of(clipped.surface, clipped.rim[of_side == one], self._edges[of_edge == one])
            found = found if part is None else part.behind(found, 0)
        if found is None or not self._system.broken.any():
            return found, None
        return found, self._whole_until(found)

    def _inside_of(self, surface: Surface, rim: NDArray[np.int32], edges: NDArray[np.int64]) -> Surface | None:
        """Return the triangles within one body, given sides of its outline and the edges that the plane cuts."""
        if not len(edges):
            return None
        position = in_space(self._system.position, np.float64)
        spacing = float(np.median(np.linalg.norm(np.diff(position[edges], axis=1), axis=2)))
        fraction = self.height[edges[:, 0]] / (self.height[edges[:, 0]] - self.height[edges[:, 1]])
        crossed = edges.astype(np.int32), np.stack([1 - fraction, fraction], axis=1)
        particle, weights = surface.mixture
        sides = _divided((particle[rim], weights[rim]), position, FINE * spacing)
        axes = np.linalg.svd(self.normal[None])[2][1:]
        axes[0] *= np.sign(np.linalg.det([*axes, self.normal]))  # seen from above, the second is left of the first

        def flat(points: Mixture) -> NDArray[np.float64]:
            return np.einsum("vk,vkd->vd", points[1], position[points[0]]) @ axes.T

        ends, middle = flat(sides).reshape(-1, 2, 2), flat(crossed)
        _, start = np.unique(np.round(ends[:, 0] / spacing, 6), axis=0, return_index=True)
        _, once = np.unique(np.round(middle / spacing, 6), axis=0, return_index=True)
        once = once[(_distances(middle[once], ends[:, 0]) > APART * spacing) & _within(middle[once], ends)]
        points = np.concatenate([ends[start, 0], middle[once]])
        triangles = _triangulated(points, spacing)
        triangles = triangles[_within(points[triangles].mean(axis=1), ends)]
        if not len(triangles):
            return None
        first = [one.reshape(len(ends), 2, -1)[start, 0] for one in sides]
        wider = ((0, 0), (0, first[0].shape[1] - 2))
        return Surface(
            particle=np.concatenate([first[0], np.pad(crossed[0][once], wider, mode="edge")]),
            weights=np.concatenate([first[1], np.pad(crossed[1][once], wider)]),
            uv=np.zeros((len(points), 2)),
            triangles=triangles,
        )

    def _whole_until(self, surface: Surface) -> NDArray[np.float64]:
        """Return the time when the first connection breaks between particles of each triangle, or inf [s]."""
        particle, weights = surface.mixture
        moves = np.where(weights != 0, particle, -1)[surface.triangles].reshape(len(surface.triangles), -1)
        pairs = moves[:, np.stack(np.triu_indices(moves.shape[1], 1), axis=1)]
        own = connection_between(self._system, np.maximum(pairs, 0))
        own[(pairs < 0).any(axis=2)] = -1
        return np.where(own < 0, np.inf, self._system.broken_at[own]).min(axis=1)


def _divided(ends: Mixture, position: NDArray, longest: float) -> Mixture:
    """Return sides, divided into pieces of at most this length [m].

    Both arguments and results are mixtures of the ends of sides, shape [side_count, 2, k] and [2 · piece_count,
    k].
    """
    particle, weights = ends
    places = np.einsum("sek,sekd->sed", weights, position[particle])
    count = np.maximum(np.ceil(np.linalg.norm(np.diff(places, axis=1)[:, 0], axis=1) / longest).astype(int), 1)
    side = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    fraction = np.stack([step, step + 1], axis=1) / count[side][:, None]
    both = np.stack([1 - fraction, fraction], axis=2)[..., None] * weights[side][:, None]
    carriers = np.broadcast_to(particle[side][:, None], both.shape)
    return carriers.reshape(2 * len(side), -1), both.reshape(2 * len(side), -1)


def _distances(points: NDArray, others: NDArray) -> NDArray[np.float64]:
    """Return the distance of each point from the nearest of other points, both of shape [any, 2]."""
    pieces = np.array_split(points, len(points) * len(others) // _AT_ONCE + 1)
    return np.concatenate([np.linalg.norm(one[:, None] - others, axis=2).min(axis=1) for one in pieces])


def _within(points: NDArray, sides: NDArray) -> NDArray[np.bool_]:
    """Return which points, shape [any, 2], are within outlines, given as sides, shape [any, 2, 2], in any order.

    Within, outlines wind around a point (also of bodies that overlap); each crosses a ray from it to the right.
    """
    (x0, y0), (x1, y1) = sides[:, 0].T, sides[:, 1].T
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    found = []
    for one in np.array_split(points, len(points) * len(sides) // _AT_ONCE + 1):
        x, y = one[:, :1], one[:, 1:]
        crosses = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) / rise * (x1 - x0))
        found.append((crosses * np.sign(y1 - y0)).sum(axis=1) != 0)
    return np.concatenate(found)


def _triangulated(points: NDArray, spacing: float) -> NDArray[np.int32]:
    """Return Delaunay's triangles of points, shape [any, 2], counter-clockwise: indices of shape [any, 3]."""
    if len(points) < 3:
        return np.zeros((0, 3), dtype=np.int32)
    pyvista = importlib.import_module("pyvista")
    # Points of a lattice lie on common circles, where the triangulation is not unique.
    moved = points + 1e-4 * spacing * np.random.default_rng(0).uniform(-1, 1, points.shape)
    flat = pyvista.PolyData(np.column_stack([moved / spacing, np.zeros(len(points))])).delaunay_2d()
    triangles = np.asarray(flat.regular_faces, dtype=np.int32).reshape(-1, 3)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.where(turn[:, None] < 0, triangles[:, ::-1], triangles)
