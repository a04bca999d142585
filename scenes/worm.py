"""A long worm, standing on end, buckles and falls."""

from msdwarp import Look, Plane, Scene, box
from msdwarp.cli import scene_main
from msdwarp.textures import rings_box


def build(*, length: int = 20, stiffness: float = 1000.0, damping: float = 1.5, mass: float = 0.03) -> Scene:
    """Stand a worm on the floor, 2 × 2 particles in cross section.

    Parameters
    ----------
    length
        Particles along the worm.
    """
    spacing = 0.1
    worm = box((2, 2, length), spacing, mass=mass, stiffness=stiffness, damping=damping)
    worm = worm.rotate(0.06, axis=(0.4, 1, 0)).translate((0, 0, spacing * length / 2))
    look = Look(texture=rings_box("#b8324c", "#f6cdbd", length // 2), gloss=0.4, azimuth=-130, elevation=16)
    return Scene(system=worm, colliders=[Plane(restitution=0.1, friction=0.7)], duration=2.4, look=look)


if __name__ == "__main__":
    scene_main(build)
