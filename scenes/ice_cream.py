"""A scoop of ice cream is set on a cone, sags over the rim, and keeps its new shape."""

from msdwarp import Cone, Look, Plane, Scene, ball, checks
from msdwarp.cli import scene_main
from msdwarp.textures import scoop, waffle


def build(*, size: int = 14, stiffness: float = 32.0, damping: float = 0.3, yield_strain: float = 0.025) -> Scene:
    """Set a scoop, 80 cm wide, on a cone.

    Parameters
    ----------
    size
        Particles across the scoop.
    yield_strain
        Strain beyond which it deforms permanently.
    """
    checks.count("size", size, 6)
    radius = 0.4
    body = ball(radius, 2 * radius / (size - 1), mass=8.0 / size**3, stiffness=stiffness, damping=damping)
    body = body.replace(yield_strain=yield_strain, relaxation_time=0.3, largest_plastic_strain=0.5)
    body = body.translate((0, 0, radius + 0.02))
    cone = Cone((0, 0, -0.9), (0, 0, 0), 0.33, restitution=0.0, friction=1.0)
    table = Plane(offset=-0.55)  # the cone's tip stands in a hole of it
    look = Look(
        texture=scoop("#ffc3cb", "#9c2f45"),
        gloss=0.15,
        obstacle_texture=waffle("#e0a858", "#9a6428", counts=(10, 6), diagonal=True),
        elevation=20,
    )
    return Scene(system=body, colliders=[cone, table], duration=4.0, look=look)


if __name__ == "__main__":
    scene_main(build)
