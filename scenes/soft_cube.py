"""An overdamped cube is thrown against a tilted wall, flattens, and slides down."""

from msdwarp import Box, Look, Plane, Scene, box, checks
from msdwarp.cli import scene_main
from msdwarp.textures import tiles


def build(*, size: int = 7, stiffness: float = 24.0, damping: float = 2.0, mass: float = 0.01) -> Scene:
    """Throw an overdamped cube, 60 cm wide.

    Parameters
    ----------
    size
        Particles along an edge.
    """
    checks.count("size", size, 2)
    cube = box((size, size, size), 0.6 / (size - 1), mass=mass, stiffness=stiffness, damping=damping)
    cube = cube.rotate(0.5, axis=(1, 1, 0.3)).translate((-1.1, 0, 1.0))
    cube = cube.with_velocity((6.5, 0, 1.6)).spin((0.0, 3.0, 1.0))
    # Nothing sticks to a wall that is upright: this one leans back by 34°, so that weight presses the cube on.
    wall = Box((0.6, 0, 0.7), (0.2, 1.8, 2.4), (0, 0.6, 0), restitution=0.0, friction=0.4)
    floor = Plane(restitution=0.0, friction=0.9)
    look = Look(
        texture=tiles("#5aa469", "#d9efc2", count=3), gloss=0.3, obstacle="#f5e9d5", azimuth=-115, elevation=14
    )
    return Scene(system=cube, colliders=[floor, wall], duration=3.0, look=look)


if __name__ == "__main__":
    scene_main(build)
