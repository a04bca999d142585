"""A flag flutters on its pole: waves that run slower than the wind grow along it."""

import numpy as np

from msdwarp import Capsule, Look, Scene, Wind, checks, sheet
from msdwarp.cli import scene_main


def cross(ground: str = "#b3202c", line: str = "#f6f1e4") -> np.ndarray:
    """Return the image of a flag with a cross, 18 to 27."""
    image = np.tile(np.frombuffer(bytes.fromhex(ground[1:]), dtype=np.uint8), (360, 540, 1))
    image[150:210] = image[:, 170:230] = np.frombuffer(bytes.fromhex(line[1:]), dtype=np.uint8)
    return image


def build(
    *,
    size: int = 25,
    wind: float = 6.0,
    weight: float = 0.2,
    stiffness: float = 300.0,
    damping: float = 0.02,
    bending: float = 0.005,
) -> Scene:
    """Hoist a flag of 1.5 m by 1 m.

    Parameters
    ----------
    size
        Particles along the pole.
    wind
        Wind speed along x [m/s]; a tenth of it varies sideways.
    weight
        Mass per area [kg/m²].
    bending
        Flexural rigidity [N m]. With less, waves become shorter than the spacing.
    """
    checks.count("size", size, 5)
    spacing = 1.0 / (size - 1)
    along = round(1.5 / spacing) + 1
    mass = weight * spacing**2
    flag = sheet((along, size), spacing, mass=mass, stiffness=stiffness, damping=damping, bending=bending)
    flag = flag.rotate(np.pi / 2, axis=(1, 0, 0))
    flag = flag.translate((0.04, 0, 0) - flag.position[0])
    flag = flag.pin(flag.position[:, 0] < 0.04 + 0.5 * spacing)
    pole = Capsule((0, 0, -0.7), (0, 0, 1.1), 0.03, restitution=0.0, friction=0.3)
    air = Wind(lambda time: (wind, 0.1 * wind * np.sin(2.0 * time), 0.0), drag=1.2, lift=1.5)
    look = Look(texture=cross(), finish="cloth", obstacle="#e8e6df", azimuth=-58, elevation=14)
    return Scene(system=flag, colliders=[pole], loads=[air], duration=6.0, look=look)


if __name__ == "__main__":
    scene_main(build)
