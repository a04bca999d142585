"""The stage: camera, lights and ground, which do not move."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import in_space
from ..world import Look, Scene
from .collider_meshes import extent
from .light import FILL_FROM, KEY_FROM, Lights, lights, towards

MARGIN = 1.12
"""Width of the view, over the width that must be visible."""
WIDEST = 1.5
"""How many times as far away as a camera that sees what moves the camera goes at most, to see fixed obstacles,
too: what moves then fills half of the width or the height."""
AROUND_VIEW = 6.0
"""Largest extent of what the ground is fitted to, over half the height of the view at the camera's target."""
AROUND_BODY = 0.4
"""Zoom on a body that the camera follows, over that at which it fills the picture."""
UNSEEN = 1e-3
"""Depth below the ground down to which things are drawn, over the extent of all that the camera sees. Bodies in
contact sink into the ground by about this; without the tolerance parts of them would vanish."""


def outermost(position: NDArray, look: Look, aspect: float) -> NDArray:
    """Return the outermost particles of a frame, shape [any, d], which alone determine the camera and the ground.

    A camera that sees the outermost particles of all frames sees all particles in all frames. `aspect` is the
    picture's width over its height.
    """
    outwards = []
    for right, up, back in map(axes_of, look.views):
        sides = zip((right, up), _tangents(look.field_of_view, aspect), strict=True)
        outwards += [back + sign * axis / tan for axis, tan in sides for sign in (1, -1)]
    directions = np.array([*outwards, *np.eye(3), *-np.eye(3)])
    return position[np.unique((in_space(position, np.float64) @ directions.T).argmax(axis=0))]


def visible(scene: Scene, positions: NDArray) -> NDArray[np.float64]:
    """Return the points that a camera must see [m], shape [any, 3]: positions, and obstacles above the ground.

    Positions come first, fixed obstacles last.
    """
    solids = extent(scene)
    if (plane := scene.ground) is not None:  # points below the ground need not be visible
        normal = in_space(plane.unit_normal(scene.system.dim), np.float64)
        solids = solids - np.minimum(solids @ normal - plane.offset, 0.0)[:, None] * normal
    return np.concatenate([in_space(positions, np.float64).reshape(-1, 3), solids])


def axes_of(look: Look) -> tuple[NDArray, NDArray, NDArray]:
    """Return the unit vectors right, up and back of the camera of a look."""
    return view_axes(*np.radians(look.angles()))


