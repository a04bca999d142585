"""A rope bridge sags as three tubs on it are filled with water, one after the other."""

from itertools import product
from typing import Any

import numpy as np
import warp as wp

from msdwarp import Capsule, Force, Look, Scene, box, chain, cylinder, join
from msdwarp.cli import scene_main

LINKS, LINK, SAG, WIDTH, RAIL = 35, 0.2, 0.4, 1.1, 0.9
"""Links of a rope, and their length; how far ropes hang down; the bridge's width and the handrails' height [m]."""
TUBS = {"first": (2.3, 0.5), "second": (4.7, 2.5), "third": (3.5, 4.5)}
"""Where each tub stands [m], and from when on water runs into it [s]."""


@wp.func
def slow(x: Any, v: Any, t: Any, i: int) -> Any:
    """Return what stands for the friction of strands and knots [N]: 1 N s/m on each particle."""
    return -v


def build(*, load: float = 70.0, stiffness: float = 3e5, damping: float = 20.0) -> Scene:
    """Span a stream, seven metres wide.

    Parameters
    ----------
    load
        Mass of the water that fills each tub in 1.5 s [kg].
    stiffness
        Spring constant of each link of a rope [N/m]; all other connections have a third of it.
    damping
        Damper constant of each link of a rope [N s/m]; all other connections have a third of it.
    """
    wood: dict[str, Any] = {"stiffness": stiffness / 3, "damping": damping / 3}
    rope = chain(LINKS + 1, LINK, mass=0.1, stiffness=stiffness, damping=damping).named("ropes").pin([0, LINKS])
    x = rope.position[:, 0] - rope.position[0, 0]
    low = 4 * SAG * x * (x - x[-1]) / x[-1] ** 2
    rope = rope.replace(position=np.stack([x, 0 * x - WIDTH / 2, low], axis=1)).set_rest_shape()
    feet = rope + rope.translate((0, WIDTH, 0))
    posts = np.add.outer((0, LINKS + 1), np.arange(2, LINKS - 1, 2)).ravel()
    system = join(feet, feet.translate((0, 0, RAIL)), pairs=np.stack([posts, posts], axis=1), **wood)
    plank = box((2, 5, 2), (LINK, (WIDTH - 0.1) / 4, 0.07), mass=0.1, **wood).named("planks")
    for k in range(1, LINKS - 1, 2):
        ties = [(s * (LINKS + 1) + k + a, b + 8 * s + 10 * up) for s, a, b, up in product((0, 1), repeat=4)]
        system = join(system, plank.translate((x[k] + LINK / 2, 0, low[k : k + 2].mean())), pairs=ties, **wood)
    tub, loads, full = cylinder(0.3, 0.27, 0.09, mass=0.03, **wood), [Force(slow, on="planks")], -9.82 * load
    for name, (at, start) in TUBS.items():
        here = tub.translate((at, 0, np.interp(at, x, low) + 0.19)).named(name)
        system = join(system, here, within=0.13, on=("planks", None), **wood)
        loads += [Force(lambda t, s=start: (0, 0, np.interp(t, (s, s + 1.5), (0, full))), on=name, total=True)]
    ends = [Capsule((x, y, -0.3), (x, y, RAIL + 0.1), 0.05) for x in x[[0, -1]] for y in (-WIDTH / 2, WIDTH / 2)]
    look = Look(color="#8a6238", gloss=0.1, obstacle="#6b5138", azimuth=-60, elevation=16)
    looks = {"ropes": Look(color="#c2a878", tube=0.02)} | dict.fromkeys(TUBS, Look(color="#2f6fb5", tube=0.001))
    return Scene(system=system, colliders=ends, loads=loads, duration=8.0, look=look, looks=looks)


if __name__ == "__main__":
    scene_main(build)
