"""What does a gradient cost? The value and gradient of a loss, beside the run that it is of.

    python -m benchmarks.speed.gradient [--device D] [--quick]

Blocks of n³ particles with all neighbours (26 springs and dampers), leapfrog, float32: a run of 10 frames of 20
substeps by the fastest algorithm and by the gather, and the value and gradient of a loss of the last frame by the
state and by stiffness. Kernels are compiled before, no frame is copied to the host, and each number is a median.
Writes results/<device>/gradient.csv.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from msdwarp import Leapfrog, Simulation, box

from ..common import arguments, machine, read_csv, table, write_csv

SIZES, FRAMES, SUBSTEPS, REPEATS = (10, 20, 32, 64, 100), 10, 20, 5
BY = {"state": ("position", "velocity"), "state and stiffness": ("position", "velocity", "stiffness")}


def seconds(act: Callable[[], Any], device: str, repeats: int) -> float:
    """Return the median time of an action, whose launches are waited for [s]."""
    act()
    taken = []
    for _ in range(repeats):
        wp.synchronize_device(device)
        begun = time.perf_counter()
        act()
        wp.synchronize_device(device)
        taken.append(time.perf_counter() - begun)
    return float(np.median(taken))


def measure(n: int, device: str, repeats: int) -> list[dict[str, Any]]:
    """Return the rows of a block."""
    body = box((n, n, n), 0.05, stiffness=500.0, damping=0.05)
    rows, forward = [], {}
    for algorithm in ("auto", "gather"):
        how = {"force_algorithm": algorithm, "substeps": SUBSTEPS, "fps": 60.0, "device": device}
        run = Simulation(body, integrator=Leapfrog(), energy_limit=float("inf"), **how)
        run.step(2)
        forward[algorithm] = seconds(lambda run=run: run.step(FRAMES), device, repeats)
    simulation = Simulation(body, integrator=Leapfrog(), substeps=SUBSTEPS, fps=60.0, device=device)
    for kind, names in BY.items():
        run, _ = simulation.differentiated(1, names)
        nothing = [None] * FRAMES
        by_position = [*nothing, np.ones((n**3, 3))]

        def both(run=run, given=(by_position, [*nothing, None])) -> None:
            run.take(FRAMES)
            run.backward(*given)

        taken = seconds(both, device, repeats)
        rows.append(
            {
                "n": n,
                "by": kind,
                "forward_us": 1e6 * forward["auto"] / (FRAMES * SUBSTEPS),  # a substep
                "gather_us": 1e6 * forward["gather"] / (FRAMES * SUBSTEPS),
                "gradient_us": 1e6 * taken / (FRAMES * SUBSTEPS),
                "times_forward": taken / forward["auto"],
                "times_gather": taken / forward["gather"],
            }
        )
    return rows


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "gradient.csv"
    if not options.plot_only:
        rows = []
        for n in SIZES[:1] if options.quick else SIZES if options.device != "cpu" else SIZES[:3]:
            rows += measure(n, options.device, 1 if options.quick else REPEATS)
            write_csv(path, rows, machine(options.device))
    _, rows = read_csv(path)
    table("µs a substep", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
