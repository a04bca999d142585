"""Newton's cradle: the falling ball stops when it hits the row, and the last ball swings up."""

import numpy as np

from msdwarp import Capsule, Contact, Look, Plane, Scene, System, checks, from_mesh, icosphere, join
from msdwarp.cli import scene_main

RADIUS, HEIGHT, APART, FLOOR = 0.1, 1.0, 0.4, -0.4
"""Of a ball; from its middle up to its pins; from these to the middle plane; and where the floor is [m]."""


def build(
    *, count: int = 5, angle: float = 40.0, gap: float = 0.006, stiffness: float = 1e4, contact: float = 1e4
) -> Scene:
    """Lift the first of a row of balls, each 20 cm wide, 1 kg, on two strings.

    Parameters
    ----------
    count
        Number of balls.
    angle
        Angle by which the first ball is lifted [degrees].
    gap
        Gap between the balls at rest [m], so that collisions happen one after the other.
    stiffness
        Spring constant of each connection of a ball, and of each string [N/m].
    contact
        Stiffness of a contact [N/m].
    """
    checks.count("count", count, 2)
    ball = from_mesh(icosphere(RADIUS, 2), across=6, stiffness=stiffness, damping=0.0).named("balls")
    ball = ball.replace(mass=1.0 / ball.particle_count)
    middle = int(np.argmin(np.linalg.norm(ball.position, axis=1)))
    bodies = []
    for k in range(count):
        x = (k - (count - 1) / 2) * (2 * RADIUS + gap)
        pins = System(position=[(x, -APART, HEIGHT), (x, APART, HEIGHT)]).pin([0, 1])
        hung = ball.translate((x, 0, 0))
        if k == 0:
            hung = hung.rotate(np.radians(angle), axis=(0, 1, 0), about=(x, 0, HEIGHT))
        bodies.append(join(pins, hung, pairs=[(0, middle), (1, middle)], stiffness=stiffness))
    end, top = (count + 1) * RADIUS, HEIGHT + 0.03
    bars = [((-end, y, top), (end, y, top)) for y in (-APART, APART)]
    bars += [((x, y, FLOOR), (x, y, top)) for x in (-end, end) for y in (-APART, APART)]
    colliders = [Plane(offset=FLOOR), *(Capsule(a, b, 0.025) for a, b in bars)]
    return Scene(
        system=sum(bodies[1:], bodies[0]),
        colliders=colliders,
        contact=Contact(friction=0.0, restitution=1.0, stiffness=contact),
        duration=4.0,
        look=Look(color="#6c7480", obstacle="#8a5a34", azimuth=-66, elevation=12, tube=0.006),
        looks={"balls": Look(color="#c9ced6", gloss=1.0, finish="metal", tube=0.006)},
    )


if __name__ == "__main__":
    scene_main(build)
