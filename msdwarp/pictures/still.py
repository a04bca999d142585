"""Stills: pictures for print, without jagged edges."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .renderer import Renderer

STEPS = np.array([0.7548776662466927, 0.5698402909980532])
"""Shifts of the camera from sample to sample in pixels, without whole ones: any number of them is spread evenly
(M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018)."""


def still(
    renderer: Renderer,
    samples: Iterable[int],
    position: NDArray,
    time: float = 0.0,
    values: ArrayLike | None = None,
    forces: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """Return the mean of pictures of a frame, one for each of the `samples` 0, 1, 2 ..., as they come.

    In each the view is shifted by other parts of a pixel, by up to half of one to all sides. The rest is as for
    `Renderer.image`.
    """
    stage, count = renderer.stage, 0
    camera, total = stage.camera_at(time, position), np.zeros((stage.height, stage.width, 3), np.uint32)
    for k in samples:
        renderer.look_from(camera.shifted_by_pixels(*((k + 1) * STEPS % 1 - 0.5), stage.height))
        total += renderer.bare(position, time, values=values, forces=forces)
        count += 1
    renderer.look_from(camera)
    return renderer.with_legend(((total + count // 2) // count).astype(np.uint8))
