"""What watching the energy costs a frame: batches of frames with automatic substeps, and as many without a watch.

    python -m benchmarks.speed.watch [--device D] [--quick]

Both take the same number of substeps and turns; times are medians over the rounds. On a GPU a frame tells its
energies itself where they are looked at often, and the next frame is under way before it is judged.
"""

import math
import sys
import time
from statistics import median
from typing import Any

import warp as wp

from msdwarp import Plane, Simulation, box

from ..common import arguments, machine, read_csv, scene_scripts, table, write_csv

FRAMES = 20
"""Frames of a batch."""
ROUNDS, QUICK_ROUNDS = 25, 3
SIZES = (16, 31)
SCENES = ("cloth", "jelly")
COLUMNS = ["body", "particles", "substeps", "watched_us", "free_us", "more_us"]
HEAD = ["body", "particles", "substeps", "µs a frame, watched", "µs a frame, not watched", "µs more"]


def cases() -> dict[str, dict[str, Any]]:
    """Return what simulations are made of, by name; the changes that scenes schedule are left out."""
    found = {}
    scripts = scene_scripts()
    for name in SCENES:
        scene = scripts[name].build()
        found[name] = {"system": scene.system, "colliders": scene.colliders, "gravity": scene.gravity}
    for n in SIZES:
        body = box((n, n, n), damping=20.0)
        found[f"box {n}^3"] = {"system": body, "colliders": [Plane(offset=-5000.0)]}
    return found


def measure_case(name: str, given: dict[str, Any], device: str, rounds: int) -> dict[str, Any]:
    """Return the row of a case."""
    watched = Simulation(**given, device=device)
    watched.step(3 * FRAMES)  # compiles, records, and finds how many substeps it takes
    fixed = {"substeps": watched.substeps, "allow_unstable": True, "energy_limit": math.inf}
    free = Simulation(**given, device=device, **fixed)
    free.step(3 * FRAMES)
    seconds: dict[str, list[float]] = {"watched": [], "free": []}
    for k in range(rounds):
        pair = [("watched", watched), ("free", free)]
        for which, simulation in pair if k % 2 else pair[::-1]:
            wp.synchronize_device(device)
            start = time.perf_counter()
            simulation.step(FRAMES)
            wp.synchronize_device(device)
            seconds[which].append((time.perf_counter() - start) / FRAMES)
    both = {f"{which}_us": 1e6 * median(found) for which, found in seconds.items()}
    row = {"body": name, "particles": watched.model.particle_count, "substeps": watched.substeps, **both}
    return row | {"more_us": both["watched_us"] - both["free_us"]}


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path, rounds = options.folder / "watch.csv", QUICK_ROUNDS if options.quick else ROUNDS
    if not options.plot_only:
        found = [measure_case(name, given, options.device, rounds) for name, given in cases().items()]
        write_csv(path, found, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    table("What watching the energy costs a frame", HEAD, [[row[one] for one in COLUMNS] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
