"""A press squeezes a ball of rubber and one of foam flat: rubber keeps its volume and bulges, foam does not."""

import numpy as np

from msdwarp import Box, Look, Material, Plane, Scene, from_mesh, icosphere
from msdwarp.cli import scene_main
from msdwarp.textures import rings

RADIUS, BASE, GAP, PLATE = 0.3, 0.1, 0.02, (1.9, 1.0, 0.1)


def press(time: float) -> tuple[float, float, float]:
    """Return how far the upper plate has moved: down by half of the balls, and up after two seconds."""
    down = min(np.clip(time / 1.2, 0, 1), np.clip((3.0 - time) / 0.8, 0, 1))
    return 0.0, 0.0, -(GAP + RADIUS) * (3 - 2 * down) * down**2


def build(*, across: int = 10, rubber: float = 0.47, foam: float = 0.3, youngs_modulus: float = 4e4) -> Scene:
    """Squeeze two balls of 60 cm to half of their height, and let them go.

    Parameters
    ----------
    across
        Cells across a ball.
    rubber, foam
        Poisson's ratios of the two.
    youngs_modulus
        Young's modulus of both [Pa].
    """
    bodies = []
    for name, ratio, x in (("rubber", rubber, -0.45), ("foam", foam, 0.45)):
        stuff = Material(density=300.0, youngs_modulus=youngs_modulus, damping_ratio=0.15, poissons_ratio=ratio)
        body = from_mesh(icosphere(RADIUS, 3), across=across, material=stuff)
        bodies.append(body.translate((x, 0.0, BASE + RADIUS)).named(name))
    return Scene(
        system=bodies[0] + bodies[1],
        colliders=[
            Plane(),
            Box((0, 0, BASE / 2), PLATE, friction=1.0),
            Box((0, 0, BASE + 2 * RADIUS + GAP + PLATE[2] / 2), PLATE, motion=press, friction=1.0),
        ],
        duration=4.0,
        look=Look(obstacle="#c8d2db", elevation=5, azimuth=-90),
        looks={
            "rubber": Look(texture=rings("#c8403a", "#f4efe6", 9), gloss=0.2, finish="rubber"),
            "foam": Look(texture=rings("#d9b44a", "#f7eccb", 9), gloss=0.05),
        },
    )


if __name__ == "__main__":
    scene_main(build)
