"""What can draw pictures: the one that does by default, quick, and the others."""

import numpy as np
import pytest

from msdwarp.pictures.opengl_window import opengl_window

with_opengl = pytest.mark.skipif(opengl_window() is None, reason="no OpenGL library is installed")
BACKENDS = [
    "raster",
    pytest.param("raycast", marks=pytest.mark.slow),
    pytest.param("opengl", marks=[pytest.mark.slow, with_opengl]),
]


def pixel_of(renderer, point) -> tuple[int, int]:
    """Return (row, column) where a point appears."""
    row, column = renderer.stage.camera.pixels(np.array([point]), renderer.stage.height, renderer.stage.width)
    return int(row[0]), int(column[0])
