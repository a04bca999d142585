"""Textures, painted by code: uint8 images of shape [height, width, 3]."""

import numpy as np
from numpy.typing import NDArray

from .scene import rgb

BOX_TILES = (3, 2)
"""Faces of a box side by side in its texture: columns and rows."""


def _mix(weight: NDArray, colour: str, other: str) -> NDArray[np.uint8]:
    """Return `colour` where weight is 0, `other` where it is 1, blended between."""
    first, second = np.array(rgb("colour", colour)), np.array(rgb("other", other))
    return np.round(255 * (first + weight[..., None] * (second - first))).astype(np.uint8)


def _grid(size: int) -> tuple[NDArray, NDArray]:
    """Return u and v of the pixels of a square image: u to the right, v upwards, both 0 … 1."""
    along = (np.arange(size) + 0.5) / size
    return np.meshgrid(along, along[::-1])


def _on_box(face: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the texture of a box whose six faces look alike."""
    return np.tile(face, (BOX_TILES[1], BOX_TILES[0], 1))


def tiles(colour: str, line: str, *, count: int = 5, size: int = 512) -> NDArray[np.uint8]:
    """Return, for a box, faces of `count` × `count` rounded tiles with lines between them."""
    u, v = _grid(size)
    # Distance from the middle of a tile, in the norm of a rounded square: 1 at the middle of its sides.
    from_middle = [np.abs(2 * ((count * w) % 1.0) - 1) for w in (u, v)]
    distance = (from_middle[0] ** 6 + from_middle[1] ** 6) ** (1 / 6)
    edge = 2 * count / size
    return _on_box(_mix(np.clip((distance - 0.86) / (2 * edge) + 0.5, 0, 1), colour, line))


def gingham(colour: str, ground: str, *, count: int = 12, size: int = 1024) -> NDArray[np.uint8]:
    """Return a woven check: bands of `colour` both ways on `ground`, darkest where they cross."""
    u, v = _grid(size)
    bands = [((count * w) % 1.0 < 0.5).astype(float) for w in (u, v)]
    return _mix(1 - 0.46 * (bands[0] + bands[1]), colour, ground)


def rings(colour: str, light: str, count: int, *, size: int = 512) -> NDArray[np.uint8]:
    """Return, for a long upright box, faces with `count` rings around it."""
    _, v = _grid(size)
    return _on_box(_mix(0.5 - 0.5 * np.cos(2 * np.pi * count * v), colour, light))
