"""What both renderers share: the triangles that follow the particles, the camera, the light, the ground."""

import itertools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from . import checks
from .kernels.drawing import STRAIN_STOPS, VALUE_STOPS
from .obstacles import extent, meshes
from .parts import Balls, BodyPart, Obstacle, Paint, Part, Skin, StrainPaint, Tubes, ValuePaint
from .scene import Look, Scene, rgb
from .system import AXES
from .textures import atlas, plain

COLOURINGS = ("texture", "strain")

# The light: a key light from the upper left behind the camera, and a weaker one at the camera.
AMBIENT, KEY, HEAD = 0.40, 0.49, 0.30
EVEN_AMBIENT, EVEN_SHARE = 0.66, 0.55
"""The light from all around, and the share left of the two lights, where colours tell values: even light, so that
they look on all sides as they do in the legend."""
SHADOW = 0.66
"""Brightness of the ground in shadow over that in light."""
VIEW_ANGLE = 30.0
"""Vertical opening of the camera [degrees]."""
MARGIN = 1.12
"""How much wider the view is than what it must hold."""
MOST_BALLS = 200
"""Particles of the largest system whose particles are drawn as balls unless the look says otherwise."""


class Scale(NamedTuple):
    """A scale of colours for any number that particles have, such as their speed."""

    label: str
    """What is shown, with its unit: "speed [m/s]"."""
    full: float
    """The value at the end of the scale, above 0: values from 0 on are told apart, and more is drawn as this."""


def in_space(position: NDArray, dtype: type = np.float32) -> NDArray:
    """Return positions in three dimensions: a plane system stands upright, a line lies along x."""
    dim = position.shape[-1]
    if dim == 3:
        return np.ascontiguousarray(position, dtype=dtype)
    points = np.zeros((*position.shape[:-1], 3), dtype=dtype)
    points[..., AXES[dim]] = position
    return points


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
        colour = np.array(rgb("obstacle", look.obstacle))
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
            return [Skin(system.surface, np.array(rgb("colour", look.colour)), look.smooth, self.device)]
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
            plain(rgb(name, colour)) if image is None else image
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


def in_view(scene: Scene, positions: NDArray) -> NDArray[np.float64]:
    """Return what the camera must see: the particles, and what of the solid colliders is not below the ground.

    `positions` are of shape [..., d]; the points [m] returned are of shape [any, 3].
    """
    obstacles = extent(scene)
    if scene.ground is not None:
        normal = in_space(scene.ground.unit_normal(scene.system.dim), np.float64)
        obstacles = obstacles - np.minimum(obstacles @ normal - scene.ground.offset, 0.0)[:, None] * normal
    return np.concatenate([in_space(positions, np.float64).reshape(-1, 3), obstacles])


def outermost(position: NDArray, look: Look, aspect: float) -> NDArray:
    """Return those particles of a frame that decide where the camera and the ground are, shape [any, d].

    `position` is of shape [particle_count, d]; `aspect` is the picture's width over its height. A camera that sees
    those of all frames sees all particles in all frames.
    """
    right, up, back = _axes(look)
    sides = [axis / tan for axis, tan in zip((right, up), _tangents(aspect), strict=True)]
    outwards = [back + sign * side for side in sides for sign in (1, -1)]
    directions = np.array([*outwards, *np.eye(3), *-np.eye(3)])
    return position[np.unique((in_space(position, np.float64) @ directions.T).argmax(axis=0))]


def _axes(look: Look) -> tuple[NDArray, NDArray, NDArray]:
    """Return what is right, up and back for a camera, as unit vectors."""
    azimuth, elevation = math.radians(look.azimuth), math.radians(look.elevation)
    flat = math.cos(elevation)
    back = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return right, np.cross(back, right), back


