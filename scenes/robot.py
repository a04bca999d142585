"""A robot of six masses walks: its eleven springs are muscles that have learned by gradients; after DiffTaichi."""

from typing import Any

import numpy as np
import warp as wp

from msdwarp import Actuator, Force, Look, Plane, Scene, System
from msdwarp.cli import scene_main

POINTS = [(0.2, 0.1), (0.3, 0.13), (0.4, 0.1), (0.2, 0.2), (0.3, 0.2), (0.4, 0.2)]
MUSCLES = [(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (2, 5), (0, 4), (1, 4), (2, 4), (3, 1), (5, 1)]
"""Those of robot A of DiffTaichi's mass_spring.py (Hu et al., ICLR 2020), whose network learned with feedback."""
LEARNED = [
    [0.0, -0.4, 0.0, 0.2, 0.2, -0.2, -0.1, -0.2, -0.1, -0.7, 0.2],
    [-0.1, 0.0, -0.1, 0.0, 0.0, -0.4, 0.1, 0.2, 0.2, -0.6, -0.2],
    [3.6, 2.1, -2.2, 0.8, 2.7, -1.3, 4.0, -0.5, 0.1, 0.3, 2.2],
    [0.2, 1.1, -0.6, -1.8, -1.4, -1.3, -0.4, 1.3, 0.0, 2.0, 1.0],
    [-1.8, 0.1, 1.3, 1.1, -0.1, 1.0, -1.7, -0.9, 1.5, -0.6, -1.5],
]
"""Weight of each wave (rows) in each muscle (columns), by 100 gradients: `python -m benchmarks.peers.robot`."""


@wp.func
def drag(x: Any, v: Any, t: Any, i: int) -> Any:
    """Return the drag of thick air [N]: without forces the speed falls to 1/e in 1/15 s."""
    return v * type(v[0])(-15.0)


def waves(time: Any) -> np.ndarray:
    """Return what drives the muscles, the sines and cosines of 10 t and 20 t, and 1, of shape [..., 5]."""
    angle = 10.0 * np.asarray(time)
    return np.stack([np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle), 1 + 0 * angle], axis=-1)


def robot(weights: np.ndarray, swing: float = 0.1) -> Scene:
    """Return the robot on the ground; its muscles have the strains swing · tanh(waves · weights)."""
    system = System(position=POINTS, mass=1.0, connections=MUSCLES, stiffness=14000.0)
    strains = [lambda time, w=w: swing * np.tanh(waves(time) @ w) for w in weights.T]
    loads = [Force(drag), *(Actuator(strain, on=ends) for strain, ends in zip(strains, MUSCLES, strict=True))]
    # Soft, as gradients need it. On a floor that bounces, or sticks at once, the gait learns to use the time step.
    floor = Plane(offset=0.1, stiffness=14000.0, dissipation=2.0, friction=1.0, rest_speed=0.1)
    look = Look(strain=True, full_strain=0.1, azimuth=-90, elevation=8)
    return Scene(system=system, colliders=[floor], loads=loads, gravity=4.8, duration=5.5, look=look)


def build(*, swing: float = 0.1) -> Scene:
    """Stand the robot on the ground.

    Parameters
    ----------
    swing
        Largest strain of its muscles.
    """
    return robot(np.array(LEARNED), swing)


if __name__ == "__main__":
    scene_main(build)
