"""The triangles of a system's surface on a device, for loads that act on them."""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .rows import rows

if TYPE_CHECKING:
    from .model import Model


def faces_on(model: "Model", Faces: Any, corner: NDArray[np.int32]) -> Any:
    """Return triangles as `msdwarp.kernels.loads.faces` reads them.

    Parameters
    ----------
    model
        The system on a device.
    Faces
        Struct type.
    corner
        The particles at the corners of each, shape [triangle_count, 3].
    """
    order, first = rows(corner.ravel(), model.particle_count)
    faces = Faces()
    faces.corner = wp.array(corner, dtype=wp.vec3i, device=model.device)
    faces.first = wp.array(first, dtype=int, device=model.device)
    faces.number = wp.array(np.repeat(np.arange(len(corner)), 3)[order], dtype=int, device=model.device)
    return faces


def area_vectors(corner: NDArray[np.int32], x: NDArray) -> NDArray[np.float64]:
    """Return the area vector of each triangle [m²], shape [triangle_count, 3], for particles at x [m]."""
    a, b, c = (np.asarray(x[corner[:, k]], dtype=np.float64) for k in range(3))
    return 0.5 * np.cross(b - a, c - a)
