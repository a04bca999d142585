"""Pulls an overhand knot in a rope tight, and counts the substeps in which the rope goes through itself.

    python -m benchmarks.accuracy.knots [--device D] [--quick]

The rope has 120 particles of 2 g, 16 mm apart. One end is held, the other is pulled away at 0.5 to 20 m/s until
the ends are 1.7 m apart, and held there for half a second. Counted are the substeps in which segments go through
each other on their straight ways, by code that shares nothing with msdwarp: none may, so the knot stays. `risen`
is by how much energy rises at most while both ends are held, by what it is then at first. `without` is the number
of substeps that the same rope needs without contact. Writes results/<device>/contact_knots.csv.
"""

import sys

import numpy as np

from msdwarp import Contact, Leapfrog, PrescribedMotion, Simulation, SymplecticEuler, System, chain

from ..common import arguments, machine, table, write_csv
from .crossings import Oracle

PARTICLES, SCALE = 120, 0.06
"""Number of particles, and of metres per unit of the curve."""
SPEEDS = (0.5, 2.0, 5.0, 10.0, 20.0)
"""[m/s]."""
APART, HELD = 1.7, 0.5
"""How far apart the ends are at last [m], and for how long then [s]."""
METHODS = {"symplectic Euler": SymplecticEuler(), "leapfrog": Leapfrog()}


def knotted() -> System:
    """Return a rope with an open overhand knot, a polynomial trefoil."""
    t = np.linspace(-2.2, 2.2, 4000)
    curve = SCALE * np.column_stack([t**3 - 3 * t, -0.1 * (t**5 - 10 * t), t**4 - 4 * t**2])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], PARTICLES)
    x = np.column_stack([np.interp(at, way, one) for one in curve.T])
    return chain(PARTICLES, way[-1] / (PARTICLES - 1), mass=0.002, stiffness=400.0, damping=0.02).replace(
        position=x
    )


def pull(speed: float, method: str, device: str) -> dict:
    """Pull the knot tight."""
    rope = knotted()
    ends = rope.position[[0, -1]]
    start = float(np.linalg.norm(ends[1] - ends[0]))
    away, most = (ends[1] - ends[0]) / start, APART - start
    loads = [PrescribedMotion([PARTICLES - 1], lambda t: np.multiply.outer(np.minimum(speed * t, most), away))]
    options = {"loads": loads, "gravity": 0.0, "integrator": METHODS[method], "device": device}
    contact = Contact(self_contact=True, friction=0.3)
    with_contact, without = (Simulation(rope.pin([0]), contact=one, **options).substeps for one in (contact, ()))
    # A frame for each substep, so that the oracle sees each.
    simulation = Simulation(rope.pin([0]), contact=contact, fps=60.0 * with_contact, **options)
    oracle, crossing, energies = Oracle(rope, ways=True), 0, list[float]()
    seen = round((most / speed + HELD) * simulation.fps)
    for _ in range(seen):
        simulation.step()
        crossing += oracle.crosses(simulation.frame().position)
        if simulation.time > most / speed:
            energies.append(simulation.measure().energy)
    return {
        "speed": speed,  # [m/s]
        "method": method,
        "substeps": with_contact,
        "without": without,
        "seen": seen,
        "crossing": crossing,
        "risen": float((energies - np.minimum.accumulate(energies)).max() / energies[0]),
    }


def main() -> None:
    """Measure, write and print."""
    options, rows = arguments(__doc__.splitlines()[0]), []
    for speed in SPEEDS[: 1 if options.quick else None]:
        for method in METHODS:
            rows.append(pull(speed, method, options.device))
            write_csv(options.folder / "contact_knots.csv", rows, machine(options.device))
    table("contact_knots.csv", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
