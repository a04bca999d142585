"""A jelly wobbles on a tray that is shaken; then it warms up and softens."""

import numpy as np

from msdwarp import Box, Look, Plane, Scene, at, from_mesh
from msdwarp.cli import scene_main
from msdwarp.textures import jelly

DOME = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.1), (0.44, 0.35), (0.36, 0.52), (0.22, 0.6), (0.0, 0.58))
"""Radius and height [m] of the mould, from the middle of the base to that of the top."""


def mould(around: int = 96) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the triangles of a fluted mould."""
    along = np.linspace(0, len(DOME) - 1, 12 * (len(DOME) - 1) + 1)
    radius, height = (np.interp(along, range(len(DOME)), column) for column in zip(*DOME, strict=True))
    angle = 2 * np.pi * np.arange(around) / around
    flutes = 1 + 0.09 * np.cos(12 * angle) * np.sin(np.pi * along / along[-1])[1:-1, None]
    ring = radius[1:-1, None] * flutes
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), np.tile(height[1:-1, None], around)], axis=-1)
    below = around * np.arange(len(along) - 3)[:, None] + np.arange(around)
    beside = np.roll(below, -1, axis=1)
    quads = np.stack([below, beside, beside + around, below, beside + around, below + around], axis=-1)
    first, last, n = below[0], below[-1] + around, around * (len(along) - 2)
    base = np.stack([np.full(around, n), np.roll(first, -1), first], axis=-1)
    top = np.stack([np.full(around, n + 1), last, np.roll(last, -1)], axis=-1)
    poles = [[0, 0, height[0]], [0, 0, height[-1]]]
    return np.concatenate([points.reshape(-1, 3), poles]), np.concatenate([quads.reshape(-1, 3), base, top])


def shake(time: float) -> tuple[float, float, float]:
    """Return how far the tray has moved: to and fro in the first three seconds."""
    return 0.1 * np.sin(2 * np.pi * time) ** 3 * (time < 3), 0.0, 0.0


def build(*, across: int = 16, stiffness: float = 60.0, damping: float = 0.06, mass: float = 0.0055) -> Scene:
    """Put a lightly damped jelly, one metre wide, on a tray.

    Parameters
    ----------
    across
        Cells across the jelly.
    """
    body = from_mesh(mould(), across=across, mass=mass, stiffness=stiffness, damping=damping)
    # The lattice, which stands on the tray, reaches below the mould: with 16 cells across by 3 mm, with 18 by 29.
    body = body.translate((0, 0, 0.12 - body.position[:, 2].min()))
    tray = Box((0, 0, 0.06), (1.9, 1.9, 0.12), restitution=0.0, friction=5.0, motion=shake)
    look = Look(texture=jelly("#b3123f", "#ff6a7a"), gloss=0.9, finish="glass", obstacle="#f6f1e7", elevation=20)
    warm = at(4.0, stiffness=lambda k: 0.16 * k, damping=lambda b: 2 * b)
    return Scene(system=body, colliders=[Plane(), tray], duration=6.0, look=look, schedule=[warm])


if __name__ == "__main__":
    scene_main(build)
