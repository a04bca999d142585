"""What pictures show, as other programs take it: meshes with materials, in frames."""

import re
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

UP = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}
"""Matrices from the right, by which positions are turned so that an axis points up, by its name."""


class DrawnMesh(NamedTuple):
    """A mesh in a frame, as pictures show it. What changes from frame to frame is said of each field."""

    name: str
    """Name of the body; meshes of one body that differ in material have the same name."""
    points: NDArray
    """Vertices [m], shape [vertex_count, 3]. They may change."""
    normals: NDArray | None
    """Unit normals at the vertices; None for the normals of triangles. They may change."""
    triangles: NDArray[np.int32]
    """Vertices of each triangle, shape [triangle_count, 3]; of a rope, of each spring, shape [spring_count, 2]."""
    uv: NDArray
    """Texture coordinates of the vertices, shape [vertex_count, 2]."""
    color: NDArray
    """sRGB in 0 … 1, shape [3] or, if it may change, [vertex_count, 3]."""
    texture: NDArray[np.uint8] | None = None
    gloss: float = 0.0
    roughness: float = 0.9
    """Parameter of UsdPreviewSurface, like the next two, 0 … 1."""
    metallic: float = 0.0
    opacity: float = 1.0
    moves: bool = False
    visible: NDArray[np.bool_] | None = None
    """Whether each triangle is visible, shape [triangle_count]; None if all are in all frames. It may change."""
    velocities: NDArray | None = None
    """Velocities of the vertices [m/s], shape [vertex_count, 3]; None if they are not known. They may change."""
    radius: float = 0.0
    """Radius of a rope [m], which is given by springs between particles; 0 for a mesh of triangles."""

    @property
    def material(self) -> tuple[Any, ...]:
        """What its material is made of: equal for meshes that can share one."""
        by_vertex = self.texture is not None or self.color.ndim > 1
        paint = id(self.texture) if self.texture is not None else None if by_vertex else tuple(self.color.tolist())
        return paint, self.gloss, self.roughness, self.metallic, self.opacity

    @property
    def vertex_colors(self) -> NDArray:
        """Colors at the vertices, of a texture too, sRGB in 0 … 1, shape [vertex_count, 3]."""
        if (image := self.texture) is None:
            return np.broadcast_to(self.color, self.points.shape)
        size = np.array(image.shape[1::-1])
        column, row = np.clip(size * ([0.0, 1.0] + [1, -1] * self.uv), 0, size - 1).astype(int).T
        return image[row, column] / 255

    @property
    def seen(self) -> "DrawnMesh":
        """The mesh without what is hidden."""
        triangles = self.triangles if self.visible is None else self.triangles[self.visible]
        used, corner = np.unique(triangles, return_inverse=True)
        some = {
            name: values[used]
            for name in ("points", "normals", "uv", "velocities", "color")
            if (values := getattr(self, name)) is not None and values.ndim > 1
        }
        return self._replace(triangles=corner.reshape(triangles.shape), visible=None, **some)

    def placed(self, turn: NDArray, scale: float) -> "DrawnMesh":
        """Return this mesh with vectors turned by a matrix from the right, and lengths multiplied by `scale`."""
        turned = {
            name: size * values @ turn
            for name, size in (("points", scale), ("velocities", scale), ("normals", 1.0))
            if (values := getattr(self, name)) is not None
        }
        return self._replace(radius=scale * self.radius, **turned)


DrawnFrame = tuple[list[DrawnMesh], NDArray]
"""The meshes, and the camera. Its rows: right, up and back, and its position [m]; shape [4, 3]."""


def placed(frame: DrawnFrame, up: str, scale: float) -> DrawnFrame:
    """Return a frame in the axes and the unit of length of a file: see `DrawnMesh.placed` and UP."""
    meshes, view = frame
    turn = UP[up]
    return [mesh.placed(turn, scale) for mesh in meshes], view @ turn * [[1], [1], [1], [scale]]


def material_names(meshes: Sequence[DrawnMesh]) -> dict[Any, str]:
    """Return a word for each `DrawnMesh.material`: the name of the first body that has it; no two are the same."""
    names: dict[Any, str] = {}
    for mesh in meshes:
        if mesh.material not in names:
            names[mesh.material] = free_name(as_word(mesh.name), names.values())
    return names


def as_word(name: str) -> str:
    """Return a name as one word, which can also name a file."""
    return re.sub(r"[^\w.-]+", "_", name) or "body"


def free_name(wanted: str, taken: Collection[str]) -> str:
    """Return a name that is not taken: the wanted one, or with the next free number appended."""
    name, k = wanted, 1
    while name in taken:
        k += 1
        name = f"{wanted}_{k}"
    return name


def linear(color: NDArray) -> NDArray:
    """Return linear colors, as in USD and glTF, given sRGB colors, both in 0 … 1 (IEC 61966-2-1)."""
    return np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
