"""Textures, painted by code: uint8 images of shape [height, width, 3]. The first row is at v = 1.

Colors are given as "#rrggbb", and `size` in pixels along an edge of a face.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, wraps
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import NDArray

from . import checks

P = ParamSpec("P")
BOX_TILES = (3, 2)
"""Faces of a box side by side in its texture: columns and rows."""
_VOXELS = (
    *("#e9e4da", "#3a4046", "#bfc4c9", "#f08a3c", "#4a9ad4", "#7d5f49", "#6aa84f", "#d9534f"),
    *("#8e6bbf", "#e5c04b", "#4db6ac", "#c2185b", "#90a4ae", "#795548", "#cddc39", "#1b5e7a"),
)
"""Colors of voxels by code: stiff ones are dark, soft ones grey, muscles orange and blue, fixed ones brown."""


def _kept(paint: Callable[P, NDArray[np.uint8]]) -> Callable[P, NDArray[np.uint8]]:
    """Return a painter that stores images: a sweep, which builds a scene per point, paints a texture once."""
    kept: Any = lru_cache(maxsize=4)(paint)

    @wraps(paint)
    def copied(*arguments: P.args, **named: P.kwargs) -> NDArray[np.uint8]:
        try:
            return kept(*arguments, **named).copy()
        except TypeError:  # a list among them
            return paint(*arguments, **named)

    return copied


def _mix(weight: NDArray, color: str, other: str) -> NDArray[np.uint8]:
    """Return `color` where weight is 0, `other` where it is 1, blended between."""
    first, second = np.array(checks.color("color", color)), np.array(checks.color("other", other))
    return np.round(255 * (first + weight[..., None] * (second - first))).astype(np.uint8)


def _grid(size: int) -> tuple[NDArray, NDArray]:
    """Return u and v of the pixels of a square image: u to the right, v upwards, both 0 … 1."""
    along = (np.arange(checks.count("size", size, 1)) + 0.5) / size
    return np.meshgrid(along, along[::-1])


def _on_box(face: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the texture of a box with this image on all six faces."""
    return np.tile(face, (BOX_TILES[1], BOX_TILES[0], 1))


