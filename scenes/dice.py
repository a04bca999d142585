"""Hard dice are thrown, collide, and come to rest between the floor and two walls."""

import numpy as np

from msdwarp import Box, Contact, Look, Plane, Scene, box, checks
from msdwarp.cli import scene_main
from msdwarp.textures import DIE, pips


def build(
    *, count: int = 5, stiffness: float = 4e4, damping: float = 6.0, mass: float = 0.02, seed: int = 7
) -> Scene:
    """Throw dice of 3 × 3 × 3 particles, 30 cm wide.

    Parameters
    ----------
    count
        Number of dice.
    seed
        Seed of the random throw.
    """
    checks.count("count", count, 1)
    random = np.random.default_rng(seed)
    die = box((3, 3, 3), 0.15, mass=mass, stiffness=stiffness, damping=damping)
    thrown = []
    for k in range(count):
        start = (-1.6 + 0.3 * random.uniform(), 0.5 * (k - (count - 1) / 2), 0.9 + 0.5 * random.uniform())
        one = die.rotate(random.uniform(0, 2 * np.pi), random.normal(size=3)).translate(start)
        one = one.with_velocity((random.uniform(2.0, 3.2), 0.3, random.uniform(-0.5, 1.0)))
        thrown.append(one.spin(9.0 * random.normal(size=3)))
    edge = 0.25 * count + 0.3  # the walls stand deep, so that nothing slides in beneath them
    back = Box((0.9, 0, 0.2), (0.1, 2 * edge, 1.0), restitution=0.3)
    side = Box((-0.3, edge, 0.2), (2.5, 0.1, 1.0), restitution=0.3)
    look = Look(
        texture=pips("#b3202c", "#fbf6ea"), gloss=0.6, smooth=False, obstacle="#48765c", azimuth=-118, elevation=26
    )
    colliders = [Plane(restitution=0.3), back, side]
    contact = Contact(friction=0.3, restitution=0.5)
    sides = [np.isclose(side * die.position[:, axis], 0.15) for axis in range(3) for side in (-1, 1)]

    def up(position, velocity):
        """Return how many dots each die shows, shape [worlds, count]: those of the side that is highest."""
        height = position[:, :, 2].reshape(len(position), count, -1)
        return np.array(DIE)[np.argmax([height[..., side].mean(axis=2) for side in sides], axis=0)]

    bodies = sum(thrown[1:], thrown[0])
    return Scene(
        system=bodies, colliders=colliders, contact=contact, duration=6.0, look=look, observe={"dots": up}
    )


if __name__ == "__main__":
    scene_main(build)
