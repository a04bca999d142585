"""Scenes in contact: how long a substep takes, in the median frame and on average.

    python -m benchmarks.speed.contact_scenes [--device D] [--quick]

Each scene is simulated from its start at automatic substeps; each frame is waited for. A frame that is recorded or
repeated counts in the mean, compilation does not: each scene has run before. `substeps` is the number in the last
frame, `without` the number that the same bodies need at the start without contact. Writes
results/<device>/contact_scenes.csv.
"""

import importlib
import sys
import time
from dataclasses import replace
from statistics import mean, median

import warp as wp

from msdwarp import Scene, Simulation

from ..common import arguments, machine, table, write_csv

SCENES = ("tower", "mattress", "curtain", "cradle", "dice", "trampoline", "bowl", "pile", "balloon")
FRAMES, QUICK_FRAMES = 120, 10


def timed(scene: Scene, device: str, frames: int) -> tuple[list[float], Simulation]:
    """Return the time of each frame per substep [µs], and the simulation at its end."""
    simulation, times = Simulation.from_scene(scene, device=device), []
    for _ in range(frames):
        began = time.perf_counter()
        simulation.step()
        wp.synchronize_device(simulation.device)
        times.append(1e6 * (time.perf_counter() - began) / simulation.substeps)
    return times, simulation


def main() -> None:
    """Measure, write and print."""
    options, rows = arguments(__doc__.splitlines()[0]), []
    frames = QUICK_FRAMES if options.quick else FRAMES
    for name in SCENES:
        scene = importlib.import_module(f"msdwarp.scenes.{name}").build()
        timed(scene, options.device, frames)
        times, simulation = timed(scene, options.device, frames)
        row = {
            "scene": name,
            "particles": simulation.system.particle_count,
            "substeps": simulation.substeps,
            "without": Simulation.from_scene(replace(scene, contact=()), device=options.device).substeps,
            "median_us": median(times),
            "mean_us": mean(times),
            "real_time": 1e6 / (mean(times) * simulation.substeps * simulation.fps),
        }
        rows.append(row)
        write_csv(options.folder / "contact_scenes.csv", rows, machine(options.device))
    table("µs a substep", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
