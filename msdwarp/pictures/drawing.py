"""What moves in pictures: the triangles that follow the particles and the colliders, and their colours."""

import itertools
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import in_space
from ..kernels.pictures import STRAIN_STOPS, VALUE_STOPS
from ..world import Look, Scene
from .atlas import atlas, plain
from .collider_meshes import meshes
from .parts import Balls, BodyPart, Obstacle, Paint, Part, Skin, StrainPaint, Tubes, ValuePaint
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


class Drawing:
    """Triangles that follow the particles and the colliders, on the CPU or another device.

    The surface of the system, or, where `colouring` is "strain" or there is no surface, a tube along each
    connection and, in small systems, a ball at each particle; behind them the solid colliders. `points`,
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
        obstacles = [(one, Obstacle(one, mesh, system.dim, colour, device)) for one, mesh in meshes(scene)]

        parts = [*body, *(part for _, part in obstacles)]
        self.below = max(part.radius for part in parts)
        """How far below the ground something may be and still be seen [m]: what is drawn around particles."""
        counts = [len(part.uv) for part in parts]
        last = list(itertools.accumulate(counts))
        first = [0, *last[:-1]]
        self.triangles = np.concatenate(
            [part.triangles + np.int32(n) for part, n in zip(parts, first, strict=True)]
        )
        self.texture, uvs = self._textured(look, parts, len(body))
        self.uv = np.concatenate(uvs).astype(np.float32)
        paint = [np.broadcast_to(part.colour, (n, 3)) for part, n in zip(parts, counts, strict=True)]
        paint = np.ones((last[-1], 3)) if self.texture is not None else np.concatenate(paint)
        self._x = wp.zeros(system.particle_count, dtype=wp.vec3, device=device)
        self._shares = wp.zeros(system.particle_count, dtype=float, device=device)
        self.points = wp.zeros(last[-1], dtype=wp.vec3, device=device)
        self.normals = wp.zeros(last[-1], dtype=wp.vec3, device=device)
        self.colours = wp.array(paint, dtype=wp.vec3, device=device)
        arrays: list[Any] = [self.points, self.normals, self.colours]  # Warp's types say too little of slices
        placed = [(part, [a[m:n] for a in arrays]) for part, m, n in zip(parts, first, last, strict=True)]
        self._body = placed[: len(body)]
        self._painted = list(zip(self._paints_of(scene, body), self._body, strict=False))
        self._moving = [
            place for (one, _), place in zip(obstacles, placed[len(body) :], strict=True) if one.motion is not None
        ]
        for part, own in placed[len(body) :]:
            part.place(self._x, 0.0, *own[:2])

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
            assert system.surface is not None
            return [Skin(system.surface, np.array(checks.colour("colour", look.colour)), look.smooth, self.device)]
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
        for part, own in (*self._body, *self._moving):
            part.place(self._x, time, *own[:2])
        for paint, (_, own) in self._painted:
            paint.apply(self._x, self._shares, *own[2:])

    def follow_without_body(self, out_of_sight: NDArray, time: float = 0.0) -> None:
        """Move colliders to where they are at `time`, and all of the body to one point [m], shape [3]."""
        for _, (points, *_) in self._body:
            points.fill_(wp.vec3(*out_of_sight))
        for part, own in self._moving:
            part.place(self._x, time, *own[:2])
