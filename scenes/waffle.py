"""A warm waffle falls onto a rolling pin and bends permanently."""

from msdwarp import Capsule, Look, Plane, Scene, box
from msdwarp.cli import scene_main
from msdwarp.textures import waffle_box


def build(
    *, stiffness: float = 800.0, damping: float = 3.0, mass: float = 0.01, yield_strain: float = 0.02
) -> Scene:
    """Drop a waffle of 10 × 8 × 2 particles on a rolling pin.

    Parameters
    ----------
    yield_strain
        Strain beyond which it bends permanently.
    """
    plate = box((10, 8, 2), 0.1, mass=mass, stiffness=stiffness, damping=damping)
    plate = plate.replace(yield_strain=yield_strain, relaxation_time=0.3, largest_plastic_strain=0.3)
    plate = plate.rotate(0.15, axis=(0.3, 1, 0)).translate((0.02, 0, 0.9))
    pin = Capsule((0, -0.7, 0.22), (0, 0.7, 0.22), 0.2, restitution=0.0, friction=0.8)
    look = Look(
        texture=waffle_box("#d99a45", "#8a5320"), gloss=0.15, obstacle="#d6b284", azimuth=-50, elevation=22
    )
    return Scene(system=plate, colliders=[Plane(restitution=0.1, friction=0.6), pin], duration=3.0, look=look)


if __name__ == "__main__":
    scene_main(build)
