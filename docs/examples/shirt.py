"""A T-shirt of two panels, sewn along shoulders, sleeves and sides, on a torso of capsules that turns.

python docs/examples/shirt.py
"""

import numpy as np

import msdwarp as msd

SPACING = 0.03  # [m]
OUTLINE = np.array(
    [
        *[(-0.09, 0.57), (-0.39, 0.57), (-0.39, 0.36), (-0.21, 0.36), (-0.21, 0.0), (0.21, 0.0)],
        *[(0.21, 0.36), (0.39, 0.36), (0.39, 0.57), (0.09, 0.57), (0.06, 0.50), (-0.06, 0.50)],
    ]
)
SEAMS = [(0, 1), (2, 3), (3, 4), (5, 6), (6, 7), (8, 9)]  # sides of the outline
LIMBS = [  # two ends of each [m], and its radius
    ((-0.06, 0.0, -0.2), (-0.06, 0.0, 0.39), 0.08),
    ((0.06, 0.0, -0.2), (0.06, 0.0, 0.39), 0.08),
    ((-0.5, 0.0, 0.47), (0.5, 0.0, 0.47), 0.055),
    ((0.0, 0.0, 0.4), (0.0, 0.0, 0.7), 0.04),
]


def near(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return which points in the plane are within 0.6 spacings of the segment from a to b."""
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1) < 0.6 * SPACING


def turn(middle: np.ndarray):
    """Return the motion of an obstacle whose middle is here [m], as the torso turns about the vertical axis."""

    def motion(t: float):
        angle = 0.9 * np.sin(np.pi * (t - 1.5)) if t > 1.5 else 0.0
        axes = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        return axes @ middle - middle, (0.0, 0.0, angle)

    return motion


def build() -> msd.Scene:
    """Return the scene."""
    panel = msd.cloth(OUTLINE, SPACING, mass=2e-4, stiffness=100.0, damping=0.02, bending=1e-5)
    flat = panel.position[:, :2] - panel.position[:, :2].min(axis=0) + OUTLINE.min(axis=0)
    sewn = np.flatnonzero(np.any([near(flat, OUTLINE[a], OUTLINE[b]) for a, b in SEAMS], axis=0))
    upright = panel.rotate(np.pi / 2, (1, 0, 0))
    upright = upright.translate((0.0, 0.0, -upright.position[:, 2].min()))
    front = upright.translate((0.0, -0.1 - upright.position[0, 1], 0.0)).named("front")
    back = upright.translate((0.0, 0.1 - upright.position[0, 1], 0.0)).named("back")
    thread = {"stiffness": 20.0, "damping": 0.05, "rest_length": 0.008}
    shirt = msd.join(front, back, pairs=np.stack([sewn, sewn], axis=1), **thread)
    torso = [msd.Capsule(a, b, radius, friction=0.4, motion=turn((np.array(a) + b) / 2)) for a, b, radius in LIMBS]
    looks = {
        "front": msd.Look(color="#3070c0", finish="cloth"),
        "back": msd.Look(color="#c05030", finish="cloth"),
    }
    contact = msd.Contact(self_contact=True, surface_colliders=True, friction=0.3)
    look = msd.Look(azimuth=-70, elevation=15)
    return msd.Scene(shirt, colliders=torso, contact=contact, duration=5.0, looks=looks, look=look)


if __name__ == "__main__":
    msd.run(build(), "out/shirt")