def _tangents(aspect: float, margin: float = MARGIN) -> tuple[float, float]:
    """Return the tangents of half the openings of the view, across and upright, less the margin."""
    tan = math.tan(math.radians(VIEW_ANGLE) / 2) / margin
    return tan * aspect, tan


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the picture is taken from: `eye` towards `target` [m], with unit vectors of the view."""

    eye: NDArray
    target: NDArray
    forward: NDArray
    right: NDArray
    up: NDArray

    @classmethod
    def that_sees(
        cls, points: NDArray, look: Look, aspect: float, margin: float = MARGIN, zoom: float = 1.0
    ) -> "Camera":
        """Return the camera in the direction of the look that is as near as it can be and sees all points.

        `points` are of shape [any, 3]; `aspect` is the picture's width over its height. With a `zoom` it is so
        many times nearer to what it looks at.
        """
        # In view coordinates a point (a, b, c) right of, above and behind the target is seen by a camera
        # at distance D if |a| <= t_x (D − c) and |b| <= t_y (D − c). For either axis the two sides that bound
        # the view meet at the best target and distance.
        right, up, back = _axes(look)
        middle, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 0.0
        a, b, c = ((points - middle) @ axis for axis in (right, up, back))
        shifts = []
        for side, tan in zip((a, b), _tangents(aspect, margin), strict=True):
            high, low = np.max(side / tan + c), np.max(-side / tan + c)
            distance = max(distance, (high + low) / 2)
            shifts.append(tan * (high - low) / 2)
        size = float(np.ptp(points, axis=0).max()) or 1.0
        target = middle + shifts[0] * right + shifts[1] * up
        eye = target + max(distance, 0.5 * size) / zoom * back
        return cls(eye, target, -back, right, up)

    def pixels(self, points: NDArray, height: int, width: int) -> tuple[NDArray, NDArray]:
        """Return rows and columns at which points appear in a picture of this size, from its upper left."""
        offset = points - self.eye
        unit = 2 * (offset @ self.forward) * math.tan(math.radians(VIEW_ANGLE) / 2) / height
        return height / 2 - offset @ self.up / unit, width / 2 + offset @ self.right / unit

    def frame(self, points: NDArray, height: int, width: int) -> tuple[int, int, int, int]:
        """Return (first row, first column, rows, columns) of the part of a picture that holds all points."""
        if ((points - self.eye) @ self.forward).min() <= 0:
            return 0, 0, height, width  # a point behind the camera appears nowhere
        bounds = []
        for at, size in zip(self.pixels(points, height, width), (height, width), strict=True):
            low = int(np.clip(at.min() - 1, 0, size - 1))
            high = int(np.clip(at.max() + 2, low + 1, size))
            bounds.append((low, high - low))
        return bounds[0][0], bounds[1][0], bounds[0][1], bounds[1][1]

    @property
    def light(self) -> NDArray:
        """Direction towards the key light, of unit length: over the camera's left shoulder."""
        direction = -0.75 * self.right - 0.35 * self.forward * (1, 1, 0) + np.array([0, 0, 1.1])
        return direction / np.linalg.norm(direction)


class Ground:
    """The ground: a square of a plane, chequered for scale, that fades into the background."""

    def __init__(self, scene: Scene, points: NDArray) -> None:
        plane, look = scene.ground, scene.look
        assert plane is not None
        self.normal = in_space(plane.unit_normal(scene.system.dim), np.float64)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        self.centre = centre - (centre @ self.normal - plane.offset) * self.normal
        self.u = np.cross([0.0, 1.0, 0.0], self.normal)
        self.u /= np.linalg.norm(self.u)
        self.v = np.cross(self.normal, self.u)
        reach = float(np.linalg.norm(np.ptp(points, axis=0)))
        self.half = 6.0 * reach
        self.tile = 10.0 ** math.floor(math.log10(0.5 * reach))
        """Side of a square of the chequered pattern [m]: a power of ten."""
        self.texture = self._paint(look)

    def _paint(self, look: Look, size: int = 2048) -> NDArray[np.uint8]:
        along = (self.half * (2 * (np.arange(size) + 0.5) / size - 1)).astype(np.float32)
        u, v = (along + np.float32(self.centre @ axis) for axis in (self.u, self.v))
        odd = (np.floor(u / self.tile)[None, :] + np.floor(v / self.tile)[:, None]) % 2
        far = np.sqrt(along[None, :] ** 2 + along[:, None] ** 2) / self.half
        fade = np.clip(1.25 - 1.35 * far, 0, 1) ** 2
        image = np.empty((size, size, 3), np.uint8)
        for k, (ground, sky) in enumerate(
            zip(rgb("ground", look.ground), rgb("background", look.background), strict=True)
        ):
            image[..., k] = 255 * (sky + fade * (ground * (1 - 0.07 * odd) - sky)) + 0.5
        return image

    def uv(self, points: NDArray) -> NDArray:
        """Return texture coordinates of points on the ground, shape [any, 2]."""
        offset = points - self.centre
        return np.stack([offset @ self.u, offset @ self.v], axis=-1) / (2 * self.half) + 0.5
