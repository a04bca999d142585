"""A weight swings on a chain; its pull grows on the way down, and the weakest link snaps."""

import numpy as np

from msdwarp import Look, Plane, Scene, ball, chain, join
from msdwarp.cli import scene_main

RADIUS = 0.13
"""Of the weight [m]."""


def build(*, count: int = 11, weak: int = 3, strength: float = 2.4, stiffness: float = 3e4) -> Scene:
    """Let go a weight of 1 kg at the height of the pin that its chain, 50 cm long, hangs from.

    In the swing it pulls with 3 m g cos(angle), which is 3 m g at the lowest point.

    Parameters
    ----------
    count
        Particles of the chain, the pin among them.
    weak
        The link that bears least, counted from the pin.
    strength
        What that link bears, over the weight of the weight.
    stiffness
        Spring constant of each link [N/m].
    """
    link, high = 0.5 / (count - 1), 0.82
    bears = np.full(count - 1, 100.0)
    bears[weak] = strength * 9.82
    row = chain(count, link, mass=0.003, stiffness=stiffness, damping=8.0).replace(break_force=bears).pin(0)
    row = row.translate((0, 0, high) - row.position[-1]).named("chain")
    weight = ball(RADIUS, RADIUS / 2, mass=1.0, stiffness=8e3, damping=12.0)
    weight = weight.replace(mass=weight.mass / weight.particle_count).named("weight")
    weight = weight.translate((RADIUS + 0.5 * link, 0, high))
    nearest = int(np.linalg.norm(weight.position - row.position[-1], axis=1).argmin())
    system = join(row, weight, pairs=[(count - 1, nearest)], stiffness=stiffness, damping=8.0)
    look = Look(gloss=0.6, azimuth=80, elevation=11)
    looks = {
        "weight": Look(colour="#b3382c", gloss=0.7),
        "chain": Look(colour="#4a525c", tube=0.008, particles=True, gloss=0.6),
    }
    return Scene(
        system=system, colliders=[Plane(restitution=0.0, friction=0.6)], duration=1.2, look=look, looks=looks
    )


if __name__ == "__main__":
    scene_main(build)
