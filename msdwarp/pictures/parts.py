"""The parts of a drawing: sets of triangles that follow particles or colliders."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import Surface, broken_before
from ..kernels.pictures import drawing
from ..shapes import icosphere
from ..world import FINISHES, Collider, Reflectance
from .collider_meshes import Mesh, pose_in_space


class Finish(NamedTuple):
    """The look of a part whose colors show no values.

    `color` is of shape [3], or [vertex_count, 3], in 0 … 1; the image `texture` replaces it.
    """

    color: NDArray[np.float64]
    texture: NDArray[np.uint8] | None = None
    gloss: float = 0.0
    reflectance: Reflectance = FINISHES["matt"]


class Part:
    """A set of triangles of a drawing; its vertices are a slice of each of the drawing's arrays.

    A part may consist of tubes, of balls, or of triangles that tear apart: its pieces, which appear, disappear and
    are colored one by one.
    """

    name: str  # the look's group, or the kind of part
    vertices: slice
    points: wp.array
    normals: wp.array
    colors: wp.array
    uv: NDArray[np.float64]  # texture coordinates, shape [vertex_count, 2]
    triangles: NDArray[np.int32]  # the part's vertices, after `join` the drawing's, shape [triangle_count, 3]
    finish: Finish
    radius = 0.0  # reach around the particles [m]
    moves = True
    of_rope = (
        False  # whether curves can take its place: tubes of a rope, and balls that fill the gaps between them
    )
    is_one_body = False  # whether files of other programs have its pieces as one mesh, as of sand
    closed = True  # whether back faces are always hidden
    mixture: tuple[wp.array, wp.array]  # particles and weights of each vertex, shape [vertex_count, k]
    corners = 3  # vertices of each piece: of a tube, of a ball, or of a triangle that may part
    times: list[wp.array] | None = None  # times when pieces appear and disappear [s]; None: never
    _strain_of: tuple[wp.array, wp.array] | None = None  # springs whose strain the pieces show, and rest lengths

    def join(self, vertices: slice, points: Any, normals: Any, colors: Any) -> None:
        """Become part of a drawing: use a slice of its vertices, given as slices of its arrays of vec3."""
        self.vertices, self.triangles = vertices, self.triangles + np.int32(vertices.start)
        self.points, self.normals, self.colors = points[vertices], normals[vertices], colors[vertices]

    def follow(self, x: wp.array, time: float) -> None:
        """Place the part's vertices for particles at x, an array of vec3, and for colliders at `time` [s]."""

    def _place_vertices(self, x: wp.array) -> None:
        """Place each vertex at its particles, or at `radius` from there along its normal."""
        inputs = [x, *self.mixture, self.radius, self.normals]
        _launch(drawing.place_vertices, len(self.points), inputs, [self.points])

    def _follow_particles(self, particle: NDArray, weights: NDArray | None, device: str) -> None:
        """Set the particles and weights of each vertex, shape [vertex_count, k]."""
        weights = np.ones(particle.shape) if weights is None else weights
        self.mixture = wp.array(particle, dtype=int, device=device), wp.array(weights, dtype=float, device=device)

    def _show_between(self, since: NDArray, until: NDArray, device: str) -> None:
        """Set the times at which pieces appear and disappear [s]."""
        self.times = [wp.array(each, dtype=float, device=device) for each in (since, until)]

    def _collapse(self, time: float) -> None:
        """Hide the pieces that are invisible at this time [s]."""
        if self.times is not None:
            _launch(drawing.collapse, len(self.times[0]), [*self.times, time, self.corners], [self.points])

    def drawn_at(self, time: float) -> NDArray[np.bool_] | None:
        """Return which triangles are visible at a time [s], shape [triangle_count]; None if all are, always."""
        if self.times is None:
            return None
        since, until = (broken_before(each.numpy(), time) for each in self.times)
        return np.repeat(since & ~until, len(self.triangles) // max(len(since), 1))

    def show_value(self, fractions: wp.array, stops: wp.array) -> None:
        """Color the vertices by the values of their particles, as fractions of the full value."""
        _launch(drawing.color_by_value, len(self.colors), [fractions, *self.mixture, stops], [self.colors])

    def take_strain_of(self, connections: NDArray, rest_length: NDArray, device: str) -> None:
        """Let each piece show the strain of a spring."""
        springs = wp.array(connections, dtype=wp.vec2i, device=device)
        self._strain_of = springs, wp.array(rest_length, dtype=float, device=device)

    def show_strain(self, x: wp.array, full_strain: float, stops: wp.array) -> None:
        """Color the pieces by the strain of their springs, if `take_strain_of` has set these."""
        if self._strain_of is not None:
            inputs = [x, *self._strain_of, full_strain, self.corners, stops]
            _launch(drawing.color_by_strain, len(self._strain_of[0]), inputs, [self.colors])


class SurfacePart(Part):
    """The surface of a system. With flat shading, or if it tears, every triangle has its own vertices.

    A triangle is drawn from the time `since` until `parted_at` [s], each of shape [triangle_count]: None for
    always.
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
        if parted_at is not None:
            self._show_between(np.zeros(len(parted_at)) if since is None else since, parted_at, device)
        use = surface.triangles.ravel() if own else np.arange(len(surface.particle))
        self.uv, self.finish, self.triangles = surface.uv[use], finish, surface.triangles
        self.closed = parted_at is None and is_closed(surface)
        normal_of = surface.normal_of
        if own:
            self.triangles = np.arange(len(use), dtype=np.int32).reshape(-1, 3)
            normal_of = _normals_shared(use, normal_of) if smooth else None
        particle, weights = surface.mixture
        self._follow_particles(particle[use], weights[use], device)
        self._triangles = wp.array(self.triangles, dtype=wp.vec3i, device=device)
        normal_of = np.arange(len(use)) if normal_of is None else normal_of
        self._normal_of = wp.array(normal_of, dtype=int, device=device)
        self._sums = wp.zeros(len(use), dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Move the vertices with their particles, and update the normals."""
        self._place_vertices(x)
        self._collapse(time)
        self._sums.zero_()
        inputs = [self.points, self._triangles, self._normal_of]
        _launch(drawing.add_face_normals, len(self._triangles), inputs, [self._sums])
        _launch(drawing.take_normals, len(self.points), [self._sums, self._normal_of], [self.normals])


class Tubes(Part):
    """Tubes along springs, given as pairs of particles, shape [any, 2]; each is drawn until its spring breaks."""

    def __init__(
        self,
        connections: NDArray,
        radius: float,
        finish: Finish,
        device: str,
        sides: int,
        broken_at: NDArray | None,
    ) -> None:
        self.corners = 2 * sides
        along = np.arange(0, self.corners, 2)[:, None]
        ahead = (along + 2) % self.corners
        side = np.stack([along, ahead, along + 1, along + 1, ahead, ahead + 1], axis=-1).reshape(-1, 3)
        first = self.corners * np.arange(len(connections))[:, None, None]
        self.triangles = (first + side).reshape(-1, 3).astype(np.int32)
        self.uv, self.finish = np.zeros((self.corners * len(connections), 2)), finish
        self.radius = radius
        self.connections = wp.array(connections, dtype=wp.vec2i, device=device)
        self._follow_particles(np.tile(connections, (1, sides)).reshape(-1, 1), None, device)  # start, end in turn
        if broken_at is not None:
            self._show_between(np.zeros(len(broken_at)), broken_at, device)

    def follow(self, x: wp.array, time: float) -> None:
        """Lay the tubes between their particles."""
        inputs = [x, self.connections, self.radius, self.corners // 2]
        _launch(drawing.place_tubes, len(self.connections), inputs, [self.points, self.normals])
        self._collapse(time)


class Balls(Part):
    """Balls at particles, given by indices, shape [any]; in one color, or in colors of shape [any, 3]."""

    def __init__(self, particles: NDArray, radius: float, finish: Finish, device: str, halvings: int) -> None:
        directions, triangles = icosphere(1.0, halvings)
        n, count = len(directions), len(particles)
        self.triangles = (n * np.arange(count)[:, None, None] + triangles).reshape(-1, 3).astype(np.int32)
        self.uv, self.finish = np.zeros((n * count, 2)), finish
        if finish.color.ndim > 1:
            self.finish = finish._replace(color=np.repeat(finish.color, n, axis=0))
        self.radius, self.corners = radius, n
        self._follow_particles(np.repeat(particles, n)[:, None], None, device)
        self._normals = wp.array(np.tile(directions, (count, 1)), dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Place the balls at their particles."""
        wp.copy(self.normals, self._normals)
        self._place_vertices(x)


class Obstacle(Part):
    """A solid collider; if it `moves`, the part follows its pose."""

    def __init__(self, collider: Collider, mesh: Mesh, dim: int, finish: Finish, device: str) -> None:
        self.uv, self.finish, self.triangles = mesh.uv, finish, mesh.triangles
        self.moves = collider.motion is not None
        self._collider, self._dim = collider, dim
        self._points = wp.array(mesh.points, dtype=wp.vec3, device=device)
        self._normals = wp.array(mesh.normals, dtype=wp.vec3, device=device)

    def follow(self, x: wp.array, time: float) -> None:
        """Turn and shift the mesh to the collider's pose."""
        turn, shift = pose_in_space(self._collider, time, self._dim)
        inputs = [self._points, self._normals, wp.mat33(*turn.ravel()), wp.vec3(*shift)]
        _launch(drawing.place_rigid, len(self.points), inputs, [self.points, self.normals])


def is_closed(surface: Surface) -> bool:
    """Return whether a surface has no boundary: each edge is in another triangle, in the opposite direction."""
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
    """Return for each corner of triangles the first corner with the same normal; `use`: vertex of each corner."""
    vertex = use if normal_of is None else normal_of[use]
    _, first, which = np.unique(vertex, return_index=True, return_inverse=True)
    return first[which.ravel()]


def _launch(kernel: Any, dim: int, inputs: list, outputs: list[wp.array]) -> None:
    """Launch on the device of the first output."""
    wp.launch(kernel, dim, inputs, outputs, device=outputs[0].device)
