"""A mattress flops down; a heavy ball presses into it and leaves a dent."""

import numpy as np

from msdwarp import Look, Plane, Scene, Sphere, box
from msdwarp.cli import scene_main
from msdwarp.textures import ticking


def press(time: float) -> tuple[float, float, float]:
    """Return how far the ball has moved: down from 2 s on, up again from 3.2 s on."""
    down = np.interp(time, (2.0, 2.6, 3.0, 3.6), (0, 1, 1, 0))
    return 0.0, 0.0, -0.98 * (3 - 2 * down) * down**2


def build(
    *, stiffness: float = 500.0, damping: float = 3.0, mass: float = 0.01, yield_strain: float = 0.06
) -> Scene:
    """Drop a mattress of 25 × 13 × 5 particles, two metres long.

    Parameters
    ----------
    stiffness
        Spring constant of each connection [N/m].
    damping
        Damper constant of each connection [N s/m].
    mass
        Mass of each particle [kg].
    yield_strain
        Strain that the foam bears without a lasting dent.
    """
    mattress = box((25, 13, 5), 0.08, mass=mass, stiffness=stiffness, damping=damping)
    mattress = mattress.replace(yield_strain=yield_strain, relaxation_time=0.1, largest_plastic_strain=0.6)
    mattress = mattress.rotate(0.7, axis=(0.3, 1, 0)).translate((0, 0, 1.0))
    ball = Sphere((0.3, 0, 1.5), 0.36, restitution=0.0, friction=0.4, motion=press)
    floor = Plane(restitution=0.1, friction=0.8)
    look = Look(texture=ticking("#f3efe4", "#5b7ea6"), gloss=0.05, obstacle="#3b4654", azimuth=-55, elevation=18)
    return Scene(system=mattress, colliders=[floor, ball], duration=4.5, look=look)


if __name__ == "__main__":
    scene_main(build)
