"""Patches: the triangles of a drawing by color, as browsers receive them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..pictures import Drawing, Part, divided, ramp

LEVELS = 24
"""Number of colors of a scale in a browser."""
MOST_COLORS = 12
"""Number of colors of a texture in a browser."""
FINE = 40_000
"""Minimal number of triangles into which a textured drawing is divided, so that the pattern is visible."""
MOST_DIVISIONS = 16
"""Maximal number of pieces of a triangle's side."""


class Patch(NamedTuple):
    """Triangles of one color.

    Each vertex of the patch is a mean of three vertices of the drawing, with the indices `corners` and barycentric
    `weights`, both of shape [vertex_count, 3]. If `weights` is None, each is a vertex of the drawing; `corners`
    then has shape [vertex_count]. `faces` are triangles of the patch's vertices, shape [face_count, 3].
    """

    corners: NDArray[np.integer]
    weights: NDArray[np.float32] | None
    faces: NDArray[np.uint32]
    color: NDArray[np.uint8]
    moves: bool
    opacity: float | None
    """Below 1; None: what is behind is hidden."""

    def points(self, drawn: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the patch's vertices [m], shape [vertex_count, 3], given the drawing's vertices `drawn`."""
        if self.weights is None:
            return drawn[self.corners]
        return np.einsum("ij,ijk->ik", self.weights, drawn[self.corners])


def patches(drawing: Drawing) -> list[Patch]:
    """Return the patches of a drawing; if the body's colors change over time, only the obstacles' patches."""
    divisions = round(np.sqrt(FINE / max(len(drawing.triangles), 1)))
    divisions = min(max(divisions, 1), MOST_DIVISIONS)
    found: list[Patch] = []
    for one in drawing.obstacles if drawing.colors_move else (*drawing.body, *drawing.obstacles):
        if drawing.texture is None:
            corners, weights, faces = np.arange(len(drawing.points)), None, one.triangles
            colors = (255 * drawing.colors.numpy()[faces[:, 0]] + 0.5).astype(np.uint8)
        else:
            corners, weights, faces, colors = _textured(drawing, one, divisions)
        for color in np.unique(colors, axis=0):
            used, mine = compact(faces[(colors == color).all(axis=1)])
            own = None if weights is None else weights[used]
            opacity = one.finish.reflectance.opacity
            found.append(Patch(corners[used], own, mine, color, one.moves, None if opacity == 1 else opacity))
    return found


def levels(drawing: Drawing) -> list[NDArray[np.int32]]:
    """Return the body's triangles for each of LEVELS colors, which divide the drawing's color scale evenly."""
    triangles = np.concatenate([one.triangles for one in drawing.body])
    away = drawing.colors.numpy()[:, None] - ramp(drawing.stops, LEVELS)
    of_vertex = np.argmin((away**2).sum(axis=2), axis=1)
    of_triangle = np.rint(of_vertex[triangles].mean(axis=1)).astype(int)
    return [triangles[of_triangle == level] for level in range(LEVELS)]


def compact(triangles: NDArray) -> tuple[NDArray[np.integer], NDArray[np.uint32]]:
    """Return the distinct vertices of triangles, and the triangles as indices of these."""
    corners, faces = np.unique(triangles, return_inverse=True)
    return corners, faces.reshape(-1, 3).astype(np.uint32)


def _textured(drawing: Drawing, one: Part, divisions: int) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return a textured part divided into pieces: corners, weights and faces as in `Patch`, and face colors.

    A face has the texture's color at the face's centre.
    """
    assert drawing.texture is not None
    triangles = one.triangles
    if len(np.unique(drawing.uv[triangles].reshape(-1, 2), axis=0)) == 1:
        divisions = 1  # one color everywhere
    corners, weights, faces = divided(triangles, divisions)
    middle = np.einsum("vk,vkd->vd", weights, drawing.uv[corners])[faces].mean(axis=1)
    height, width = drawing.texture.shape[:2]
    column = np.clip((middle[..., 0] % 1.0) * width, 0, width - 1).astype(int)
    row = np.clip((1.0 - middle[..., 1] % 1.0) * height, 0, height - 1).astype(int)
    return corners, weights.astype(np.float32), faces, _few(drawing.texture[row, column])


def _few(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Replace each color by the nearest of the MOST_COLORS most frequent colors."""
    coarse = (colors // 16).astype(np.int64) @ (1, 16, 256)
    _, first, counts = np.unique(coarse, return_index=True, return_counts=True)
    chosen = colors[first[np.argsort(-counts)[:MOST_COLORS]]]
    differences = (colors.astype(np.int32) - one for one in chosen.astype(np.int32))
    return chosen[np.argmin([(one**2).sum(axis=1) for one in differences], axis=0)]