def _faces(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the texture of a box from its faces −x, +x, −y, +y, −z, +z: the first three form the lower row."""
    return np.concatenate([np.concatenate(images[3:], axis=1), np.concatenate(images[:3], axis=1)])


def _shaded(image: NDArray[np.uint8], light: NDArray) -> NDArray[np.uint8]:
    """Return the image, brightened where light is above 1 and darkened where it is below."""
    return np.clip(np.round(image * light[..., None]), 0, 255).astype(np.uint8)


def _step(distance: NDArray, width: float) -> NDArray:
    """Return 0 where distance is below 0 and 1 where it is above, blended over a width around it."""
    return np.clip(distance / width + 0.5, 0, 1)


@_kept
def tiles(color: str, line: str, *, count: int = 5, size: int = 512) -> NDArray[np.uint8]:
    """Return a box texture: faces of `count` × `count` rounded tiles with lines between them."""
    u, v = _grid(size)
    # Distance from the middle of a tile, in the norm of a rounded square: 1 at the middle of its sides.
    across, along = ((2 * ((checks.count("count", count, 1) * w) % 1.0) - 1) ** 6 for w in (u, v))
    distance = (across + along) ** (1 / 6)
    return _on_box(_mix(_step(distance - 0.86, 4 * count / size), color, line))


@_kept
def gingham(color: str, ground: str, *, count: int = 12, size: int = 1024) -> NDArray[np.uint8]:
    """Return a woven check: bands of `color` both ways on `ground`, darkest where they cross."""
    u, v = _grid(size)
    across, along = (((checks.count("count", count, 1) * w) % 1.0 < 0.5).astype(float) for w in (u, v))
    return _mix(1 - 0.46 * (across + along), color, ground)


@_kept
def rings(color: str, light: str, count: int, *, size: int = 512) -> NDArray[np.uint8]:
    """Return `count` rings around a round body, such as a ball: v runs along it."""
    _, v = _grid(size)
    return _mix(0.5 - 0.5 * np.cos(2 * np.pi * checks.count("count", count, 1) * v), color, light)


def rings_box(color: str, light: str, count: int, *, size: int = 512) -> NDArray[np.uint8]:
    """Return a texture for a long upright box: `count` rings around its sides, and plain ends."""
    upright = rings(color, light, count, size=size)
    lying, end = upright[::-1].transpose(1, 0, 2), np.broadcast_to(upright[:1, :1], upright.shape)
    # Upwards is u on the faces −x and +y, and v on +x and −y.
    return _faces([lying, upright, upright, lying, end, end])


PIPS = {
    1: [(0, 0)],
    2: [(-1, -1), (1, 1)],
    3: [(-1, -1), (0, 0), (1, 1)],
    4: [(-1, -1), (-1, 1), (1, -1), (1, 1)],
    5: [(-1, -1), (-1, 1), (0, 0), (1, -1), (1, 1)],
    6: [(-1, -1), (-1, 0), (-1, 1), (1, -1), (1, 0), (1, 1)],
}
"""Where the dots of a die's face are: right of and above its middle."""
DIE = (5, 2, 4, 3, 6, 1)
"""Dots on the faces −x, +x, −y, +y, −z, +z of a die: opposite ones sum to 7; 1, 2, 3 go round anticlockwise."""


@_kept
def pips(color: str, dot: str, *, size: int = 512) -> NDArray[np.uint8]:
    """Return a box texture: the faces of a die, with one to six hollow dots and darker edges."""
    u, v = (2 * w - 1 for w in _grid(size))
    # Light on a rounded edge: that of the face, except at a rim.
    rim = (np.abs(u) ** 12 + np.abs(v) ** 12) ** (1 / 12)
    face = _shaded(_mix(np.zeros_like(u), color, dot), 1 - 0.10 * _step(rim - 0.95, 0.1))
    images = []
    for count in DIE:
        image = face.copy()
        for column, row in PIPS[count]:
            at = [
                np.flatnonzero(np.abs(w - 0.5 * k) < 0.18 + 4 / size) for w, k in ((v[:, 0], row), (u[0], column))
            ]
            here = np.ix_(*at)  # the pixels around the dot
            x, y = u[here] - 0.5 * column, v[here] - 0.5 * row
            hollow = 1 - _step(np.hypot(x, y) - 0.18, 4 / size)
            bowl = 1 + 0.9 * np.clip((0.6 * x - 0.8 * y) / 0.18, -1, 1)  # its lower wall is lit from above
            dots = _shaded(_mix(np.ones_like(x), color, dot), 0.8 + 0.2 * bowl)
            image[here] = _over(image[here], dots, hollow)
        images.append(image)
    return _faces(images)


def _over(below: NDArray[np.uint8], above: NDArray[np.uint8], opacity: NDArray) -> NDArray[np.uint8]:
    """Return one image laid over another, with an opacity of 0 … 1."""
    return np.round(below + opacity[..., None] * (above.astype(float) - below)).astype(np.uint8)


@_kept
def waffle(
    color: str, groove: str, *, counts: tuple[int, int] = (5, 4), diagonal: bool = False, size: int = 512
) -> NDArray[np.uint8]:
    """Return a waffle: square hollows between ridges; `groove` is the color of the hollows' floor.

    `counts` are the hollows along u and v. With `diagonal`, rows of hollows run slantwise, as on an ice cream
    cone; `counts` are then the hollows around, and half the hollows along a ridge. Both close around a cone.
    """
    checks.count("counts[0]", counts[0], 1)
    checks.count("counts[1]", counts[1], 1)
    u, v = _grid(size)
    a, b = counts[0] * u, counts[1] * v
    lines = (a + b, b - a) if diagonal else (a, b)
    right, up = (2 * (w % 1.0) - 1 for w in lines)  # −1 … 1 within a hollow
    edge = np.maximum(np.abs(right), np.abs(up))
    floor = 1 - _step(edge - 0.68, 0.22)
    # Light comes from above and from the left: walls that face it are bright, the others dark.
    wall = np.exp(-(((edge - 0.68) / 0.11) ** 2))
    side = np.where(np.abs(right) > np.abs(up), np.sign(right), -np.sign(up))
    return _shaded(_mix(floor, color, groove), 1 + 0.22 * wall * side - 0.06 * _step(edge - 0.93, 0.1))


@_kept
def waffle_box(color: str, groove: str, *, counts: tuple[int, int] = (5, 4), size: int = 512) -> NDArray[np.uint8]:
    """Return a texture for a flat box: a waffle on its upper and lower face, and a crust around.

    See `waffle`; `counts` are hollows along x and y.
    """
    upper = waffle(color, groove, counts=counts, size=size)
    u, v = _grid(size)
    side, end = (
        _shaded(_mix(0.75 - 0.75 * np.abs(2 * w - 1) ** 2, color, groove), np.full_like(w, 0.97)) for w in (u, v)
    )
    return _faces([side, end, end, side, waffle(color, groove, counts=(counts[1], counts[0]), size=size), upper])


@_kept
def ticking(
    color: str,
    stripe: str,
    *,
    shape: tuple[float, float, float] = (20.0, 7.0, 2.0),
    stripes: int = 9,
    buttons: int = 3,
    size: int = 512,
) -> NDArray[np.uint8]:
    """Return a texture for a long flat box: a mattress, striped lengthwise, with buttons and piped edges.

    `shape` has the proportions of the box along x, y and z, so that buttons are round. There are groups of three
    `stripes` across the upper face, and rows of `buttons` along x.
    """
    length, width, height = (checks.positive(f"shape[{k}]", n) for k, n in enumerate(shape))
    checks.count("stripes", stripes, 1)
    checks.count("buttons", buttons, 1)
    s, t = _grid(size)
    apart = width / buttons
    along_x = length / max(1, round(length / apart))

    def top(x: NDArray, y: NDArray) -> NDArray[np.uint8]:
        """Paint the upper face at distances x and y from its corner."""
        image = _mix(_bands(stripes * y / width), color, stripe)
        from_button = [step * np.abs(w / step % 1.0 - 0.5) for w, step in ((x, along_x), (y, apart))]
        distance = np.hypot(*from_button) / apart
        light = 1 - 0.22 * np.exp(-((distance / 0.17) ** 2)) + 0.03 * np.exp(-(((distance - 0.42) / 0.2) ** 2))
        knob = 1 - _step(distance - 0.055, 0.02)
        image = _over(_shaded(image, light), _mix(np.ones_like(x), color, stripe), knob)
        return piped(image, np.minimum.reduce([x, length - x, y, width - y]))

    def side(along: NDArray, up: NDArray, whole: float) -> NDArray[np.uint8]:
        """Paint a side face at distances along its edge and upwards from its lower edge."""
        image = _mix(_bands(stripes * along / width), color, stripe)
        return piped(image, np.minimum.reduce([along, whole - along, up, height - up]))

    def piped(image: NDArray[np.uint8], from_edge: NDArray) -> NDArray[np.uint8]:
        """Lay a rolled hem along the edges."""
        roll = from_edge / (0.03 * width)
        hem = _shaded(_mix(np.full_like(roll, 0.9), color, stripe), 1.2 - 0.6 * np.abs(roll - 0.5))
        return _over(image, hem, 1 - _step(roll - 1, 0.2))

    ends = [side(width * a, height * b, width) for a, b in ((t, s), (s, t))]
    sides = [side(length * a, height * b, length) for a, b in ((s, t), (t, s))]
    return _faces([*ends, *sides, top(length * t, width * s), top(length * s, width * t)])


def _bands(place: NDArray) -> NDArray:
    """Return 1 on a broad stripe and on a narrow one at each side of it, repeated in each unit; else 0."""
    off = np.abs(place % 1.0 - 0.5)
    return np.maximum(1 - _step(off - 0.11, 0.03), 1 - _step(np.abs(off - 0.2) - 0.025, 0.03))


@_kept
def scoop(color: str, fleck: str, *, flecks: int = 90, seed: int = 1, size: int = 512) -> NDArray[np.uint8]:
    """Return a ball texture (u around it, v from pole to pole): softly mottled ice cream with some flecks.

    The image has `size` pixels from pole to pole, and twice as many around. `seed` sets the places of the flecks.
    """
    checks.count("flecks", flecks, 0)
    random = np.random.default_rng(checks.count("seed", seed, 0))
    turn, tilt = np.meshgrid(
        2 * np.pi * (np.arange(2 * size) + 0.5) / (2 * size), np.pi * (0.5 - (np.arange(size) + 0.5) / size)
    )
    place = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], axis=-1)
    # Waves in space, seen where they cut the sphere: no seam and no poles.
    near, mottle = place.astype(np.float32), np.zeros(turn.shape, np.float32)  # single precision: half the time
    for octave, weight in ((4.0, 0.5), (9.0, 0.35), (21.0, 0.25)):
        for _ in range(14):
            wave = octave * (0.7 + 0.6 * random.random()) * _direction(random)
            phase = np.float32(2 * np.pi * random.random())
            mottle += np.float32(weight / np.sqrt(14)) * np.cos(near @ wave.astype(np.float32) + phase)
    image = _shaded(_mix(np.zeros_like(turn), color, fleck), 1 + 0.07 * mottle)
    paint = _mix(np.ones(1), color, fleck)
    for _ in range(flecks):
        middle, length = _direction(random), 0.015 + 0.03 * random.random()
        grain = np.cross(middle, _direction(random))
        grain /= np.linalg.norm(grain)
        rows = slice(None)
        if abs(middle[2]) < 0.95:  # only the rows that the fleck can reach
            rows = slice(*np.searchsorted(-tilt[:, 0], np.array([-0.06, 0.06]) - np.arcsin(middle[2])))
        along, outwards = place[rows] @ grain, place[rows] @ middle
        across = np.sqrt(np.maximum(1 - along**2 - outwards**2, 0))
        distance = np.hypot(along / length, across / (0.45 * length))
        opacity = np.where(outwards > 0, 0.9 * (1 - _step(distance - 1, 0.3)), 0.0)
        image[rows] = _over(image[rows], paint, opacity)
    return image


