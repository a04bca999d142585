"""A mattress falls on the floor; a heavy ball drops on it, rolls off, and leaves a dent."""

import numpy as np

from msdwarp import Contact, Look, Plane, PrescribedMotion, Scene, at, box, from_mesh, icosphere, match_stiffness
from msdwarp.cli import scene_main
from msdwarp.textures import rings, ticking

LET_GO = 1.6
"""When the ball is let go [s]."""


def lower(time: float) -> tuple[float, float, float]:
    """Return how far the ball has moved until it is let go: down, and at last along the mattress at 1.8 m/s."""
    share = np.clip(time - LET_GO + 1.0, 0.0, 1.0)
    return 0.9 * share**2, 0.0, -1.4 * (3 - 2 * share) * share**2


def build(
    *, stiffness: float = 500.0, damping: float = 3.0, mass: float = 0.01, yield_strain: float = 0.03
) -> Scene:
    """Drop a mattress of 25 × 13 × 5 particles, two metres long, then a ball of nine and a half kilograms on it.

    Parameters
    ----------
    yield_strain
        Strain beyond which the foam deforms permanently.
    """
    mattress = box((25, 13, 5), 0.08, mass=mass, stiffness=stiffness, damping=damping)
    mattress = mattress.replace(yield_strain=yield_strain, relaxation_time=0.05, largest_plastic_strain=0.6)
    ball = from_mesh(icosphere(0.28, 2), across=5, damping=1.0)
    # Being heavier, it is stiffer at the same step: beside foam it is as good as rigid.
    ball = match_stiffness(ball.replace(mass=9.5 / ball.particle_count), mattress)
    mattress = mattress.rotate(0.7, axis=(0.3, 1, 0)).translate((0, 0, 1.0)).named("mattress")
    return Scene(
        system=mattress + ball.translate((-1.2, 0, 2.4)).named("ball"),
        colliders=[Plane(restitution=0.1, friction=0.8)],
        loads=[PrescribedMotion("ball", lower)],
        schedule=[at(LET_GO, unpin="ball")],
        contact=Contact(friction=0.5, restitution=0.5),
        duration=4.5,
        look=Look(texture=ticking("#f3efe4", "#5b7ea6"), finish="cloth", azimuth=-55, elevation=18),
        looks={"ball": Look(texture=rings("#c8403a", "#f4efe6", 8), gloss=0.5)},
    )


if __name__ == "__main__":
    scene_main(build)
