"""A press squeezes blocks of rubber and of cork: rubber keeps its volume and bulges, cork does not."""

import numpy as np

from msdwarp import Box, Look, Material, Plane, Scene, box
from msdwarp.cli import scene_main
from msdwarp.textures import rings_box

SIDE, BASE, GAP, PLATE = 0.5, 0.1, 0.02, (1.8, 0.9, 0.1)


def press(time: float) -> tuple[float, float, float]:
    """Return how far the upper plate has moved: down by a quarter of the blocks, and up after two seconds."""
    down = min(np.clip(time / 1.2, 0, 1), np.clip((3.0 - time) / 0.8, 0, 1))
    return 0.0, 0.0, -(GAP + 0.27 * SIDE) * (3 - 2 * down) * down**2


def build(*, across: int = 8, rubber: float = 0.47, cork: float = 0.05, youngs_modulus: float = 4e4) -> Scene:
    """Squeeze two cubes of half a metre to three quarters of their height, and let them go.

    Parameters
    ----------
    across
        Cells across a cube.
    rubber, cork
        Poisson's ratios of the two.
    youngs_modulus
        Young's modulus of both [Pa].
    """
    bodies = []
    for name, ratio, x in (("rubber", rubber, -0.42), ("cork", cork, 0.42)):
        stuff = Material(density=300.0, youngs_modulus=youngs_modulus, damping_ratio=0.15, poissons_ratio=ratio)
        body = box((across + 1, across + 1, across + 1), SIDE / across, material=stuff)
        bodies.append(body.translate((x, 0.0, BASE + SIDE / 2)).named(name))
    return Scene(
        system=bodies[0] + bodies[1],
        colliders=[
            Plane(),
            Box((0, 0, BASE / 2), PLATE, friction=5.0),
            Box((0, 0, BASE + SIDE + GAP + PLATE[2] / 2), PLATE, motion=press, friction=5.0),
        ],
        duration=4.0,
        look=Look(obstacle="#b9c3cc", elevation=10, azimuth=-78),
        looks={
            "rubber": Look(texture=rings_box("#c8403a", "#f4efe6", 9), gloss=0.5),
            "cork": Look(texture=rings_box("#a9784a", "#e6cfa8", 9), gloss=0.05),
        },
    )


if __name__ == "__main__":
    scene_main(build)
