"""A shadow map: the surfaces of a drawing nearest to the key light; everything behind them is in shadow."""

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.pictures import shadow
from .drawing import Drawing
from .light import SOFTNESS, across, spread
from .stage import Ground

SIZE = 768
"""Texels along an edge: about as fine as pictures of 1280 x 720 pixels, whose width bodies seldom fill."""
BLOCKS, REACH = SIZE // shadow.BLOCK, math.ceil(shadow.MOST / shadow.BLOCK) + 1
"""Blocks of texels along an edge; rings of blocks around each that are included in its maximum: those within the
largest sampling radius, and one more, since kernels interpolate between blocks."""
EDGE = shadow.MOST + 1
"""Half the largest width of soft edges of shadows, in texels."""
MARGIN = EDGE + 1
"""Empty texels around the drawing, so that soft edges of shadows end inside the map."""
STEPS = 4
"""Number of map sizes per doubling: few, so that the size seldom changes between frames."""


class ShadowMap:
    """A square normal to the key light; each texel holds the distance of the nearest surface towards the light.

    After L. Williams, "Casting curved shadows on curved surfaces", SIGGRAPH 1978. The drawing is on the CPU;
    `light` is the unit vector towards the light. `depth` are distances towards it [m], float32 of shape
    [SIZE, SIZE]. `around` has for each block of texels the largest distance in it and in the blocks around it,
    shape [SIZE / BLOCK, SIZE / BLOCK, 4]: four times the same, as textures for OpenGL need it.
    """

    def __init__(self, drawing: Drawing, light: NDArray) -> None:
        self._drawing = drawing
        self.axes = np.stack([*across(light), light])  # unit vectors across and towards the light
        self.corner, self.width = np.zeros(3), 1.0  # the square's first corner along these, and its edge [m]
        self._triangles = wp.array(drawing.triangles, dtype=wp.vec3i, device="cpu")
        self._closed = wp.array(drawing.closed, dtype=wp.bool, device="cpu")
        self.data = shadow.DepthMap()  # the map as kernels read it
        self.data.u, self.data.v, self.data.towards = (wp.vec3(*axis) for axis in self.axes)
        self.data.depth = wp.zeros((SIZE, SIZE), dtype=float, device="cpu")
        self.data.around = wp.zeros((BLOCKS, BLOCKS), dtype=wp.vec4, device="cpu")
        self.data.softness = SOFTNESS
        self.data.spots = wp.array(spread(4 * shadow.SAMPLES), dtype=wp.vec2, device="cpu")
        self.depth, self.around = self.data.depth.numpy(), self.data.around.numpy()  # the same memory

    @property
    def texel(self) -> float:
        """Edge of a texel [m]."""
        return self.width / SIZE

    def to_lamp(self) -> NDArray[np.float64]:
        """Return the matrix, shape [4, 4], to coordinates along the map's axes, from its corner on [m]."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.axes, -self.corner
        return matrix

    def on_ground(self, points: NDArray, ground: Ground, count: int) -> NDArray[np.float64]:
        """Return the corners on the ground [m], shape [count, 3], of a polygon around the shadows of points.

        Seen from the light, its edges touch the points, widened by the soft edges of their shadows; the normals of
        its edges are evenly spaced.
        """
        across = points @ self.axes[:2].T.astype(np.float32)
        angle = 2 * np.pi * np.arange(count) / count
        outwards = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reach = (across @ outwards.T.astype(np.float32)).max(axis=0) + EDGE * self.texel
        ahead, onward = np.roll(reach, -1), np.roll(outwards, -1, axis=0)
        # Of lines p.n = a and p.m = b, with an angle t from n to m.
        turn = np.sin(2 * np.pi / count)
        corners = np.stack(
            [reach * onward[:, 1] - ahead * outwards[:, 1], ahead * outwards[:, 0] - reach * onward[:, 0]], axis=1
        )
        corners = (corners / turn) @ self.axes[:2] + self.corner[2] * self.axes[2]
        return corners - self._above(corners, ground)[:, None] * self.axes[2]

    def _above(self, points: NDArray, ground: Ground) -> NDArray:
        """Return the distances of points from the ground along the light [m]."""
        upwards = ground.normal / (self.axes[2] @ ground.normal)
        return points @ upwards.astype(points.dtype) - ground.centre @ upwards

    def follow(self, points: NDArray, ground: Ground | None = None) -> None:
        """Draw the map of the drawing, with some points in view [m], shape [any, 3], above a ground."""
        along = points @ self.axes.T.astype(np.float32)
        low, high = along.min(axis=0).astype(float), along.max(axis=0).astype(float)
        extent = max(*(high - low)[:2], 1e-6 * float(np.abs(along).max()), 1e-30) * SIZE / (SIZE - 2 * MARGIN)
        if ground is not None:
            # A small body far above the ground has a wide shadow: its sharpest edge is within the sampling radius.
            extent = max(extent, SIZE * SOFTNESS * float(self._above(points, ground).min()) / shadow.MOST)
        self.width = 2.0 ** (math.ceil(STEPS * math.log2(extent)) / STEPS)
        # Move by whole texels, so that edges of shadows do not shimmer while the square follows the bodies.
        middle = np.round((low + high) / 2 / self.texel) * self.texel
        self.corner = middle - np.array([self.width / 2, self.width / 2, 0.0])
        data = self.data
        data.corner, data.scale = wp.vec3(*self.corner), 1 / self.texel
        # Empty texels count as a surface far below everything, also below the ground.
        below = 2.0 * float(high[2] - low[2] + self.width)
        if ground is not None:
            square = self.corner + self.width * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
            below = max(below, float(self._above(square @ self.axes, ground).max()) + self.width)
        data.depth.fill_(-below)
        inputs = [self._drawing.points, self._triangles, self._closed]
        wp.launch(shadow.draw_depth, len(self._triangles), inputs, [data], device="cpu")
        rows = self.depth.reshape(BLOCKS, shadow.BLOCK, SIZE).max(axis=1)
        nearest = np.pad(rows.reshape(BLOCKS, BLOCKS, shadow.BLOCK).max(axis=2), REACH, mode="edge")
        nearest = np.maximum.reduce([nearest[k : k + BLOCKS] for k in range(2 * REACH + 1)])
        nearest = np.maximum.reduce([nearest[:, k : k + BLOCKS] for k in range(2 * REACH + 1)])
        self.around[:] = nearest[..., None]
