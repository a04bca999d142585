"""What moves in pictures: the triangles that follow the particles and the colliders, and their colours."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import Edges, in_space
from ..kernels.pictures import STRAIN_STOPS, VALUE_STOPS
from ..world import Look, Scene
from .atlas import atlas, plain
from .collider_meshes import meshes
from .parts import Balls, BodyPart, Obstacle, Paint, Part, StrainPaint, SurfacePart, Tubes, ValuePaint
from .stage import AMBIENT, EVEN_AMBIENT, EVEN_SHARE

COLOURINGS = ("texture", "strain")
MOST_BALLS = 200
"""Particles of the largest system whose particles are drawn as balls unless the look says otherwise."""


class Scale(NamedTuple):
    """A scale of colours for any number that particles have, such as their speed."""

    label: str
    """What is shown, with its unit: "speed [m/s]"."""
    full: float
    """The value at the end of the scale, above 0: values from 0 on are told apart, and more is drawn as this."""


class PlacedPart(NamedTuple):
    """A part of a drawing, and its own vertices: a slice of each of the drawing's arrays, on the device."""

    part: Part
    vertices: slice
    """Which vertices of the drawing are its own."""
    points: wp.array
    """Where they are [m], vec3."""
    normals: wp.array
    """Unit vectors, vec3."""
    colours: wp.array
    """Red, green and blue in 0 … 1, vec3."""

    def follow(self, x: wp.array, time: float) -> None:
        """Move to where the part is when the particles are at x and it is `time` [s]."""
        self.part.place(x, time, self.points, self.normals)


