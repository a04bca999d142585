"""A cloth, pinned at three points of its top row, falls into folds and swings."""

import numpy as np

from msdwarp import Look, Scene, checks, sheet
from msdwarp.cli import scene_main
from msdwarp.textures import gingham


def build(*, size: int = 31, stiffness: float = 120.0, damping: float = 0.04, mass: float = 0.001) -> Scene:
    """Hang a cloth, one and a half metres wide, by three points.

    Parameters
    ----------
    size
        Particles along an edge.
    stiffness
        Spring constant of each connection [N/m].
    damping
        Damper constant of each connection [N s/m].
    mass
        Mass of each particle [kg].
    """
    checks.count("size", size, 3)
    cloth = sheet((size, size), 1.5 / (size - 1), mass=mass, stiffness=stiffness, damping=damping)
    top = np.arange(size * (size - 1), size * size)
    # Held out level, it falls and swings about its pinned row.
    cloth = cloth.rotate(0.9, axis=(1, 0, 0)).pin(top[[0, size // 2, size - 1]])
    look = Look(texture=gingham("#2f6f9f", "#f4f1e8"), gloss=0.05, azimuth=-68, elevation=8)
    return Scene(system=cloth, duration=5.0, look=look)


if __name__ == "__main__":
    scene_main(build)
