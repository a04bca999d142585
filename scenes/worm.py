"""A long worm, standing on its end, buckles and falls."""

from msdwarp import Look, Plane, Scene, box
from msdwarp.cli import scene_main
from msdwarp.textures import rings


def build(*, length: int = 30, stiffness: float = 3000.0, damping: float = 3.0, mass: float = 0.03) -> Scene:
    """Stand a worm of 2 × 2 particles across on the floor.

    Parameters
    ----------
    length
        Particles along the worm.
    stiffness
        Spring constant of each connection [N/m].
    damping
        Damper constant of each connection [N s/m].
    mass
        Mass of each particle [kg].
    """
    spacing = 0.1
    worm = box((2, 2, length), spacing, mass=mass, stiffness=stiffness, damping=damping)
    worm = worm.rotate(0.06, axis=(0.4, 1, 0)).translate((0, 0, spacing * length / 2))
    look = Look(texture=rings("#c9687a", "#f0c4b8", length // 3), gloss=0.4, azimuth=-100, elevation=24)
    return Scene(system=worm, colliders=[Plane(restitution=0.1, friction=0.7)], duration=3.0, look=look)


if __name__ == "__main__":
    scene_main(build)