def view_axes(azimuth: float, elevation: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return the unit vectors right, up and back of a camera in a direction [rad]."""
    flat = math.cos(elevation)
    back = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return right, np.cross(back, right), back


def _tangents(field_of_view: float, aspect: float, margin: float = MARGIN) -> tuple[float, float]:
    """Return the tangents of half the horizontal and vertical view angles, less the margin."""
    tan = math.tan(math.radians(field_of_view) / 2) / margin
    return tan * aspect, tan


@dataclass(frozen=True, eq=False)
class Camera:
    """The camera of a picture: `eye` looks at `target` [m], with unit vectors of the view.

    `field_of_view` is its vertical one [degrees].
    """

    eye: NDArray
    target: NDArray
    forward: NDArray
    right: NDArray
    up: NDArray
    field_of_view: float = Look.field_of_view

    @classmethod
    def that_sees(
        cls,
        points: NDArray,
        look: Look,
        aspect: float,
        margin: float = MARGIN,
        zoom: float = 1.0,
        above: float = 0.0,
        radius: NDArray | float = 0.0,
    ) -> "Camera":
        """Return the nearest camera in the direction of the look that sees all points, shape [any, 3].

        Points are the centres of balls of this `radius` [m]. `aspect` is the picture's width over its height. A
        `zoom` divides the distance to the target. A fraction `above` of the height, at the upper edge, is kept
        free.
        """
        # In view coordinates a point (a, b, c) right of, above and behind the target is visible to a camera at
        # distance D if |a| <= t_x (D − c) and |b| <= t_y (D − c). For either axis the two sides that bound the
        # view meet at the best target and distance. A ball around the point is visible if it is at least its
        # radius away from each side.
        right, up, back = axes_of(look)
        middle, distance = (points.min(axis=0) + points.max(axis=0)) / 2, 0.0
        a, b, c = ((points - middle) @ axis for axis in (right, up, back))
        shifts = []
        sideways, upright = _tangents(look.field_of_view, aspect, margin)
        sides = ((a, sideways, sideways), (b, min(upright, (1 - 2 * above) * upright * margin), upright))
        for side, one, other in sides:
            high = np.max(side / one + c + radius * math.hypot(1, 1 / one))
            low = np.max(-side / other + c + radius * math.hypot(1, 1 / other))
            shift = (high - low) / (1 / one + 1 / other)
            distance = max(distance, high - shift / one)
            shifts.append(shift)
        size = float(np.ptp(points, axis=0).max()) or 1.0
        target = middle + shifts[0] * right + shifts[1] * up
        eye = target + max(distance, 0.5 * size) / zoom * back
        return cls(eye, target, -back, right, up, look.field_of_view)

    def aimed(
        self,
        target: NDArray,
        distance: float | None,
        points: NDArray,
        aspect: float,
        zoom: float = 1.0,
        radius: NDArray | float = 0.0,
    ) -> "Camera":
        """Return a camera in the same direction that looks at `target` [m] from a distance [m].

        If `distance` is None, it is the least distance from which all points, shape [any, 3], are in view, with
        balls of a `radius` [m] there.
        """
        if distance is None:
            sides = zip((self.right, self.up), _tangents(self.field_of_view, aspect), strict=True)
            off = points - target
            distance = max(
                float((np.abs(off @ axis) / tan - off @ self.forward + radius * math.hypot(1, 1 / tan)).max())
                for axis, tan in sides
            )
        return replace(self, eye=target - distance / zoom * self.forward, target=target)

    def towards(self, other: "Camera", fraction: float) -> "Camera":
        """Return the camera at a fraction 0 … 1 of the way to another, which looks in the same direction.

        It sees what both see.
        """
        eye, target = (a + fraction * (b - a) for a, b in ((self.eye, other.eye), (self.target, other.target)))
        return replace(self, eye=eye, target=target)

    @property
    def distance(self) -> float:
        """Distance from the target [m]."""
        return float(np.linalg.norm(self.eye - self.target))

    def shifted(self, way: NDArray) -> "Camera":
        """Return this camera, moved [m], shape [3]."""
        return replace(self, eye=self.eye + way, target=self.target + way)

    def shifted_by_pixels(self, right: float, up: float, height: int) -> "Camera":
        """Return this camera with its view shifted by some pixels of a picture of this height."""
        way = 2 * self.tangent / height * (right * self.right + up * self.up)
        return replace(self, target=self.target + self.distance * way, forward=self.forward + way)

    def pixels(self, points: NDArray, height: int, width: int) -> tuple[NDArray, NDArray]:
        """Return the rows and columns of points in a picture of this size, counted from its upper left."""
        offset = points - self.eye
        unit = 2 * (offset @ self.forward) * self.tangent / height
        return height / 2 - offset @ self.up / unit, width / 2 + offset @ self.right / unit

    def frame(self, points: NDArray, height: int, width: int) -> tuple[int, int, int, int]:
        """Return (first row, first column, rows, columns) of the part of a picture that holds all points."""
        if not len(points):
            return 0, 0, 1, 1
        if ((points - self.eye) @ self.forward).min() <= 0:
            return 0, 0, height, width  # a point behind the camera appears nowhere
        row, column = self.pixels(points, height, width)
        top, left = int(np.clip(row.min() - 1, 0, height - 1)), int(np.clip(column.min() - 1, 0, width - 1))
        bottom, right = np.clip(row.max() + 2, top + 1, height), np.clip(column.max() + 2, left + 1, width)
        return top, left, int(bottom) - top, int(right) - left

    @property
    def tangent(self) -> float:
        """Tangent of half the vertical angle of view."""
        return math.tan(math.radians(self.field_of_view) / 2)

    @property
    def light(self) -> NDArray:
        """Unit vector towards the key light."""
        return towards(KEY_FROM, self.right, self.forward)

    @property
    def fill(self) -> NDArray:
        """Unit vector towards the fill light."""
        return towards(FILL_FROM, self.right, self.forward)

    def lights(self, *, even: bool) -> Lights:
        """Return the strengths of light for this camera; see `light.lights`."""
        return lights(self.light, -self.forward, self.fill, even=even)


class Ground:
    """The ground: a square of a plane, chequered for scale by default, that fades into the background.

    It is below all `points` [m], shape [any, 3], of which the camera sees so many metres at a time, by default
    all.
    """

    def __init__(self, scene: Scene, points: NDArray, seen: float | None = None) -> None:
        plane, look = scene.ground, scene.look
        assert plane is not None
        self.normal = in_space(plane.unit_normal(scene.system.dim), np.float64)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        self.centre = centre - (centre @ self.normal - plane.offset) * self.normal
        self.u = np.cross([0.0, 1.0, 0.0], self.normal)
        self.u /= np.linalg.norm(self.u)
        self.v = np.cross(self.normal, self.u)
        whole = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.reach = whole if seen is None else min(seen, whole)
        """Diagonal of the box around all that the camera sees at a time [m]; 1 m if that is a point."""
        self.half = 5.5 * self.reach + 0.5 * whole
        self.tile = 10.0 ** math.floor(math.log10(0.5 * self.reach))
        """Side of a square of the chequered pattern [m]: a power of ten."""
        size = 2048
        along = (self.half * (2 * (np.arange(size) + 0.5) / size - 1)).astype(np.float32)
        u, v = (along + np.float32(self.centre @ axis) for axis in (self.u, self.v))
        odd = (np.floor(u / self.tile)[None, :] + np.floor(v / self.tile)[:, None]) % 2
        odd = odd if look.floor == "chequered" else np.zeros_like(odd)
        far = np.sqrt(along[None, :] ** 2 + along[:, None] ** 2) / self.half
        fade = np.clip(1.25 - 1.35 * far, 0, 1) ** 2
        self.texture = np.empty((size, size, 3), np.uint8)
        sky = checks.color("background", look.background)
        colors = sky if look.floor == "shadows" else checks.color("ground", look.ground), sky
        for k, (ground, sky) in enumerate(zip(*colors, strict=True)):
            self.texture[..., k] = 255 * (sky + fade * (ground * (1 - 0.07 * odd) - sky)) + 0.5

    @property
    def corners(self) -> NDArray:
        """The corners of the square, counter-clockwise seen from above [m], shape [4, 3]."""
        u, v = self.half * self.u, self.half * self.v
        return self.centre + np.array([-u - v, u - v, u + v, v - u])

    def uv(self, points: NDArray) -> NDArray:
        """Return texture coordinates of points on the ground, shape [any, 2]."""
        offset = points - self.centre
        return np.stack([offset @ self.u, offset @ self.v], axis=-1) / (2 * self.half) + 0.5


class Stage:
    """The fixed part of all pictures of a scene: the camera, the ground and the background.

    The camera keeps `positions` in view [m], shape [..., d], with balls of a `radius` [m] there, and obstacles
    that move; fixed ones as far as it then is at most WIDEST times as far away. `size` is the width and height of
    pictures in pixels. For `zoom` and `above` see `Camera.that_sees`.
    """

    def __init__(
        self,
        scene: Scene,
        positions: NDArray,
        size: tuple[int, int],
        zoom: float = 1.0,
        above: float = 0.0,
        radius: float = 0.0,
    ) -> None:
        points, count = visible(scene, positions), positions.size // positions.shape[-1]
        needed = count + len(extent(scene, fixed=False))
        self.look = scene.look
        self.width, self.height = size
        self.followed = None if self.look.follow is None else scene.system.groups[self.look.follow]
        """The particles whose mean position the camera follows; None if it follows none."""
        how = needed, radius * (np.arange(len(points)) < count), zoom, above
        cameras = [self._camera_of(scene, view, points, *how) for view in self.look.views]
        self.camera = cameras[0]
        """The camera at the start."""
        self.moves = self.followed is not None or len(cameras) > 1
        """Whether the camera moves, with a body or along a path."""
        away = [math.log(np.linalg.norm(one.eye - one.target)) for one in cameras]
        angles = [np.radians(view.angles()) for view in self.look.views]
        self._times = np.array([one.time for one in self.look.path])
        self._way = np.column_stack([angles, away, [one.target for one in cameras]])
        wide, floor = max(one.distance * one.tangent for one in cameras), scene.look.floor
        self.ground = Ground(scene, points, AROUND_VIEW * wide) if scene.ground and floor != "none" else None

    def _camera_of(
        self, scene: Scene, look: Look, points: NDArray, needed: int, radius: NDArray, zoom: float, above: float
    ) -> Camera:
        """Return the camera of a look; unless the look aims it, it sees points [m], shape [any, 3].

        Points from `needed` on are those of fixed obstacles.
        """
        aspect, seen = self.width / self.height, points
        if self.followed is not None:
            seen, zoom = in_space(scene.system.position[self.followed], np.float64), zoom * AROUND_BODY
            radius = radius[:1]
        how = {"zoom": zoom, "above": above}
        camera = Camera.that_sees(seen, look, aspect, radius=radius, **how)
        if self.followed is None and needed < len(points):
            near = Camera.that_sees(points[:needed], look, aspect, radius=radius[:needed], **how)
            beyond = camera.distance - near.distance
            if (most := (WIDEST - 1) * near.distance) < beyond:
                camera = near.towards(camera, most / beyond)
        target = None if look.target is None else np.array(look.target)
        if self.followed is not None:
            target, zoom = (
                self.centre_of(scene.system.position),
                zoom / (1 if look.distance is None else AROUND_BODY),
            )
        if target is not None or look.distance is not None:
            middle = camera.target if target is None else target
            camera = camera.aimed(middle, look.distance, seen, aspect, zoom, radius)
        return camera

    def camera_at(self, time: float, position: NDArray | None) -> Camera:
        """Return the camera at a time [s] and positions [m], shape [particle_count, d]; None: at the start."""
        camera = self.camera
        if len(self._times):
            azimuth, elevation, away, *target = _smooth(self._times, self._way, time)
            right, up, back = view_axes(azimuth, elevation)
            eye = np.array(target) + math.exp(away) * back
            camera = Camera(eye, np.array(target), -back, right, up, camera.field_of_view)
        if self.followed is not None and position is not None:
            camera = camera.shifted(self.centre_of(position) - self.camera.target)
        return camera

    def centre_of(self, position: NDArray) -> NDArray:
        """Return the mean position of the particles that the camera follows [m], shape [3]."""
        return in_space(np.asarray(position, dtype=np.float64)[self.followed], np.float64).mean(axis=0)


def _smooth(times: NDArray, values: NDArray, time: float) -> NDArray[np.float64]:
    """Return values at a time, given those at some times, shape [any, k]: cubics with slope 0 at both ends.

    They overshoot nowhere: slopes are harmonic means of those on both sides, or 0 at a turn (F. N. Fritsch and
    J. Butland, SIAM Journal on Scientific and Statistical Computing 5, 1984).
    """
    if len(times) == 1:
        return values[0]
    step = np.diff(times)[:, None]
    slope = np.diff(values, axis=0) / step
    before, after, one, other = slope[:-1], slope[1:], 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    rate = np.zeros_like(values)
    np.divide(
        (one + other) * before * after, one * after + other * before, out=rate[1:-1], where=before * after > 0
    )
    k = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(step) - 1))
    s = float(np.clip((time - times[k]) / step[k, 0], 0, 1))
    hermite = np.array([(1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s**2 * (3 - 2 * s), s**2 * (s - 1)])
    return hermite @ np.stack([values[k], step[k] * rate[k], values[k + 1], step[k] * rate[k + 1]])
