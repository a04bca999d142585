"""The parts of a drawing, each a set of triangles that moves, and what gives some of them colours that move."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import Surface
from ..kernels.pictures import drawing
from ..shapes import icosphere
from ..world import Collider
from .collider_meshes import Mesh, pose_in_space

NO_CONNECTIONS = np.zeros((0, 2), np.int32)
Paint = Callable[[wp.array, wp.array], None]
"""Writes a part's colours where the particles are at x and have such shares of the full value."""


class Finish(NamedTuple):
    """What a part looks like, as long as its colours show no values.

    `colour` is of shape [3], or [vertex_count, 3], in 0 … 1; the image `texture` replaces it.
    """

    colour: NDArray[np.float64]
    texture: NDArray[np.uint8] | None = None
    gloss: float = 0.0


class Part:
    """Some of the triangles of a drawing, with a slice of each of its arrays of vertices."""

    vertices: slice
    points: wp.array
    normals: wp.array
    colours: wp.array
    uv: NDArray[np.float64]
    """Where its vertices are in its texture, shape [vertex_count, 2]."""
    triangles: NDArray[np.int32]
    """Shape [triangle_count, 3], of its own vertices; of the drawing's once it is in one."""
    finish: Finish
    radius = 0.0
    """How far it reaches around the particles [m]."""
    moves = True
    """Whether it is not always in the same place."""
    closed = True
    """Whether its backs are hidden by its fronts."""
    mixture: tuple[wp.array, wp.array]
    """Of what follows the particles: those that each vertex mixes, and their shares, shape [vertex_count, k]."""
    paint: Paint | None = None
    """What gives it colours that move."""

    def join(self, vertices: slice, points: Any, normals: Any, colours: Any) -> None:
        """Become part of a drawing, with some of its vertices, from whose arrays of vec3 this takes its own."""
        self.vertices, self.triangles = vertices, self.triangles + np.int32(vertices.start)
        self.points, self.normals, self.colours = points[vertices], normals[vertices], colours[vertices]

    def place_vertices(self, x: wp.array) -> None:
        """Put each vertex where its particles are, or its radius from there along its normal."""
        inputs = [x, *self.mixture, self.radius, self.normals]
        _launch(drawing.place_vertices, len(self.points), inputs, [self.points])

    def follow(self, x: wp.array, time: float) -> None:
        """Move to where it is when the particles are at x, an array of vec3, and it is `time` [s]."""