class Drawing:
    """Triangles that follow the particles and the colliders, on the CPU or another device.

    The surface of the system, or, where `colouring` is "strain" or there is no surface, a tube along each
    connection and, in small systems, a ball at each particle; behind them the solid colliders. What the system's
    `broken_at` says is broken by the time of a frame is not drawn. `points`,
    `normals` and `colours` are float32 of shape [vertex_count, 3]. `scale` is what colours tell: of values of
    the particles, of the strain of connections, or None where they tell nothing.
    """

    def __init__(self, scene: Scene, colouring: str | Scale, device: str = "cpu") -> None:
        system, look = scene.system, scene.look
        self.by_value = isinstance(colouring, Scale)
        """Whether the body takes the colours of values, which it is given as it follows the particles."""
        self._shows_connections = colouring == "strain" or system.surface is None
        self.scale = self._scale_of(colouring, look)
        self.gloss = 0.0 if self.colours_move else look.gloss
        self.ambient, self.diffuse = (EVEN_AMBIENT, EVEN_SHARE) if self.by_value else (AMBIENT, 1.0)
        self.device = device
        body = self._body_of(scene)
        colour = np.array(checks.colour("obstacle", look.obstacle))
        obstacles = [Obstacle(one, mesh, system.dim, colour, device) for one, mesh in meshes(scene)]
        parts = [*body, *obstacles]
        self.below = max(part.radius for part in parts)
        """How far below the ground something may be and still be seen [m]: what is drawn around particles."""

        vertex_count = sum(len(part.uv) for part in parts)
        self.points = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        self.normals = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        self.colours = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        placed = self._placed(parts)
        self.triangles = np.concatenate([one.part.triangles + np.int32(one.vertices.start) for one in placed])
        self.texture, uvs = self._textured(look, parts, len(body))
        self.uv = np.concatenate(uvs).astype(np.float32)
        paint = np.ones((vertex_count, 3))  # white shows a texture as it is
        if self.texture is None:
            for one in placed:
                paint[one.vertices] = one.part.colour
        self.colours.assign(paint)

        self._x = wp.zeros(system.particle_count, dtype=wp.vec3, device=device)
        self._shares = wp.zeros(system.particle_count, dtype=float, device=device)
        self._body, around = placed[: len(body)], placed[len(body) :]
        self._painted = list(zip(self._paints_of(scene, body), self._body, strict=False))
        self._moving = [one for one, obstacle in zip(around, obstacles, strict=True) if obstacle.moves]
        for one in around:
            one.follow(self._x, 0.0)

    def _placed(self, parts: Sequence[Part]) -> list[PlacedPart]:
        """Return the parts with the vertices that are their own, one part's behind another's."""
        arrays: list[Any] = [self.points, self.normals, self.colours]  # Warp's types say too little of slices
        placed: list[PlacedPart] = []
        first = 0
        for part in parts:
            own = slice(first, first + len(part.uv))
            placed.append(PlacedPart(part, own, *(array[own] for array in arrays)))
            first = own.stop
        return placed

    def _scale_of(self, colouring: str | Scale, look: Look) -> Scale | None:
        """Return what the colours tell; raise ValueError if there is no such colouring."""
        if isinstance(colouring, Scale):
            return colouring._replace(full=checks.positive("colouring.full", colouring.full))
        checks.one_of("colour", colouring, COLOURINGS)
        return Scale("strain  |length / rest length - 1|", look.full_strain) if self._shows_connections else None

    @property
    def colours_move(self) -> bool:
        """Whether the body's colours change from frame to frame, and need a legend."""
        return self.scale is not None

    @property
    def stops(self) -> tuple[tuple[float, float, float], ...]:
        """Colours of the scale, evenly spaced from none to full."""
        return VALUE_STOPS if self.by_value else STRAIN_STOPS

    def _body_of(self, scene: Scene) -> list[BodyPart]:
        """Return the parts that follow the particles."""
        system, look = scene.system, scene.look
        if not self._shows_connections:
            colour = np.array(checks.colour("colour", look.colour))
            assert system.surface is not None
            parts = system.tears and system.surface.weights is None
            parted_at = Edges(system).parted_at(system.broken_at) if parts else None
            return [SurfacePart(system.surface, colour, look.smooth, self.device, parted_at)]
        body: list[BodyPart] = [Tubes(system, self.device)]
        few = system.particle_count <= MOST_BALLS
        if look.particles or (look.particles is None and few):
            body.append(Balls(system, self.device))
        return body

    def _paints_of(self, scene: Scene, body: list[BodyPart]) -> list[Paint]:
        """Return what gives the first parts of the body their colours, where those move."""
        if self.by_value:
            return [ValuePaint(part, self.device) for part in body]
        if self.colours_move:  # of the tubes alone
            return [StrainPaint(scene.system, scene.look.full_strain, self.device)]
        return []

    def _textured(self, look: Look, parts: list[Part], body: int) -> tuple[NDArray | None, list[NDArray]]:
        """Return the texture of all parts, of which the first `body` are the body's, and their coordinates."""
        uvs = [part.uv for part in parts]
        if self.colours_move:
            return None, uvs
        if len(parts) == body or (look.texture is None and look.obstacle_texture is None):
            return look.texture, uvs
        images = [
            plain(checks.colour(name, colour)) if image is None else image
            for name, image, colour in (
                ("colour", look.texture, look.colour),
                ("obstacle", look.obstacle_texture, look.obstacle),
            )
        ]
        texture, moves = atlas(images)
        return texture, [moves[int(k >= body)](uv) for k, uv in enumerate(uvs)]

    def follow(self, position: NDArray, time: float = 0.0, values: NDArray | None = None) -> None:
        """Move to particle positions [m], shape [particle_count, d], and colliders to where they are at `time`.

        Where the drawing is by value, the body takes the colours of `values`, shape [particle_count].
        """
        self._x.assign(in_space(position))
        if self.scale is not None and values is not None:
            self._shares.assign((values / self.scale.full).astype(np.float32))
        for one in (*self._body, *self._moving):
            one.follow(self._x, time)
        for paint, one in self._painted:
            paint.apply(self._x, self._shares, one.colours)

    def follow_without_body(self, out_of_sight: NDArray, time: float = 0.0) -> None:
        """Move colliders to where they are at `time`, and all of the body to one point [m], shape [3]."""
        for one in self._body:
            one.points.fill_(wp.vec3(*out_of_sight))
        for one in self._moving:
            one.follow(self._x, time)
