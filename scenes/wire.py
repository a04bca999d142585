"""A wire, clamped at both ends, is pressed down by a rod and springs back only partly."""

import numpy as np

from msdwarp import Capsule, Look, Plane, Scene, cylinder
from msdwarp.cli import scene_main


def press(time: float) -> tuple[float, float, float]:
    """Return how far the rod has moved: down in the first second, up again in the third."""
    down = np.interp(time, (0.3, 1.1, 1.6, 2.4), (0, 1, 1, 0))
    return 0.0, 0.0, -0.52 * (3 - 2 * down) * down**2


def build(*, size: int = 4, stiffness: float = 2e4, damping: float = 4.0, yield_strain: float = 0.01) -> Scene:
    """Bend a wire, two metres long and 12 cm thick.

    Parameters
    ----------
    size
        Particles across the wire.
    yield_strain
        Strain beyond which it bends permanently.
    """
    spacing = 0.12 / (size - 1)
    wire = cylinder(0.06, 2.0, spacing, mass=0.005, stiffness=stiffness, damping=damping)
    wire = wire.replace(yield_strain=yield_strain, relaxation_time=0.02, largest_plastic_strain=0.3)
    wire = wire.pin(np.abs(wire.position[:, 2]) > 1.0 - 1.5 * spacing)
    wire = wire.rotate(np.pi / 2, axis=(0, 1, 0), about=(0, 0, 0)).translate((0, 0, 1.0))
    rod = Capsule((0, -0.14, 1.25), (0, 0.14, 1.25), 0.12, restitution=0.0, friction=0.1, motion=press)
    look = Look(
        color="#b8874a",
        gloss=0.9,
        finish="metal",
        obstacle="#4a5560",
        obstacle_gloss=0.5,
        azimuth=-78,
        elevation=9,
    )
    return Scene(system=wire, colliders=[Plane(offset=0.35), rod], duration=3.5, look=look)


if __name__ == "__main__":
    scene_main(build)
