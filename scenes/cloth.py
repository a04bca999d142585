"""A cloth, pinned at three points of its top edge, falls into folds and swings."""

import numpy as np

from msdwarp import Look, Scene, checks, sheet
from msdwarp.cli import scene_main
from msdwarp.textures import gingham


def build(
    *,
    size: int = 31,
    stiffness: float = 120.0,
    damping: float = 0.06,
    mass: float = 0.001,
    bending: float = 0.001,
) -> Scene:
    """Hang a cloth, 1.5 m wide, by three points.

    Parameters
    ----------
    size
        Particles along an edge.
    bending
        Flexural rigidity [N m]. With less, folds become narrower than the spacing.
    """
    checks.count("size", size, 5)
    width = 1.5
    spacing = width / (size - 1)
    cloth = sheet((size, size), spacing, mass=mass, stiffness=stiffness, damping=damping, bending=bending)

    # It is gathered before it falls: two folds between its pins, every thread as long as it was.
    along = np.linspace(0, width, size)
    height = 0.2 * np.sin(2 * np.pi * along / width) ** 2
    across = np.append(0, np.cumsum(np.sqrt(spacing**2 - np.diff(height) ** 2)))
    position = np.array(cloth.position)
    position[:, 0], position[:, 2] = np.tile(across - across.mean(), size), np.tile(height, size)

    cloth = cloth.replace(position=position).rotate(1.0, axis=(1, 0, 0))
    top = size * (size - 1)
    cloth = cloth.pin([top, top + size // 2, top + size - 1])
    look = Look(texture=gingham("#2f6f9f", "#f4f1e8"), finish="cloth", azimuth=-64, elevation=10)
    return Scene(system=cloth, duration=4.0, look=look)


if __name__ == "__main__":
    scene_main(build)
