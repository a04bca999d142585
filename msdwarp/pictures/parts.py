"""The parts of a drawing, each a set of triangles that moves, and what gives some of them colours that move."""

import functools
import itertools
from typing import Any, NamedTuple, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import Surface
from ..kernels.pictures import drawing
from ..world import Collider
from .collider_meshes import Mesh, pose_in_space

NO_CONNECTIONS = np.zeros((0, 2), np.int32)


class Finish(NamedTuple):
    """What a part looks like, as long as its colours tell nothing."""

    colour: NDArray[np.float64]
    """Red, green and blue in 0 … 1, shape [3], or of each vertex, shape [vertex_count, 3]."""
    texture: NDArray[np.uint8] | None = None
    """The image in place of the colour, shape [height, width, 3]."""
    gloss: float = 0.0
    """Strength of highlights, 0 … 1."""


class Part(Protocol):
    """Some of the triangles of a drawing.

    `uv` of shape [vertex_count, 2] are where its vertices are in its texture; `triangles` of shape
    [triangle_count, 3] counts its own vertices from 0; `radius` is how far it reaches around the particles [m];
    `moves` tells whether it is not always in the same place, `closed` whether its backs are hidden by its fronts.
    """

    uv: NDArray[np.float64]
    finish: Finish
    triangles: NDArray[np.int32]
    radius: float
    moves: bool
    closed: bool

    def place(self, x: wp.array, time: float, points: wp.array, normals: wp.array) -> None:
        """Write what has changed when the particles are at x and it is `time`, arrays of vec3 all."""
        ...


class BodyPart(Part, Protocol):
    """Triangles that follow the particles."""

    def mixture(self) -> tuple[NDArray, NDArray]:
        """Return the particles whose values each vertex mixes, and its shares of them: [vertex_count, k] both."""
        ...


class SurfacePart:
    """The surface of a system. Flat shading gives every triangle vertices of its own, and so does tearing.

    A triangle is not drawn once it has parted: when is in `parted_at` [s], shape [triangle_count]; None where none
    can. One that tearing lays bare is drawn only `since` then [s], of the same shape.
    """

    radius = 0.0

    moves = True

    def __init__(
        self,
        surface: Surface,
        finish: Finish,
        smooth: bool,
        device: str,
        parted_at: NDArray | None = None,
        since: NDArray | None = None,
    ) -> None:
        vertices, own = len(surface.particle), not smooth or parted_at is not None
        self._parted_at = None if parted_at is None else wp.array(parted_at, dtype=float, device=device)
        self._since = None if since is None else wp.array(since, dtype=float, device=device)
        use = surface.triangles.ravel() if own else np.arange(vertices)
        self.uv, self.finish = surface.uv[use], finish
        self.triangles = surface.triangles
        self.closed = parted_at is None and is_closed(surface)
        normal_of = surface.normal_of
        if own:
            self.triangles = np.arange(len(use), dtype=np.int32).reshape(-1, 3)
            normal_of = _normals_shared(use, normal_of) if smooth else None
        self._particle = wp.array(surface.particle[use], dtype=int, device=device)
        self._weights = None
        if surface.weights is not None:
            self._weights = wp.array(surface.weights[use], dtype=float, device=device)
        self._triangles = wp.array(self.triangles, dtype=wp.vec3i, device=device)
        self._normal_of = wp.array(
            np.arange(len(use)) if normal_of is None else normal_of, dtype=int, device=device
        )
        self._sums = wp.zeros(len(use), dtype=wp.vec3, device=device)

    def place(self, x: wp.array, time: float, points: wp.array, normals: wp.array) -> None:
        """Move the vertices with their particles, and find the normals anew."""
        if self._weights is None:
            _launch(drawing.place_vertices, len(points), [x, self._particle], [points])
        else:
            _launch(drawing.place_mixtures, len(points), [x, self._particle, self._weights], [points])
        if self._parted_at is not None:
            _launch(drawing.collapse, len(self._parted_at), [self._parted_at, time, 3], [points])
        if self._since is not None:
            _launch(drawing.collapse_until, len(self._since), [self._since, time, 3], [points])
        self._sums.zero_()
        _launch(
            drawing.add_face_normals,
            len(self._triangles),
            [points, self._triangles, self._normal_of],
            [self._sums],
        )
        _launch(drawing.take_normals, len(points), [self._sums, self._normal_of], [normals])

    def mixture(self) -> tuple[NDArray, NDArray]:
        """Return the particles and weights of the surface's vertices."""
        if self._weights is None:
            return _alone(self._particle.numpy())
        return self._particle.numpy(), self._weights.numpy()


