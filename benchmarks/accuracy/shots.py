"""Counts the frames in which a block that is shot at a cloth cuts through it, and tells where it ends.

    python -m benchmarks.accuracy.shots [--device D] [--quick]

A cloth of 15 × 15 particles, 50 mm apart, is held by its rim. A block of 50 g, far stiffer than the cloth, hits it
at 1 to 12 m/s: one of 120 mm, and one of 30 mm, smaller than the squares of the cloth. Counted are the frames,
of one and a half seconds, in which triangles of the two cross, by the Incremental Potential Contact Toolkit
(ipctk.xyz). Writes results/<device>/contact_shots.csv.
"""

import sys

import numpy as np

from msdwarp import Contact, Scene, Simulation, box, sheet

from ..common import arguments, machine, table, write_csv
from .crossings import crossings

SPEEDS = (1.0, 2.0, 4.0, 6.0, 8.0, 12.0)
"""[m/s]."""
BLOCKS = ((4, 0.04), (2, 0.03))
"""Particles along an edge, and how far they are apart [m]."""
FRAMES = 90


def shoot(along: int, spacing: float, speed: float, device: str) -> dict:
    """Shoot a block at a cloth."""
    cloth = sheet((15, 15), 0.05, mass=0.002, stiffness=60.0, damping=0.05, bending=1e-3)
    cloth = cloth.translate(tuple(-cloth.position.mean(axis=0)))
    off = np.abs(cloth.position[:, :2]).max(axis=1)
    block = box((along,) * 3, spacing, mass=0.05 / along**3, stiffness=600.0, damping=0.1).rotate(0.4)
    block = block.translate(tuple(np.array([0.011, 0.007, 0.13]) - block.position.mean(axis=0)))
    system = cloth.pin(off > off.max() - 0.01) + block.with_velocity((0, 0, -speed))
    simulation = Simulation.from_scene(
        Scene(system=system, contact=Contact(friction=0.3, restitution=0.1)), device=device
    )
    crossing = crossings(simulation, FRAMES)
    return {
        "edge": (along - 1) * spacing,  # of the block [m]
        "speed": speed,
        "frames": FRAMES,
        "crossing": len(crossing),
        "height": float(simulation.frame().position[cloth.particle_count :, 2].mean()),  # at the end [m]
    }


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    rows = []
    for block in BLOCKS[: 1 if options.quick else None]:
        for speed in SPEEDS[: 1 if options.quick else None]:
            rows.append(shoot(*block, speed, options.device))
            write_csv(options.folder / "contact_shots.csv", rows, machine(options.device))
    table("contact_shots.csv", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
