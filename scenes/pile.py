"""Soft bricks, balls and rings are poured into a box and settle in a pile."""

import numpy as np

from msdwarp import Box, Contact, Look, Plane, Scene, box, checks, from_mesh, icosphere
from msdwarp.cli import scene_main

PAINT = ("#e2572b", "#f2a93b", "#f6d55c", "#6bab5b", "#2f8f9d", "#3a5fa0", "#8a5a9e", "#d96a8b")
"""Colors of the bodies, in turn."""
LOOK = Look(obstacle="#d6b284", azimuth=-58, elevation=38)


def ring(radius: float, tube: float, around: int = 10, across: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the triangles of a torus."""
    turn, along = (2 * np.pi * np.arange(n) / n for n in (around, across))
    far, turn = radius + tube * np.cos(along), turn[:, None]
    points = np.stack([far * np.cos(turn), far * np.sin(turn), tube * np.sin(along) + 0 * turn], axis=-1)
    number = np.arange(around * across).reshape(around, across)
    a, b, c, d = number, np.roll(number, -1, 0), np.roll(number, (-1, -1), (0, 1)), np.roll(number, -1, 1)
    return points.reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def build(
    *, count: int = 30, stiffness: float = 800.0, damping: float = 1.2, mass: float = 0.005, seed: int = 1
) -> Scene:
    """Pour soft bodies, about 30 cm wide, into a box 1.24 m wide.

    Parameters
    ----------
    count
        Number of bodies.
    seed
        Seed of the random arrangement.
    """
    checks.count("count", count, 1)
    random = np.random.default_rng(seed)
    brick = box((3, 3, 2), 0.12, mass=mass, stiffness=stiffness, damping=damping)
    ball = from_mesh(icosphere(0.15, 1), across=3, mass=mass, stiffness=stiffness, damping=damping)
    tyre = from_mesh(ring(0.14, 0.055), spacing=0.09, mass=mass, stiffness=stiffness, damping=damping)
    kinds, bodies, looks = (brick, ball, tyre), [], {}
    for k in range(count):
        place = np.array([0.39, 0.39, 0.45]) * [k % 3 - 1, k // 3 % 3 - 1, k // 9] + (0, 0, 0.3)
        one = kinds[random.integers(3)].rotate(random.uniform(0, 2 * np.pi), random.normal(size=3))
        bodies.append(one.translate(place + random.uniform(-0.01, 0.01, 3)).named(f"body {k + 1}"))
        looks[f"body {k + 1}"] = Look(color=PAINT[k % len(PAINT)], gloss=0.4)
    walls = [Box((s * 0.66, 0, 0.32), (0.08, 1.4, 0.64), restitution=0.0, friction=0.3) for s in (-1, 1)]
    walls += [Box((0, s * 0.66, 0.32), (1.4, 0.08, 0.64), restitution=0.0, friction=0.3) for s in (-1, 1)]
    contact = Contact(friction=0.4, restitution=0.5, stiffness=4 * stiffness)  # hard: they hardly overlap
    colliders, system = [Plane(restitution=0.1, friction=0.5), *walls], sum(bodies[1:], bodies[0])
    return Scene(system=system, colliders=colliders, contact=contact, duration=2.5, look=LOOK, looks=looks)


if __name__ == "__main__":
    scene_main(build)
