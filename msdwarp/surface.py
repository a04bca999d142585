"""Surface: the triangles that are drawn."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks


@dataclass(frozen=True, eq=False, init=False)
class Surface:
    """The triangles that are drawn, with vertices of their own, so that edges and textures can be sharp.

    Parameters
    ----------
    particle
        The particle that each vertex moves with, shape [vertex_count].
    uv
        Texture coordinates in 0 … 1, shape [vertex_count, 2].
    triangles
        Vertices of each triangle, counter-clockwise seen from outside, shape [triangle_count, 3].
    """

    particle: NDArray[np.int32]
    uv: NDArray[np.float64]
    triangles: NDArray[np.int32]

    def __init__(self, *, particle: ArrayLike, uv: ArrayLike, triangles: ArrayLike) -> None:
        given = np.asarray(particle)
        if given.ndim != 1 or given.dtype.kind not in "iu":
            raise ValueError(
                f"particle has shape {given.shape} and type {given.dtype}; "
                "it must hold whole numbers in the shape (vertex_count,)"
            )
        own = given.astype(np.int32)
        own.flags.writeable = False
        object.__setattr__(self, "particle", own)
        object.__setattr__(self, "uv", checks.broadcast("uv", uv, (len(own), 2)))
        object.__setattr__(self, "triangles", checks.indices("triangles", triangles, 3, len(own)))

    def behind(self, first: "Surface | None", particles: int) -> "Surface":
        """Return both surfaces as one, this one's particles numbered behind so many others."""
        own = Surface(particle=self.particle + particles, uv=self.uv, triangles=self.triangles)
        if first is None:
            return own
        return Surface(
            particle=np.concatenate([first.particle, own.particle]),
            uv=np.concatenate([first.uv, own.uv]),
            triangles=np.concatenate([first.triangles, own.triangles + len(first.particle)]),
        )