class SurfacePart(Part):
    """The surface of a system. Flat shading gives every triangle vertices of its own, and so does tearing.

    A triangle is not drawn once it has parted: when is in `parted_at` [s], shape [triangle_count]; None where none
    can. One that tearing lays bare is drawn only `since` then [s], of the same shape.
    """

    def __init__(
        self,
        surface: Surface,
        finish: Finish,
        smooth: bool,
        device: str,
        parted_at: NDArray | None = None,
        since: NDArray | None = None,
    ) -> None:
        own = not smooth or parted_at is not None
        self._times = _times(since, parted_at, device)
        use = surface.triangles.ravel() if own else np.arange(len(surface.particle))
        self.uv, self.finish, self.triangles = surface.uv[use], finish, surface.triangles
        self.closed = parted_at is None and is_closed(surface)
        normal_of = surface.normal_of
        if own:
            self.triangles = np.arange(len(use), dtype=np.int32).reshape(-1, 3)
            normal_of = _normals_shared(use, normal_of) if smooth else None
        if surface.weights is None:
            self.mixture = _alone(surface.particle[use], device)
        else:
            weights = wp.array(surface.weights[use], dtype=float, device=device)
            self.mixture = wp.array(surface.particle[use], dtype=int, device=device), weights
        self._triangles = wp.array(self.triangles, dtype=wp.vec3i, device=device)
        normal_of = np.arange(len(use)) if normal_of is None else normal_of
        self._normal_of = wp.array(normal_of, dtype=int, device=device)
        self._sums = wp.zeros(len(use), dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Move the vertices with their particles, and find the normals anew."""
        self.place_vertices(x)
        _collapse(self._times, time, 3, self.points)
        self._sums.zero_()
        inputs = [self.points, self._triangles, self._normal_of]
        _launch(drawing.add_face_normals, len(self._triangles), inputs, [self._sums])
        _launch(drawing.take_normals, len(self.points), [self._sums, self._normal_of], [self.normals])


class Tubes(Part):
    """A tube of some sides along each of some springs, shape [any, 2], while these are whole."""

    def __init__(
        self,
        connections: NDArray,
        radius: float,
        finish: Finish,
        device: str,
        *,
        sides: int = 3,
        broken_at: NDArray | None = None,
    ) -> None:
        self.corners = 2 * sides
        along = np.arange(0, self.corners, 2)[:, None]
        ahead = (along + 2) % self.corners
        side = np.stack([along, ahead, along + 1, along + 1, ahead, ahead + 1], axis=-1).reshape(-1, 3)
        first = self.corners * np.arange(len(connections))[:, None, None]
        self.triangles = (first + side).reshape(-1, 3).astype(np.int32)
        self.uv, self.finish = np.zeros((self.corners * len(connections), 2)), finish
        self.radius = radius
        self.closed = sides == 3  # so thin that no end is seen from inside
        self.connections = wp.array(connections, dtype=wp.vec2i, device=device)
        self.mixture = _alone(np.tile(connections, (1, sides)).ravel(), device)  # start and end in turn
        self._times = _times(None, broken_at, device)

    def follow(self, x: wp.array, time: float) -> None:
        """Lay the tubes between their particles."""
        inputs = [x, self.connections, self.radius, self.corners // 2]
        _launch(drawing.place_tubes, len(self.connections), inputs, [self.points, self.normals])
        _collapse(self._times, time, self.corners, self.points)


class Balls(Part):
    """A ball at each of some particles, shape [any]; its colour is one for all, or of each, shape [any, 3].

    Those that have the colours of springs have one each, `along`, shape [any, 2].
    """

    def __init__(
        self,
        particles: NDArray,
        radius: float,
        finish: Finish,
        device: str,
        *,
        halvings: int = 1,
        along: NDArray = NO_CONNECTIONS,
    ) -> None:
        directions, triangles = icosphere(1.0, halvings)
        n, count = len(directions), len(particles)
        self.triangles = (n * np.arange(count)[:, None, None] + triangles).reshape(-1, 3).astype(np.int32)
        self.uv, self.finish = np.zeros((n * count, 2)), finish
        if finish.colour.ndim > 1:
            self.finish = finish._replace(colour=np.repeat(finish.colour, n, axis=0))
        self.radius, self.corners = radius, n
        self.connections = wp.array(along, dtype=wp.vec2i, device=device)
        self.mixture = _alone(np.repeat(particles, n), device)
        self._normals = wp.array(np.tile(directions, (count, 1)), dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Put the balls where their particles are."""
        wp.copy(self.normals, self._normals)
        self.place_vertices(x)


class Obstacle(Part):
    """A solid collider; one that `moves` follows its pose."""

    def __init__(self, collider: Collider, mesh: Mesh, dim: int, finish: Finish, device: str) -> None:
        self.uv, self.finish, self.triangles = mesh.uv, finish, mesh.triangles
        self.moves = collider.motion is not None
        self._collider, self._dim = collider, dim
        self._points = wp.array(mesh.points, dtype=wp.vec3, device=device)
        self._normals = wp.array(mesh.normals, dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Turn and shift the mesh to where the collider is."""
        turn, shift = pose_in_space(self._collider, time, self._dim)
        inputs = [self._points, self._normals, wp.mat33(*turn.ravel()), wp.vec3(*shift)]
        _launch(drawing.place_rigid, len(self.points), inputs, [self.points, self.normals])


def strain_paint(part: Tubes | Balls, rest_length: NDArray, full_strain: float, device: str) -> Paint:
    """Return what colours tubes or balls by the strain of springs, from blue (shorter than at rest) to red."""
    lengths = wp.array(rest_length, dtype=float, device=device)
    stops = wp.array(drawing.STRAIN_STOPS, dtype=wp.vec3, device=device)

    def paint(x: wp.array, shares: wp.array) -> None:
        inputs = [x, part.connections, lengths, full_strain, part.corners, stops]
        _launch(drawing.colour_by_strain, len(part.connections), inputs, [part.colours])

    return paint


def value_paint(part: Part, device: str) -> Paint:
    """Return what colours a part of the body by values of its particles."""
    stops = wp.array(drawing.VALUE_STOPS, dtype=wp.vec3, device=device)

    def paint(x: wp.array, shares: wp.array) -> None:
        _launch(drawing.colour_by_value, len(part.colours), [shares, *part.mixture, stops], [part.colours])

    return paint


def is_closed(surface: Surface) -> bool:
    """Tell whether a surface has no edge: each side of a triangle is that of another, the other way round."""
    if surface.weights is None:
        place = surface.particle
    else:
        mixture = np.concatenate([surface.particle, surface.weights], axis=1)
        place = np.unique(mixture, axis=0, return_inverse=True)[1].ravel()
    corners = place[surface.triangles].astype(np.int64)
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    count = int(place.max(initial=0)) + 1
    return bool(np.array_equal(np.sort(start * count + end), np.sort(end * count + start)))


def _normals_shared(use: NDArray, normal_of: NDArray | None) -> NDArray:
    """Return the corner whose normal each corner of triangles takes, whose vertices are `use`.

    Corners at vertices that take the same normal take that of the first of them.
    """
    vertex = use if normal_of is None else normal_of[use]
    _, first, which = np.unique(vertex, return_index=True, return_inverse=True)
    return first[which.ravel()]


def _alone(particle: NDArray, device: Any) -> tuple[wp.array, wp.array]:
    """Return the mixtures of vertices that are each of one particle, shape [vertex_count]."""
    return wp.array(particle[:, None], dtype=int, device=device), wp.full((len(particle), 1), 1.0, device=device)


def _times(since: NDArray | None, until: NDArray | None, device: str) -> list[wp.array] | None:
    """Return when pieces are seen first, by default at once, and last [s]; None where that is never."""
    if until is None:
        return None
    return [
        wp.array(each, dtype=float, device=device)
        for each in (np.zeros(len(until)) if since is None else since, until)
    ]


def _collapse(times: list[wp.array] | None, time: float, corners: int, points: wp.array) -> None:
    """Hide the pieces of so many corners each that are not seen at this time [s]."""
    if times is not None:
        _launch(drawing.collapse, len(times[0]), [*times, time, corners], [points])


def _launch(kernel: Any, dim: int, inputs: list, outputs: list[wp.array]) -> None:
    """Launch on the device of the first output."""
    wp.launch(kernel, dim, inputs, outputs, device=outputs[0].device)
