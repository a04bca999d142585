"""Three balloons on strings sway in a gusty breeze."""

import numpy as np

from msdwarp import EnclosedGas, Force, Look, Plane, Scene, Wind, chain, icosphere, join, shell
from msdwarp.cli import scene_main

RADIUS, KNOT = 0.2, 0.27
"""Of a balloon, and how far its knot is below its middle [m]."""
BALLOONS = {"red": ("#d5312f", -0.55, 15), "yellow": ("#f0b429", 0.0, 23), "blue": ("#2f6fb5", 0.55, 19)}
"""Color, place along the wind [m], and links of the string."""


def breeze(time: float) -> tuple[float, float, float]:
    """Return the velocity of the air [m/s]."""
    return 3.0 * np.sin(1.1 * time) ** 2, 0.4 * np.sin(0.9 * time), 0.0


def blown_up() -> tuple[np.ndarray, np.ndarray]:
    """Return the points and triangles of a balloon, which narrows to its knot."""
    points, triangles = icosphere(RADIUS, 3)
    below = np.clip(-points / RADIUS, 0, 1)[:, 2:]
    return points * (1 + below**3 * (-0.4, -0.4, KNOT / RADIUS - 1)), triangles


def build(*, lift: float = 0.25, stiffness: float = 100.0, damping: float = 0.005, stretch: float = 1.03) -> Scene:
    """Moor three balloons, 40 cm wide.

    Parameters
    ----------
    lift
        Net lift of each balloon, buoyancy minus weight [N].
    stiffness
        Spring constant of each connection of a skin [N/m].
    damping
        Damper constant of each connection of a skin [N s/m].
    stretch
        Length of each connection over its length before the balloon was blown up.
    """
    link, mass = 0.05, 0.03  # of a balloon, its gas, and of air that moves with it: half of what it displaces
    skin = shell(blown_up(), total_mass=mass, stiffness=stiffness, damping=damping)
    skin = skin.replace(rest_length=skin.length / stretch)
    # The tension of a net of triangles is √3 k (l − l0)/l; on a sphere it balances a pressure 2/R times it.
    pressure = 2 / RADIUS * 3**0.5 * stiffness * (1 - 1 / stretch)
    bodies, loads = [], [Wind(breeze, drag=0.47, lift=0.0)]  # a sphere's drag
    for name, (_, x, links) in BALLOONS.items():
        string = chain(links, link, mass=1e-4, stiffness=200.0, damping=0.02).rotate(-np.pi / 2, axis=(0, 1, 0))
        string = string.translate((x, 0, 0) - string.position[0]).pin(0).named("strings")
        ball = skin.translate((x, 0, links * link + KNOT)).named(name)
        bodies.append(join(string, ball, within=link, on=([links - 1], None), stiffness=200.0, damping=0.02))
        loads += [Force((0, 0, lift + 9.82 * mass), on=name, total=True), EnclosedGas(pressure, on=name)]
    look = Look(gloss=0.9, azimuth=-80, elevation=10)
    looks = {name: Look(color=color, gloss=0.9) for name, (color, *_) in BALLOONS.items()}
    looks["strings"] = Look(color="#5a5f66", tube=0.004)
    system = bodies[0] + bodies[1] + bodies[2]
    return Scene(system=system, colliders=[Plane()], loads=loads, duration=6.0, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
