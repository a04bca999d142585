"""A worm crawls: waves of contraction run along its body, and it grips the ground where it is thick."""

import numpy as np

from msdwarp import Actuator, Look, Plane, Scene, from_mesh
from msdwarp.cli import scene_main
from msdwarp.textures import rings

LENGTH, RADIUS = 2.4, 0.2
"""Of the worm [m]."""


def skin(around: int = 32, along: int = 96) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the triangles of a standing worm, its head up."""
    height = np.cos(np.pi * np.arange(1, along) / along)
    radius = RADIUS * (1 - height**6) ** 0.5 * (0.95 + 0.05 * height)
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1)
    points = np.concatenate([ring, np.broadcast_to(height[:, None, None], (*ring.shape[:2], 1))], axis=-1)
    a = around * np.arange(along - 2)[:, None] + np.arange(around)
    b = np.roll(a, -1, axis=1)
    sides = np.stack([a, a + around, b, b, a + around, b + around], axis=-1).reshape(-1, 3)
    n = around * (along - 1)
    head = np.stack([np.full(around, n), a[0], b[0]], axis=-1)
    tail = np.stack([np.full(around, n + 1), b[-1] + around, a[-1] + around], axis=-1)
    points = np.concatenate([points.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]]) * (1, 1, LENGTH / 2)
    return points, np.concatenate([sides, head, tail])


def build(*, stiffness: float = 400.0, damping: float = 1.0, mass: float = 0.01, squeeze: float = 0.25) -> Scene:
    """Lay a worm on the floor, with muscles along and across it.

    Parameters
    ----------
    squeeze
        Largest strain of its muscles.
    """
    worm = from_mesh(skin(), across=24, mass=mass, stiffness=stiffness, damping=damping)
    delay = (LENGTH / 2 - worm.position[:, 2]) / 1.5  # of a wave from head to tail, at 1.5 m/s

    def wave(time: np.ndarray) -> np.ndarray:
        return squeeze * np.sin(2 * np.pi * time) * np.clip(time, 0, 1)

    # Where it shortens it thickens, as an earthworm does, and presses on the ground.
    thicken = Actuator(lambda time: -wave(time), along=("x", "y", "x+y", "x-y"), delay=delay)
    muscles = [Actuator(wave, along="z", delay=delay), thicken]
    worm = worm.rotate(np.pi / 2, axis=(0, 1, 0)).translate((0, 0, RADIUS))
    floor = Plane(restitution=0.0, friction=0.8)
    look = Look(texture=rings("#7aa843", "#e6efb2", 36, size=1024), gloss=0.4, azimuth=-42, elevation=15)
    return Scene(system=worm, colliders=[floor], loads=muscles, duration=6.0, look=look)


if __name__ == "__main__":
    scene_main(build)
