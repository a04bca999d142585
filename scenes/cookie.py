"""A cookie falls flat onto a rod and breaks over it: its halves land on either side."""

import numpy as np

from msdwarp import Capsule, Look, Plane, Scene, box
from msdwarp.cli import scene_main


def build(
    *,
    layers: int = 3,
    stiffness: float = 2e4,
    damping: float = 2.0,
    break_strain: float = 0.01,
    height: float = 1.0,
) -> Scene:
    """Drop a cookie of 60 × 40 × 6 cm.

    Parameters
    ----------
    layers
        Particles through its thickness.
    stiffness
        Spring constant of each connection [N/m].
    damping
        Damper constant of each connection [N s/m].
    break_strain
        Strain at which it cracks where it is weakest; it bears up to half as much again elsewhere.
    height
        How high above the ground it is let go [m].
    """
    spacing = 0.06 / (layers - 1)
    cookie = box(
        (10 * (layers - 1) + 1, 7 * (layers - 1), layers),
        spacing,
        mass=0.002,
        stiffness=stiffness,
        damping=damping,
    )
    strength = np.random.default_rng(3).uniform(1.0, 1.5, cookie.connection_count)  # dough is nowhere the same
    cookie = cookie.replace(break_strain=break_strain * strength).translate((0.01, 0, height))
    rod = Capsule((0, -0.5, 0.2), (0, 0.5, 0.2), 0.04, restitution=0.0, friction=0.8)
    look = Look(colour="#c58a4a", gloss=0.05, obstacle="#8d99a6", azimuth=-60, elevation=26)
    return Scene(system=cookie, colliders=[Plane(restitution=0.1, friction=0.6), rod], duration=2.0, look=look)


if __name__ == "__main__":
    scene_main(build)
