"""A soft ball falls on a trampoline, which throws it up again and again, each time less high."""

import numpy as np

from msdwarp import Capsule, Look, Plane, Scene, Touch, checks, from_mesh, icosphere, sheet
from msdwarp.cli import scene_main
from msdwarp.textures import gingham


def build(
    *,
    size: int = 21,
    height: float = 1.2,
    stiffness: float = 500.0,
    damping: float = 0.05,
    stretch: float = 1.05,
) -> Scene:
    """Let a ball, 50 cm wide, fall on a sheet of two metres by two that is held at its rim.

    Parameters
    ----------
    size
        Particles along an edge of the sheet.
    height
        How far the ball falls until it touches the sheet [m].
    stiffness
        Spring constant of each connection of the sheet [N/m].
    damping
        Damper constant of each connection of the sheet [N s/m].
    stretch
        How many times longer each connection of the sheet is than it would be if the rim let go.
    """
    checks.count("size", size, 7)
    high, radius, edge = 0.8, 0.25, 1.02
    spacing = 2.0 / (size - 1)
    bed = sheet((size, size), spacing, mass=1.2 / size**2, stiffness=stiffness, damping=damping)
    bed = bed.replace(rest_length=bed.length / stretch)
    rim = np.abs(bed.position[:, :2]).max(axis=1) > 1.0 - 0.5 * spacing
    bed = bed.pin(rim).translate((0, 0, high)).named("bed")
    ball = from_mesh(icosphere(radius, 2), across=5, mass=0.01, stiffness=300.0, damping=0.1)
    ball = ball.translate((0.03, 0.02, high + radius + height)).spin((1.0, 0.5, 0)).named("ball")
    looks = {
        "bed": Look(texture=gingham("#22384f", "#e9eef2"), gloss=0.05),
        "ball": Look(texture=gingham("#e2572b", "#f7c948", count=2), gloss=0.4),
    }
    corners = [(edge, edge), (-edge, edge), (-edge, -edge), (edge, -edge)]
    frame = [
        Capsule((*a, high), (*b, high), 0.03) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    legs = [Capsule((*a, 0), (*a, high), 0.03) for a in corners]
    colliders, touch = [Plane(), *frame, *legs], Touch(friction=0.4, restitution=0.8, thickness=0.025)
    look = Look(azimuth=-62, elevation=14, obstacle="#38424d")
    return Scene(system=bed + ball, colliders=colliders, touch=touch, duration=5.0, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
