"""What both renderers share: the triangles that follow the particles, the camera, the light, the ground."""

import math
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from . import checks
from .kernels import drawing
from .scene import Look, Scene, rgb

COLOURINGS = ("texture", "strain")

# The light: a key light from the upper left behind the camera, and a weaker one at the camera.
AMBIENT, KEY, HEAD = 0.34, 0.52, 0.30
SHADOW = 0.66
"""Brightness of the ground in shadow over that in light."""
VIEW_ANGLE = 30.0
"""Vertical opening of the camera [degrees]."""


def in_space(position: NDArray, dtype: type = np.float32) -> NDArray:
    """Return positions in three dimensions: a plane system stands upright, a line lies along x."""
    dim = position.shape[-1]
    if dim == 3:
        return np.ascontiguousarray(position, dtype=dtype)
    points = np.zeros((*position.shape[:-1], 3), dtype=dtype)
    points[..., 0] = position[..., 0]
    if dim == 2:
        points[..., 2] = position[..., 1]
    return points


class Drawing:
    """Triangles that follow the particles, on the CPU or another device.

    The surface of the system, or, where `colouring` is "strain" or there is no surface, a tube along each
    connection. `points`, `normals` and `colours` are float32 of shape [vertex_count, 3].
    """

    def __init__(self, scene: Scene, colouring: str, device: str = "cpu") -> None:
        checks.one_of("colour", colouring, COLOURINGS)
        system, look = scene.system, scene.look
        self.strained = colouring == "strain" or system.surface is None
        self.device = device
        self._x = wp.zeros(system.particle_count, dtype=wp.vec3, device=device)
        if self.strained:
            self._full_strain = look.full_strain
            self._radius = 0.045 * float(np.median(system.rest_length))
            self._connections = wp.array(system.connections, dtype=wp.vec2i, device=device)
            self._rest_length = wp.array(system.rest_length, dtype=float, device=device)
            vertices = 6 * system.connection_count
            side = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 0, 5], [5, 0, 1]])
            first = 6 * np.arange(system.connection_count)[:, None, None]
            self.triangles = (first + side).reshape(-1, 3).astype(np.int32)
            self.uv = np.zeros((vertices, 2), dtype=np.float32)
            self.texture = None
            self.smooth = True
            self.gloss = 0.0
        else:
            assert system.surface is not None
            vertices = len(system.surface.particle)
            self._particle = wp.array(system.surface.particle, dtype=int, device=device)
            self.triangles = system.surface.triangles
            self._triangles = wp.array(self.triangles, dtype=wp.vec3i, device=device)
            self.uv = system.surface.uv.astype(np.float32)
            self.texture = look.texture
            self.smooth = look.smooth
            self.gloss = look.gloss
        self.points = wp.zeros(vertices, dtype=wp.vec3, device=device)
        self.normals = wp.zeros(vertices, dtype=wp.vec3, device=device)
        colour = (1.0, 1.0, 1.0) if self.texture is not None else rgb("colour", look.colour)
        self.colours = wp.full(vertices, wp.vec3(*colour), dtype=wp.vec3, device=device)

    def follow(self, position: NDArray) -> None:
        """Move to particle positions [m] of shape [particle_count, d]."""
        self._x.assign(in_space(position))
        if self.strained:
            wp.launch(
                drawing.place_tubes,
                dim=len(self._connections),
                inputs=[self._x, self._connections, self._rest_length, self._radius, self._full_strain],
                outputs=[self.points, self.normals, self.colours],
                device=self.device,
            )
            return
        vertices = len(self.points)
        wp.launch(drawing.place_vertices, vertices, [self._x, self._particle], [self.points], device=self.device)
        self.normals.zero_()
        wp.launch(
            drawing.add_face_normals,
            len(self.triangles),
            [self.points, self._triangles],
            [self.normals],
            device=self.device,
        )
        wp.launch(drawing.normalise, vertices, [self.normals], device=self.device)


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the picture is taken from: `eye` towards `target` [m], with unit vectors of the view."""

    eye: NDArray
    target: NDArray
    forward: NDArray
    right: NDArray
    up: NDArray

    @classmethod
    def that_sees(cls, points: NDArray, look: Look, aspect: float, margin: float = 1.12) -> "Camera":
        """Return the camera in the direction of the look that is as near as it can be and sees all points.

        `points` are of shape [any, 3]; `aspect` is the picture's width over its height.
        """
        azimuth, elevation = math.radians(look.azimuth), math.radians(look.elevation)
        flat = math.cos(elevation)
        back = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
        right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        up = np.cross(back, right)
        # In view coordinates a point (a, b, c) right of, above and behind the target is seen by a camera
        # at distance D if |a| <= t_x (D − c) and |b| <= t_y (D − c). For either axis the two sides that bound
        # the view meet at the best target and distance.
        tan_y = math.tan(math.radians(VIEW_ANGLE) / 2) / margin
        middle, distance = points.mean(axis=0), 0.0
        a, b, c = ((points - middle) @ axis for axis in (right, up, back))
        shifts = []
        for side, tan in ((a, tan_y * aspect), (b, tan_y)):
            high, low = np.max(side / tan + c), np.max(-side / tan + c)
            distance = max(distance, (high + low) / 2)
            shifts.append(tan * (high - low) / 2)
        size = float(np.ptp(points, axis=0).max()) or 1.0
        target = middle + shifts[0] * right + shifts[1] * up
        eye = target + max(distance, 0.5 * size) * back
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
        self.normal = in_space(plane.unit_normal(scene.system.dim)[None], np.float64)[0]
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
