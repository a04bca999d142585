"""How long a fit takes, and where the time goes: two parameters of a jelly of 10³ particles, over a second.

    python -m benchmarks.speed.fit [--device D] [--quick] [--rounds N]

A jelly hangs by its top and is let go. Where 100 of its particles are is measured 60 times a second without noise;
its stiffness and damping are fitted from 1.6 and 0.5 times what they were, in float64. The first fit compiles
kernels, or loads them; of the others the median counts.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np

from msdwarp import Ensemble, Leapfrog, Scene, Simulation, TrackedPoints, box, fit
from msdwarp.studies.fit_predictions import Worlds

from ..common import arguments, machine, read_csv, table, write_csv

STIFFNESS, DAMPING = 200.0, 0.2
"""What made the motion [N/m], [N s/m]."""
BOUNDS = {"stiffness": (50.0, 800.0), "damping": (0.05, 0.8)}
METHOD = Leapfrog(damper_extrapolation=0.5)
DURATION, QUICK_DURATION = 1.0, 0.2
"""[s]"""
SIZE, QUICK_SIZE = 10, 4
FOLLOWED = 100
AIM = 1.0
"""Seconds asked for on an H200."""


def hung(size: int, stiffness: float = STIFFNESS, damping: float = DAMPING) -> Scene:
    """Return a jelly that is held at its top and let go."""
    body = box((size, size, size), 0.05, mass=0.01, stiffness=stiffness, damping=damping)
    return Scene(system=body.pin(body.position[:, 2] > body.position[:, 2].max() - 1e-6))


def measured(scene: Scene, substeps: int, duration: float, device: str) -> TrackedPoints:
    """Return where some of the particles are in each frame."""
    simulation = Simulation.from_scene(
        scene, integrator=METHOD, precision="float64", substeps=substeps, device=device
    )
    frames = list(simulation.frames(duration))
    count = scene.system.particle_count
    followed = np.arange(0, count, max(1, count // FOLLOWED))
    position = np.array([frame.position[followed] for frame in frames])
    time_of = np.repeat([frame.time for frame in frames], len(followed))
    return TrackedPoints(time_of, np.tile(followed, len(frames)), position.reshape(-1, 3))


@contextmanager
def clocked(owner: Any, name: str, spent: dict[str, float], part: str) -> Iterator[None]:
    """Add to `spent[part]` the time that a method takes [s]."""
    method: Callable[..., Any] = getattr(owner, name)

    def timed(*given: Any, **named: Any) -> Any:
        began = time.perf_counter()
        try:
            return method(*given, **named)
        finally:
            spent[part] += time.perf_counter() - began

    with patch.object(owner, name, timed):
        yield


def one_fit(scene: Scene, points: TrackedPoints, substeps: int, device: str) -> dict:
    """Return how long a fit takes, by part [s]."""
    spent = {"worlds": 0.0, "made": 0.0}
    began = time.perf_counter()
    with clocked(Worlds, "predict", spent, "worlds"), clocked(Ensemble, "__init__", spent, "made"):
        how: dict[str, Any] = {"bounds": BOUNDS, "substeps": substeps, "device": device}
        found = fit(scene, points, ["stiffness", "damping"], **how)
    whole = time.perf_counter() - began
    off = max(abs(found.values["stiffness"] / STIFFNESS - 1), abs(found.values["damping"] / DAMPING - 1))
    return {
        "seconds": whole,
        "making_ensembles": spent["made"],
        "running_ensembles": spent["worlds"] - spent["made"],
        "least_squares": whole - spent["worlds"],
        "ensembles": found.batches,
        "worlds": found.runs,
        "substeps": found.substeps,
        "off": off,
    }


def measure(options: argparse.Namespace) -> list[dict]:
    """Return a row for the first fit, and one of medians for the others."""
    size, duration = (QUICK_SIZE, QUICK_DURATION) if options.quick else (SIZE, DURATION)
    stiffest = hung(size, BOUNDS["stiffness"][1], BOUNDS["damping"][1])
    substeps = Simulation.from_scene(stiffest, integrator=METHOD, device=options.device).substeps
    points = measured(hung(size), substeps, duration, options.device)
    fits = []
    for _ in range(1 + options.rounds):
        fits.append(one_fit(hung(size, 1.6 * STIFFNESS, 0.5 * DAMPING), points, substeps, options.device))
        print(fits[-1], flush=True)
    later = {name: median(row[name] for row in fits[1:]) for name in fits[0]}
    rows = [{"fit": "first"} | fits[0], {"fit": "later"} | later]
    return [row | {"particles": size**3, "duration": duration} for row in rows]


def main() -> None:
    """Measure, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--rounds", type=int, default=3, help="fits after the first")
    options = arguments(__doc__.splitlines()[0], own)
    path = options.folder / "fit.csv"
    if not options.plot_only:
        write_csv(path, measure(options), machine(options.device))
    line, rows = read_csv(path)
    table(
        f"A fit, on {line}; asked for on an H200: {AIM:g} s", list(rows[0]), [list(row.values()) for row in rows]
    )


if __name__ == "__main__":
    sys.exit(main())
