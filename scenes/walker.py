"""A jelly cube walks on four legs: a wave of contraction in each leg moves its foot in a loop."""

import numpy as np

from msdwarp import Actuator, Look, Plane, Scene, checks, lattice
from msdwarp.cli import scene_main
from msdwarp.textures import tiles

CELLS, THICK, TALL = 8, 2, 4
"""Cells along an edge of the cube, across a leg, and in its height."""


def build(
    *, stiffness: float = 800.0, damping: float = 1.5, mass: float = 0.01, squeeze: float = 0.2, pace: float = 1.5
) -> Scene:
    """Stand a cube, 80 cm wide, on its legs.

    Parameters
    ----------
    squeeze
        Largest strain of the muscles in its legs.
    pace
        Steps of each leg per second.
    """
    checks.positive("pace", pace)
    x, y, z = np.indices((CELLS + 1,) * 3)
    outside = [(one <= THICK) | (one >= CELLS - THICK) for one in (x, y)]
    leg = (z <= TALL) & outside[0] & outside[1]
    cube = lattice(leg | (z >= TALL), 0.1, mass=mass, stiffness=stiffness, damping=damping)
    place = np.rint((cube.position - cube.position.min(axis=0)) / 0.1)
    legs = place[:, 2] <= TALL
    # The front of a leg follows its back by a quarter of a step; legs across from each other go together.
    front, left = (place[:, :2] > CELLS / 2).T
    within = np.where(front, place[:, 0] - (CELLS - THICK), place[:, 0]) / THICK
    delay = (0.25 * within + 0.5 * (front != left)) / pace

    def step(time: np.ndarray) -> np.ndarray:
        return squeeze * np.sin(2 * np.pi * pace * time) * np.clip(time, 0, 1)

    cube = cube.translate((0, 0, 0.05 * CELLS))
    look = Look(texture=tiles("#3d8f8a", "#cdeae6", count=4), gloss=0.3, azimuth=-65, elevation=14)
    floor = Plane(restitution=0.0, friction=0.9)
    muscles = [Actuator(step, on=legs, along="z", delay=delay)]
    return Scene(system=cube, colliders=[floor], loads=muscles, duration=8.0, look=look)


if __name__ == "__main__":
    scene_main(build)
