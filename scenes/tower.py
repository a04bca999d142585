"""A ball knocks a cube out of a tower of soft cubes, and the cubes above drop."""

from msdwarp import Contact, Look, Plane, Scene, box, checks, from_mesh, icosphere
from msdwarp.cli import scene_main
from msdwarp.textures import tiles

PAINT = ("#c8553d", "#e9b44c", "#5aa469", "#3d7ea6", "#8f5b8c")
"""Colors of the cubes, from the lowest up; those of more cubes follow in the same order."""


def build(
    *,
    count: int = 5,
    speed: float = 6.0,
    stiffness: float = 400.0,
    damping: float = 2.0,
    mass: float = 0.02,
    friction: float = 0.3,
) -> Scene:
    """Throw a ball at a tower of cubes, 40 cm wide.

    Parameters
    ----------
    count
        Number of cubes.
    speed
        Speed of the ball [m/s].
    friction
        Coulomb's coefficient μ between bodies.
    """
    checks.count("count", count, 2)
    width, radius, away = 0.4, 0.15, 1.5
    cube = box((4, 4, 4), width / 3, mass=mass, stiffness=stiffness, damping=damping)
    ball = from_mesh(icosphere(radius, 2), across=4, mass=mass, stiffness=stiffness, damping=damping)
    # It rises as much as it falls on the way, so that it hits the second cube in the middle.
    rise = 0.5 * 9.82 * (away - width / 2 - radius) / speed
    system = ball.translate((-away, 0, 1.5 * width)).with_velocity((speed, 0, rise)).named("ball")
    looks = {"ball": Look(color="#2b2d33", gloss=0.8, finish="metal")}
    for k in range(count):
        name = f"cube {k + 1}"
        system = system + cube.translate((0, 0, (k + 0.5) * width)).named(name)
        looks[name] = Look(texture=tiles(PAINT[k % len(PAINT)], "#f6efe2", count=3), gloss=0.35)
    contact = Contact(friction=friction, restitution=0.3, stiffness=2 * stiffness)
    floor = Plane(restitution=0.1, friction=0.6)
    look = Look(azimuth=-66, elevation=14)
    return Scene(system=system, colliders=[floor], contact=contact, duration=5.5, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