class Tubes:
    """A tube of some sides along each of some connections, shape [any, 2], while these are whole."""

    moves = True

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
        self._broken_at = None if broken_at is None else wp.array(broken_at, dtype=float, device=device)

    def place(self, x: wp.array, time: float, points: wp.array, normals: wp.array) -> None:
        """Lay the tubes between their particles."""
        inputs = [x, self.connections, self.radius, self.corners // 2]
        _launch(drawing.place_tubes, len(self.connections), inputs, [points, normals])
        if self._broken_at is not None:
            _launch(drawing.collapse, len(self._broken_at), [self._broken_at, time, self.corners], [points])

    def mixture(self) -> tuple[NDArray, NDArray]:
        """Return the particle at the end where each vertex is: at the start and the end in turn."""
        return _alone(np.tile(self.connections.numpy(), (1, self.corners // 2)).ravel())


class Balls:
    """A ball at each of some particles, shape [any]; its colour is one for all, or of each, shape [any, 3].

    Those that have the colours of connections have one each, `along`, shape [any, 2].
    """

    moves = True
    closed = True

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
        directions, triangles = round_solid(halvings)
        n, count = len(directions), len(particles)
        self.triangles = (n * np.arange(count)[:, None, None] + triangles).reshape(-1, 3).astype(np.int32)
        self.uv, self.finish = np.zeros((n * count, 2)), finish
        if finish.colour.ndim > 1:
            self.finish = finish._replace(colour=np.repeat(finish.colour, n, axis=0))
        self.radius = radius
        self.corners = n
        self.connections = wp.array(along, dtype=wp.vec2i, device=device)
        self._particles = wp.array(particles, dtype=int, device=device)
        self._directions = wp.array(directions, dtype=wp.vec3, device=device)
        self._normals = wp.array(np.tile(directions, (count, 1)), dtype=wp.vec3, device=device)

    def place(self, x: wp.array, time: float, points: wp.array, normals: wp.array) -> None:
        """Put the balls where their particles are."""
        inputs = [x, self._particles, self._directions, self.radius]
        _launch(drawing.place_balls, (len(self._particles), len(self._directions)), inputs, [points])
        wp.copy(normals, self._normals)

    def mixture(self) -> tuple[NDArray, NDArray]:
        """Return the particle in the middle of each vertex's ball."""
        return _alone(np.repeat(self._particles.numpy(), len(self._directions)))


class Obstacle:
    """A solid collider; one that `moves` follows its pose."""

    radius = 0.0
    closed = True

    def __init__(self, collider: Collider, mesh: Mesh, dim: int, finish: Finish, device: str) -> None:
        self.uv, self.finish, self.triangles = mesh.uv, finish, mesh.triangles
        self.moves = collider.motion is not None
        self._collider, self._dim = collider, dim
        self._points = wp.array(mesh.points, dtype=wp.vec3, device=device)
        self._normals = wp.array(mesh.normals, dtype=wp.vec3, device=device)

    def place(self, x: wp.array, time: float, points: wp.array, normals: wp.array) -> None:
        """Turn and shift the mesh to where the collider is at `time` [s]."""
        turn, shift = pose_in_space(self._collider, time, self._dim)
        pose = [wp.mat33(*turn.ravel()), wp.vec3(*shift)]
        _launch(drawing.place_rigid, len(points), [self._points, self._normals, *pose], [points, normals])


class Paint(Protocol):
    """What gives a part of the body its colours when they change."""

    def apply(self, x: wp.array, shares: wp.array, colours: wp.array) -> None:
        """Write colours, where the particles are at x and have values that are such shares of the full one."""
        ...


class StrainPaint:
    """Colours of tubes or balls by the strain of their connections, from blue (shorter than at rest) to red."""

    def __init__(self, tubes: Tubes | Balls, rest_length: NDArray, full_strain: float, device: str) -> None:
        self._tubes = tubes
        self._rest_length = wp.array(rest_length, dtype=float, device=device)
        self._full_strain = full_strain
        self._stops = wp.array(drawing.STRAIN_STOPS, dtype=wp.vec3, device=device)

    def apply(self, x: wp.array, shares: wp.array, colours: wp.array) -> None:
        """Colour the tubes of connections between particles at x."""
        connections = self._tubes.connections
        inputs = [x, connections, self._rest_length, self._full_strain, self._tubes.corners, self._stops]
        _launch(drawing.colour_by_strain, len(connections), inputs, [colours])


class ValuePaint:
    """Colours of a part of the body by values of its particles."""

    def __init__(self, part: BodyPart, device: str) -> None:
        particle, weights = part.mixture()
        self._particle = wp.array(particle, dtype=int, device=device)
        self._weights = wp.array(weights, dtype=float, device=device)
        self._stops = wp.array(drawing.VALUE_STOPS, dtype=wp.vec3, device=device)

    def apply(self, x: wp.array, shares: wp.array, colours: wp.array) -> None:
        """Colour the part by values that are such shares of the full one."""
        inputs = [shares, self._particle, self._weights, self._stops]
        _launch(drawing.colour_by_value, len(colours), inputs, [colours])


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


def _alone(particle: NDArray) -> tuple[NDArray, NDArray]:
    """Return the mixtures of vertices that are each of one particle, shape [vertex_count]."""
    return particle[:, None], np.ones((len(particle), 1), np.float32)


def _launch(kernel: Any, dim: int | tuple[int, ...], inputs: list, outputs: list[wp.array]) -> None:
    """Launch on the device of the first output."""
    wp.launch(kernel, dim, inputs, outputs, device=outputs[0].device)


@functools.cache
def round_solid(halvings: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return (points, triangles) of an icosahedron on the unit sphere, its edges halved so many times."""
    golden = (1 + np.sqrt(5)) / 2
    plane = [(0.0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([np.roll(corner, k) for k in range(3) for corner in plane])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    triples = np.array(list(itertools.combinations(range(12), 3)))
    sides = np.linalg.norm(points[triples] - points[np.roll(triples, 1, axis=1)], axis=2)
    triangles = triples[(sides < 1.1).all(axis=1)]  # edges are 1.05 long, and other distances 1.7 at least
    inwards = np.linalg.det(points[triangles]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    for _ in range(halvings):
        a, b, c = triangles.T
        pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        edges, edge = np.unique(pairs, axis=0, return_inverse=True)
        ab, bc, ca = len(points) + edge.reshape(3, -1)
        points = np.concatenate([points, points[edges].mean(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        triangles = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
    return points, triangles
