"""A weight swings on a chain; its pull grows on the way down, and the weakest link snaps."""

import numpy as np

from msdwarp import Look, Plane, Scene, chain
from msdwarp.cli import scene_main


def build(*, count: int = 9, weak: int = 3, strength: float = 2.4, stiffness: float = 3e4) -> Scene:
    """Let go a weight of 1 kg at the height of the pin that its chain, a metre long, hangs from.

    In the swing it pulls with 3 m g cos(angle), which is 3 m g at the lowest point.

    Parameters
    ----------
    count
        Particles of the chain, the pin and the weight among them.
    weak
        The link that bears least, counted from the pin.
    strength
        What that link bears, over the weight of the weight.
    stiffness
        Spring constant of each link [N/m].
    """
    mass = np.full(count, 0.002)
    mass[-1] = 1.0
    bears = np.full(count - 1, 100.0)
    bears[weak] = strength * 9.82
    row = chain(count, 1.0 / (count - 1), mass=mass, stiffness=stiffness, damping=5.0)
    row = row.replace(break_force=bears).pin(0)
    row = row.translate((0, 0, 1.3) - row.position[0])
    look = Look(strain=True, particles=True, full_strain=0.006, azimuth=90, elevation=8)
    return Scene(system=row, colliders=[Plane(restitution=0.3, friction=0.6)], duration=2.5, look=look)


if __name__ == "__main__":
    scene_main(build)
