"""A ball is pushed into a cloth held by two edges; the cloth tears from the end of a cut."""

import numpy as np

from msdwarp import Look, Scene, Sphere, sheet
from msdwarp.cli import scene_main
from msdwarp.textures import gingham


def push(time: float) -> tuple[float, float, float]:
    """Return how far the ball has moved: down within two seconds, slowly at first and at the end."""
    down = np.clip(time / 2.2, 0.0, 1.0)
    return 0.0, 0.0, -1.0 * (3 - 2 * down) * down**2


def build(
    *, size: int = 50, slit: float = 0.4, stiffness: float = 400.0, damping: float = 0.3, break_strain: float = 0.3
) -> Scene:
    """Push a ball into a cloth of 1.5 m by 1.5 m.

    Parameters
    ----------
    size
        Particles along an edge; even, so that the slit is in the middle.
    slit
        Length of the slit, a cut from a free edge, as a fraction of the cloth's length.
    break_strain
        Strain at which a thread breaks.
    """
    spacing = 1.5 / (size - 1)
    cloth = sheet((size, size), spacing, mass=0.3 * spacing**2, stiffness=stiffness, damping=damping)
    middle = cloth.position[cloth.connections].mean(axis=1)
    crossing = np.diff(cloth.position[cloth.connections][:, :, 0] > 0, axis=1)[:, 0]
    broken_at = np.where(crossing & (middle[:, 1] < 1.5 * slit - 0.75), 0.0, np.inf)
    cloth = cloth.replace(break_strain=break_strain, broken_at=broken_at)
    cloth = cloth.pin(np.abs(cloth.position[:, 0]) > 0.75 - 0.5 * spacing).translate((0, 0, 1.0))
    ball = Sphere((0, 0, 1.26), 0.25, restitution=0.0, friction=0.2, motion=push)
    look = Look(
        texture=gingham("#b5443a", "#f4f1e8"), finish="cloth", obstacle="#5b6f86", azimuth=-62, elevation=26
    )
    return Scene(system=cloth, colliders=[ball], duration=3.5, look=look)


if __name__ == "__main__":
    scene_main(build)
