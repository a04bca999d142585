"""What a frame costs beside its substeps: keeping the state, looking it over, and telling the host.

    python -m benchmarks.speed.frames [--device D] [--quick]

A frame of 2 substeps and one of 48 are replayed as they were recorded, in turn. Their difference gives the time of
a substep, and what is left is that of the frame. Calls of `Simulation.step` are timed beside replays of the same
frame, and what reads each frame back (as `frames()` does) beside those. Times are medians over the rounds; a CPU
has one thread.
"""

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import warp as wp

from msdwarp import Plane, Simulation, box

from ..common import arguments, machine, read_csv, replay, table, write_csv

SIZES, QUICK_SIZES = (3, 10, 16, 32, 64, 100), (3, 10)
FEW, MANY = 2, 48
"""Substeps of a frame; even, so that none has to be copied back."""
ROUNDS, QUICK_ROUNDS, ROUND_SECONDS = 15, 3, 0.02
COLUMNS = ["particles", "substep_us", "frame_us", "step_us", "read_us"]
HEAD = ["particles", "µs a substep", "µs a frame beside them", "µs more by Simulation.step", "µs more by frame()"]


def timed(work: Callable[[], object], count: int, device: str) -> float:
    """Return the time [s] of a call, over so many."""
    wp.synchronize_device(device)
    start = time.perf_counter()
    for _ in range(count):
        work()
    wp.synchronize_device(device)
    return (time.perf_counter() - start) / count


def measure_size(n: int, device: str, rounds: int) -> dict:
    """Return the row of a block of n³ particles."""
    how = {"colliders": [Plane(offset=-5000.0)], "allow_unstable": True, "energy_limit": math.inf, "threads": 1}
    body = box((n, n, n), damping=20.0)
    few, many = (Simulation(body, fps=1e4, substeps=s, device=device, **how) for s in (FEW, MANY))

    contestants: dict[str, Callable[[], object]] = {}
    for name, simulation in (("few", few), ("many", many)):
        simulation.step(2)  # compiles, and records the frame
        contestants[name] = partial(replay, simulation)
    contestants["step"] = few.step
    contestants["read"] = lambda: (few.step(), few.frame())
    few.frame()  # makes room for frames
    counts = {name: max(1, round(ROUND_SECONDS / timed(work, 3, device))) for name, work in contestants.items()}
    seconds: dict[str, list[float]] = {name: [] for name in contestants}
    for k in range(rounds):
        for name in list(contestants) if k % 2 else list(contestants)[::-1]:
            seconds[name].append(timed(contestants[name], counts[name], device))
    found = {name: 1e6 * median(times) for name, times in seconds.items()}
    substep = (found["many"] - found["few"]) / (MANY - FEW)
    frame = found["few"] - FEW * substep
    step, read = found["step"] - found["few"], found["read"] - found["step"]
    return dict(zip(COLUMNS, (n**3, substep, frame, step, read), strict=True))


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "frames.csv"
    if not options.plot_only:
        sizes, rounds = (QUICK_SIZES, QUICK_ROUNDS) if options.quick else (SIZES, ROUNDS)
        write_csv(path, [measure_size(n, options.device, rounds) for n in sizes], machine(options.device))
    line, rows = read_csv(path)
    print(line)
    table("What a frame costs", HEAD, [[row.get(one, "") for one in COLUMNS] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
