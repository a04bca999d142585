"""A soft ball bounces on a trampoline, a little lower each time."""

import numpy as np

from msdwarp import Capsule, Contact, Look, Plane, Scene, checks, from_mesh, icosphere, sheet
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
    """Drop a ball, 50 cm wide, on a sheet of 2 m by 2 m that is held at its rim.

    Parameters
    ----------
    size
        Particles along an edge of the sheet.
    height
        Height of the drop [m].
    stiffness
        Spring constant of each connection of the sheet [N/m].
    damping
        Damper constant of each connection of the sheet [N s/m].
    stretch
        Length of each connection of the sheet over its rest length.
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
        "bed": Look(texture=gingham("#22384f", "#e9eef2"), finish="cloth"),
        "ball": Look(texture=gingham("#e2572b", "#f7c948", count=2), gloss=0.2, finish="rubber"),
    }
    corners = [(edge, edge), (-edge, edge), (-edge, -edge), (edge, -edge)]
    frame = [
        Capsule((*a, high), (*b, high), 0.03) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    legs = [Capsule((*a, 0), (*a, high), 0.03) for a in corners]
    colliders, contact = [Plane(), *frame, *legs], Contact(friction=0.4, restitution=0.8, thickness=0.025)
    look = Look(azimuth=-62, elevation=14, obstacle="#38424d")
    return Scene(system=bed + ball, colliders=colliders, contact=contact, duration=5.0, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
