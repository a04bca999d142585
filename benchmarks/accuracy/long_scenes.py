"""Simulates the scenes in contact for a minute each, and counts the frames in which bodies cross.

    python -m benchmarks.accuracy.long_scenes [--device D] [--quick]

Every 10th frame is looked at, by ipctk (see `benchmarks.accuracy.crossings`). `start` tells whether anything
crosses before the first frame, `heard` how many warnings there were, `held` the furthest that anything was held
back in a substep [m], and `speed` that of the fastest particle at the end. Writes
results/<device>/contact_long_scenes.csv.
"""

import importlib
import sys
import warnings

import numpy as np

from msdwarp import Simulation

from ..common import arguments, machine, table, write_csv
from ..speed.contact_scenes import SCENES
from .crossings import Oracle

SECONDS, QUICK_SECONDS, EVERY = 60.0, 1.0, 10
"""Simulated time [s], and which frames are looked at."""


def watch(name: str, seconds: float, device: str) -> dict:
    """Simulate a scene; count the frames with crossings."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        simulation = Simulation.from_scene(
            importlib.import_module(f"msdwarp.scenes.{name}").build(), device=device
        )
        contact = simulation.assembly.body_contact  # None where bodies only meet obstacles
        oracle, crossing, held = Oracle(simulation.system), 0, 0.0
        start = oracle.crosses(simulation.system.position)
        frames = round(seconds * simulation.fps)
        for frame in range(frames):
            simulation.step()
            if contact is not None:
                held = max(held, float(contact.held_back.max()))
            if (frame + 1) % EVERY == 0:
                crossing += oracle.crosses(simulation.frame().position)
    return {
        "scene": name,
        "frames": frames // EVERY,
        "start": int(start),
        "crossing": crossing,
        "heard": len(heard),
        "held": held,  # [m]
        "speed": float(np.linalg.norm(simulation.frame().velocity, axis=1).max()),  # [m/s]
    }


def main() -> None:
    """Measure, write and print."""
    options, rows = arguments(__doc__.splitlines()[0]), []
    for name in SCENES:
        rows.append(watch(name, QUICK_SECONDS if options.quick else SECONDS, options.device))
        print(rows[-1], flush=True)
        write_csv(options.folder / "contact_long_scenes.csv", rows, machine(options.device))
    table("contact_long_scenes.csv", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
