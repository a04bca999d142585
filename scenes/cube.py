"""A soft cube is thrown with spin, bounces, and comes to rest."""

from msdwarp import Look, Plane, Scene, box, checks
from msdwarp.cli import scene_main
from msdwarp.textures import tiles


def build(*, size: int = 10, stiffness: float = 600.0, damping: float = 5.0, mass: float = 0.02) -> Scene:
    """Throw a cube of jelly, one metre wide, on a floor.

    Parameters
    ----------
    size
        Particles along an edge.
    """
    checks.count("size", size, 2)
    cube = box((size, size, size), 1.0 / (size - 1), mass=mass, stiffness=stiffness, damping=damping)
    cube = cube.rotate(0.6, axis=(1, 0.4, 0)).translate((-1.2, 0, 1.6))
    cube = cube.with_velocity((1.1, 0.2, 1.0)).spin((0.8, 2.2, 0.6))
    floor = Plane(restitution=0.4, friction=0.3)
    look = Look(texture=tiles("#ee6c46", "#f2b591"), gloss=0.35, azimuth=-72)
    return Scene(system=cube, colliders=[floor], duration=3.5, look=look)


if __name__ == "__main__":
    scene_main(build)
