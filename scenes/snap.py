"""A weight swings on a chain; the tension rises on the way down, and the weakest link breaks."""

import numpy as np

from msdwarp import Look, Plane, Scene, ball, chain, join
from msdwarp.cli import scene_main

RADIUS = 0.13
"""Of the weight [m]."""


def build(*, count: int = 11, weak: int = 9, strength: float = 2.4, stiffness: float = 3e4) -> Scene:
    """Release a weight of 1 kg on a chain 50 cm long, at the height of its pin.

    The tension is 3 m g cos(angle from the vertical): 3 m g at the lowest point.

    Parameters
    ----------
    count
        Particles of the chain, including the pin.
    weak
        Number of the weakest link, counted from the pin.
    strength
        Tension at which that link breaks, over the weight's m g.
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
        "weight": Look(color="#b3382c", gloss=0.7),
        "chain": Look(color="#4a525c", tube=0.008, particles=True, gloss=0.6, finish="metal"),
    }
    return Scene(
        system=system, colliders=[Plane(restitution=0.0, friction=0.6)], duration=1.2, look=look, looks=looks
    )


if __name__ == "__main__":
    scene_main(build)
