"""A block in free fall, spinning about its intermediate axis, flips over again and again."""

from msdwarp import Look, Scene, box
from msdwarp.cli import scene_main
from msdwarp.textures import pips


def build(*, stiffness: float = 5000.0, damping: float = 0.2, mass: float = 0.02, spin: float = 9.0) -> Scene:
    """Spin a block of 9 × 5 × 2 particles about the axis with the intermediate moment of inertia.

    Parameters
    ----------
    spin
        Angular velocity [rad/s].
    """
    block = box((9, 5, 2), 0.1, mass=mass, stiffness=stiffness, damping=damping)
    block = block.spin((0.0, spin, 0.02 * spin)).rotate(-1.571, axis=(1, 0, 0))  # the middle axis stands upright
    look = Look(texture=pips("#6a4fb0", "#f6c945"), gloss=0.4, azimuth=-60, elevation=32)
    return Scene(system=block, gravity=0.0, duration=6.0, look=look)


if __name__ == "__main__":
    scene_main(build)
