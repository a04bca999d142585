"""Pictures with a transparent background: each is drawn before black and before white."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .stage import Camera, Stage

BACKGROUNDS = ("#000000", "#ffffff")


class Matte:
    """A renderer, made of two that see the same before black and before white.

    The share of the background in a pixel is what the two differ by (A. R. Smith and J. F. Blinn, "Blue screen
    matting", SIGGRAPH 1996). Shadows on a ground in the background's color become black and translucent.
    """

    def __init__(self, kind: Callable[[Stage], Any], stages: Iterable[Stage]) -> None:
        self._renderers = [kind(stage) for stage in stages]

    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera of the next pictures; the lights stay."""
        for one in self._renderers:
            one.look_from(camera, size)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing's current state, uint8 of shape [height, width, 4]."""
        black, white = (one.draw(shadows=shadows).astype(np.float32) for one in self._renderers)
        share = 255 - np.clip((white - black).mean(axis=2, keepdims=True), 0, 255)
        return from_premultiplied(np.concatenate([black, share], axis=2))


def premultiplied(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a picture with colors multiplied by opacity, in 0 … 255, as which pictures can be added."""
    values = image.astype(np.float32)
    if image.shape[2] == 4:
        values[..., :3] *= values[..., 3:] / 255
    return values


def from_premultiplied(values: NDArray) -> NDArray[np.uint8]:
    """Return a picture, given colors in 0 … 255 multiplied by opacity, and opacity if there are four channels."""
    if values.shape[2] == 4:
        color = values[..., :3] * (255 / np.maximum(values[..., 3:], 0.5))
        values = np.concatenate([np.minimum(color, 255), values[..., 3:]], axis=2)
    return (values + 0.5).astype(np.uint8)
