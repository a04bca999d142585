"""A cloth falls over a ball onto the floor and folds onto itself."""

from msdwarp import Contact, Look, Plane, Scene, checks, icosphere, sheet, shell
from msdwarp.cli import scene_main
from msdwarp.textures import gingham


def build(
    *,
    size: int = 27,
    stiffness: float = 60.0,
    damping: float = 0.02,
    mass: float = 0.0009,
    bending: float = 0.001,
) -> Scene:
    """Drop a cloth, 1.4 m wide, over a ball.

    Parameters
    ----------
    size
        Particles along an edge.
    bending
        Flexural rigidity [N m]. With less, folds become narrower than the spacing.
    """
    checks.count("size", size, 5)
    cloth = sheet((size, size), 1.4 / (size - 1), mass=mass, stiffness=stiffness, damping=damping, bending=bending)
    cloth = cloth.rotate(0.3).rotate(0.06, axis=(1, 0.5, 0)).translate((0.06, 0.04, 0.85))
    # An obstacle would hold the particles alone, and show between them; a body holds what is between them too.
    ball = shell(icosphere(0.26, 3), total_mass=mass, stiffness=stiffness, damping=damping)
    ball = ball.translate((0, 0, 0.3)).pin(slice(None)).named("ball")
    floor = Plane(restitution=0.0, friction=0.5)
    look = Look(texture=gingham("#b0425a", "#fdf2e0"), finish="cloth", azimuth=-60, elevation=22)
    looks = {"ball": Look(color="#e0b04c", gloss=0.5, finish="metal")}
    contact = Contact(friction=0.3, restitution=0.1, self_contact=True, thickness=0.016)
    return Scene(system=cloth + ball, colliders=[floor], contact=contact, duration=3.0, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