def _direction(random: np.random.Generator) -> NDArray:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


@_kept
def tyre_wall(color: str, wall: str, mark: str, *, size: int = 1024) -> NDArray[np.uint8]:
    """Return the texture of a tyre, v along its axle: a ring on each wall, and marks beside it."""
    u, v = _grid(size)
    side = np.minimum(v, 1 - v)
    image = _mix((side < 0.003).astype(float), color, wall)
    marked = (side > 0.02) & (side < 0.09) & ((6 * u) % 1 < 0.3)
    return _over(image, _mix(np.ones_like(u), color, mark), marked.astype(float))


@_kept
def jelly(color: str, light: str, *, size: int = 512) -> NDArray[np.uint8]:
    """Return a box texture: translucent faces, dark in the middle and bright at the edges."""
    u, v = (2 * w - 1 for w in _grid(size))
    # Near an edge light passes through less material.
    through = 1 - ((1 - u**4) * (1 - v**4)) ** 0.75
    return _on_box(_mix(0.08 + 0.8 * through**1.5, color, light))


@_kept
def voxels(colors: Mapping[int, str] | None = None, *, line: float = 0.75, size: int = 64) -> NDArray[np.uint8]:
    """Return a texture for bodies by `msdwarp.voxels`: a square tile with a dark rim for each code from 0 to 15.

    `colors` has the color of codes, others have one by default; `line` is the brightness of the rim, over that of
    the tile. Codes from 16 on show the tiles of 0, 1, ... again.
    """
    given = {} if colors is None else colors
    checks.instance("colors", given, Mapping, '{1: "#2f3437"}')
    for code in given:
        checks.one_of("a code in colors", code, range(len(_VOXELS)))
    checks.between("line", line, 0.0, 1.0)
    u, v = _grid(size)
    rim = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v)) < 0.06
    light = np.where(rim, line, 1.0)
    each = [
        _shaded(_mix(np.zeros_like(u), color, color), light)
        for color in (given.get(code, default) for code, default in enumerate(_VOXELS))
    ]
    side = round(len(each) ** 0.5)  # codes count from the lower left, row by row
    rows = [np.concatenate(each[k : k + side], axis=1) for k in range(0, len(each), side)]
    return np.concatenate(rows[::-1])
