"""A 4 × 4 block of masses falls on its corner, in two dimensions; from the 2014 report msdwarp is based on."""

from msdwarp import Look, Plane, Scene, checks, sheet
from msdwarp.cli import scene_main


def build(
    *, size: int = 4, stiffness: float = 2000.0, damping: float = 5.0, height: float = 7.0, spin: float = 1.6
) -> Scene:
    """Drop a square of masses of 1 kg, 1 m apart, on the ground.

    Parameters
    ----------
    size
        Masses along an edge.
    height
        Initial height of its centre [m].
    spin
        Initial angular velocity [rad/s].
    """
    checks.count("size", size, 2)
    block = sheet((size, size), 1.0, stiffness=stiffness, damping=damping, dim=2)
    block = block.rotate(0.6).translate((0, height)).spin(spin)
    floor = Plane(restitution=0.5, friction=0.5)
    look = Look(strain=True, azimuth=-90, elevation=5)
    return Scene(system=block, colliders=[floor], duration=5.0, look=look)


if __name__ == "__main__":
    scene_main(build)
