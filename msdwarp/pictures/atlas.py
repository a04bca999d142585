"""Several images side by side in one texture."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray


def plain(colour: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return an image of one pixel."""
    return np.round(255 * np.array(colour)).astype(np.uint8)[None, None]


def atlas(
    images: Sequence[NDArray[np.uint8]],
) -> tuple[NDArray[np.uint8], list[Callable[[NDArray], NDArray]]]:
    """Return one image of several, on top of each other, and what turns coordinates in each into those in it.

    Each is framed by its own outermost pixels, so that what is seen at its edges is the same as without the
    others: half a pixel beyond them is looked at.
    """
    framed = [np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge") for image in images]
    width, height = max(image.shape[1] for image in framed), sum(len(image) for image in framed)
    whole = np.zeros((height, width, 3), dtype=np.uint8)
    moves, row = [], 0
    for image, (rows, columns, _) in zip(framed, (image.shape for image in framed), strict=True):
        whole[row : row + rows, :columns] = image
        scale = np.array([(columns - 2) / width, (rows - 2) / height])
        corner = np.array([1 / width, 1 - (row + rows - 1) / height])
        moves.append(partial(_moved, scale=scale, corner=corner))
        row += rows
    return whole, moves


def _moved(uv: NDArray, *, scale: NDArray, corner: NDArray) -> NDArray:
    return corner + scale * uv
