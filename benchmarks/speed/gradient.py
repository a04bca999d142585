"""What does a gradient cost? The value and gradient of a loss, beside the run that it is of.

    python -m benchmarks.speed.gradient [--worlds] [--device D] [--quick]

Blocks of n³ particles with all neighbours (26 springs and dampers), leapfrog, float32: a run of 10 frames of 20
substeps by the fastest algorithm and by the gather, and the value and gradient of a loss of the last frame by the
state and by stiffness. Kernels are compiled before, no frame is copied to the host, and each number is a median.
Writes results/<device>/gradient.csv.

With --worlds: dice of 3³ particles in ensembles, by the state and stiffness, beside the gradient of one die alone;
times are those of a world. Writes gradient_worlds.csv.
"""

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from msdwarp import Ensemble, Leapfrog, Simulation, box

from ..common import arguments, machine, read_csv, table, write_csv

WORLDS = (64, 1000, 10_000)
SIZES, FRAMES, SUBSTEPS, REPEATS = (10, 20, 32, 64, 100), 10, 20, 15
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


def both_ways(simulation: Simulation | Ensemble, names: tuple[str, ...]) -> Callable[[], None]:
    """Return what takes all frames, and leads derivatives by the last back."""
    run, found = simulation.differentiated(1, names)
    nothing = [None] * FRAMES
    given = [*nothing, np.ones(found.position[..., 0, :, :].shape)], [*nothing, None]

    def both() -> None:
        run.take(FRAMES)
        run.backward(*given)

    return both


def measure_worlds(worlds: int, device: str, repeats: int) -> list[dict[str, Any]]:
    """Return the row of an ensemble."""
    stiffness = np.geomspace(400.0, 600.0, worlds)
    how = {"integrator": Leapfrog(), "substeps": SUBSTEPS, "fps": 60.0, "device": device}
    ensemble = Ensemble(box((3, 3, 3), 0.05, damping=0.05), worlds, stiffness=stiffness, **how)
    by, count = BY["state and stiffness"], FRAMES * SUBSTEPS
    forward = seconds(lambda: ensemble.step(FRAMES), device, repeats) / worlds
    taken = seconds(both_ways(ensemble, by), device, repeats) / worlds
    alone = seconds(both_ways(ensemble.simulation_of(0), by), device, repeats)
    return [
        {
            "worlds": worlds,
            "forward_us": 1e6 * forward / count,  # a substep
            "gradient_us": 1e6 * taken / count,
            "alone_us": 1e6 * alone / count,
            "times_forward": taken / forward,
            "faster_than_alone": alone / taken,
        }
    ]


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
        taken = seconds(both_ways(simulation, names), device, repeats)
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
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--worlds", action="store_true", help="measure ensembles")
    options = arguments(__doc__.splitlines()[0], own)
    path = options.folder / ("gradient_worlds.csv" if options.worlds else "gradient.csv")
    if not options.plot_only:
        rows, repeats = [], 1 if options.quick else REPEATS
        sizes = WORLDS if options.worlds else SIZES
        for n in sizes[:1] if options.quick else sizes if options.device != "cpu" else sizes[:3]:
            rows += (measure_worlds if options.worlds else measure)(n, options.device, repeats)
            write_csv(path, rows, machine(options.device))
    _, rows = read_csv(path)
    table("µs a substep", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
