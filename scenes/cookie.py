"""A cookie falls flat onto a rod and breaks in two."""

import numpy as np

from msdwarp import Capsule, Look, Plane, Scene, box
from msdwarp.cli import scene_main


def build(
    *,
    layers: int = 4,
    stiffness: float = 1e4,
    damping: float = 1.5,
    break_strain: float = 0.01,
    height: float = 0.6,
) -> Scene:
    """Drop a cookie of 60 × 40 × 6 cm.

    Parameters
    ----------
    layers
        Particles through its thickness.
    break_strain
        Strain at which it cracks along its weakest line; elsewhere the limit is six times as high.
    height
        Height above the ground from which it is dropped [m].
    """
    spacing = 0.06 / (layers - 1)
    cookie = box(
        (10 * (layers - 1) + 1, 7 * (layers - 1), layers),
        spacing,
        mass=0.002,
        stiffness=stiffness,
        damping=damping,
    )
    # The line wanders across the middle, and is no more even through the thickness: dough is nowhere the same.
    x, y, z = cookie.position.T
    wander = 0.03 * np.sin(9 * y + 1) + 0.02 * np.sin(31 * y + 40 * z)
    beyond = (x > wander)[cookie.connections]
    weak = beyond[:, 0] != beyond[:, 1]
    cookie = cookie.replace(break_strain=np.where(weak, 1, 6) * break_strain).translate((0, 0, height))
    rod = Capsule((0, -0.3, 0.2), (0, 0.3, 0.2), 0.03, restitution=0.0, friction=0.6)
    look = Look(color="#d2954f", inside="#f0d9a8", gloss=0.05, obstacle="#8d99a6", azimuth=-60, elevation=26)
    return Scene(system=cookie, colliders=[Plane(restitution=0.1, friction=0.6), rod], duration=2.0, look=look)


if __name__ == "__main__":
    scene_main(build)
