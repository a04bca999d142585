"""Counts the frames in which a cloth that is folded on itself goes through itself.

    python -m benchmarks.accuracy.folding [--device D] [--quick]

A strip of 13 × 7 particles, 50 mm apart, lies on a floor, held by one end; the other is brought to within 30 % of
the strip's length of it, and back, again and again. Stiffer and softer cloth, of the thickness that it has by
itself and of a greater one, is folded slowly and fast. Counted are the frames in which triangles cross, by the
Incremental Potential Contact Toolkit (ipctk.xyz). Writes results/<device>/contact_folding.csv.
"""

import math
import sys

import numpy as np

from msdwarp import Contact, Plane, PrescribedMotion, Scene, Simulation, sheet

from ..common import arguments, machine, table, write_csv
from .crossings import crossings

SPACING, SQUEEZED, TIMES = 0.05, 0.7, 4
"""Of the particles [m]; by how much of its length the strip is shortened; and how often."""
BENDING = (1e-3, 4e-3)
"""Flexural rigidity [N m]."""
THICKNESS = (None, 0.02)
PERIODS = (1.5, 1.0, 0.75, 0.35, 0.2, 0.13)
"""How long it takes to fold the strip and to unfold it [s]."""


def fold(bending: float, thickness: float | None, period: float, device: str) -> dict:
    """Fold a strip and count the frames in which it crosses itself."""
    cloth = sheet((13, 7), SPACING, mass=0.002, stiffness=60.0, damping=0.05, bending=bending)
    cloth = cloth.translate(tuple(np.array([0, 0, 0.01]) - cloth.position.min(axis=0)))
    along = cloth.position[:, 0]
    way = SQUEEZED * np.ptp(along)

    def squeeze(t):
        return way * (np.cos(2 * np.pi * np.asarray(t)[..., None] / period) - 1) / 2 * np.array([1, 0, 0])

    scene = Scene(
        system=cloth.pin(along < 0.5 * SPACING),
        colliders=[Plane(restitution=0.0, friction=0.5)],
        loads=[PrescribedMotion(np.flatnonzero(along > along.max() - 0.5 * SPACING), squeeze)],
        contact=Contact(friction=0.3, restitution=0.1, self_contact=True, thickness=thickness),
    )
    simulation = Simulation.from_scene(scene, device=device)
    frames = round(TIMES * period * simulation.fps)
    crossing = crossings(simulation, frames)
    return {
        "bending": bending,
        "thickness": float("nan") if thickness is None else thickness,  # nan: what it has by itself
        "period": period,
        "speed": math.pi * way / period,  # of the moved end, at most [m/s]
        "frames": frames,
        "crossing": len(crossing),
        "first": crossing[0] if crossing else -1,
    }


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    rows = []
    for period in PERIODS[: 1 if options.quick else None]:
        for bending in BENDING:
            for thickness in THICKNESS:
                rows.append(fold(bending, thickness, period, options.device))
                write_csv(options.folder / "contact_folding.csv", rows, machine(options.device))
    table("contact_folding.csv", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
