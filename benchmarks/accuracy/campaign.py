"""Does the automatic step keep its promise? Random bodies, mistreated at random, for 600 frames each.

    python -m benchmarks.accuracy.campaign [--first N] [--count N] [--workers N] [--materials] [--device D]
        [--quick]

Each body of `random_bodies` is simulated twice: with the substeps that the stability limit asks for at the start,
which is what "auto" once meant, and with "auto" as it is. Growth is the largest energy in the second half of a run
less the largest in the first second, over the largest kinetic and elastic energy in that second, the weight times
the size, and what rounding may make of nothing. Where nothing outside does work on the body it is to be nothing. A
body has heated where it is above 0.1. With --materials bodies have Poisson's ratios, laws of springs, or are rods
(campaign_materials.csv).
"""

import argparse
import math
import sys
import time
import warnings
from multiprocessing import get_context
from typing import Any

import numpy as np

from msdwarp import Simulation, SimulationDiverged
from msdwarp.engine import rounding_energy, size, weight

from ..common import arguments, machine, table, write_csv
from .random_bodies import Case, make

FRAMES = 600
SECOND = 60
"""Frames."""


def main() -> None:
    """Run bodies and write campaign.csv."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--first", type=int, default=0, help="number of the first body")
    own.add_argument("--count", type=int, default=3000, help="how many bodies")
    own.add_argument("--workers", type=int, default=1, help="processes that share the work")
    own.add_argument("--materials", action="store_true", help="bodies of materials, with laws of springs, rods")
    options = arguments(__doc__ or "", own)
    name = "campaign_materials.csv" if options.materials else "campaign.csv"
    count = 20 if options.quick else options.count
    seeds = [(seed, options.device, options.materials) for seed in range(options.first, options.first + count)]
    rows = []
    with get_context("spawn").Pool(options.workers) as pool:
        for row in pool.imap(both, seeds):
            rows.append(row)
            if row["outcome"] != "held":
                print(row, flush=True)
            if len(rows) % 100 == 0 or len(rows) == count:
                write_csv(options.folder / name, rows, machine(options.device))
    print(machine(options.device))
    summarise(rows)


def both(arguments: tuple[int, str, bool]) -> dict[str, Any]:
    """Return what became of a body, with substeps as they were at the start and with automatic ones."""
    seed, device, materials = arguments
    warnings.simplefilter("ignore")  # a displaced or thrown body may start in doubtful places
    case = make(seed, materials)
    about = {name: getattr(case, name) for name in ("seed", "shape", "act", "around", "method", "precision")}
    about |= {"particles": case.system.particle_count, "dim": case.system.dim, "damping_ratio": case.damping_ratio}
    about |= {"gravity": case.options["gravity"], "isolated": int(case.isolated)}
    found = simulate(case, device, "auto")
    before = simulate(case, device, found["substeps"])
    return about | found | {f"fixed_{name}": before[name] for name in ("outcome", "growth", "seconds")}


def simulate(case: Case, device: str, substeps: int | str) -> dict[str, Any]:
    """Return the outcome of one run."""
    simulation = Simulation(case.system, device=device, substeps=substeps, **case.options)
    first, counts, energies, inner = simulation.substeps, [], [], []
    model, state = simulation.model, simulation.state
    scale = weight(model) * size(state) + rounding_energy(simulation.assembly, state)
    outcome, began = "held", time.perf_counter()
    try:
        for _ in range(FRAMES):
            now = simulation.measure()
            energies.append(now.energy)
            inner.append(now.kinetic_energy + now.elastic_energy + now.effect_energy)
            simulation.step()
            counts.append(simulation.substeps)
    except SimulationDiverged as error:
        outcome = "ended" if "energy has grown" in str(error) else "diverged"
    seconds, growth = time.perf_counter() - began, math.nan
    if len(energies) > FRAMES // 2:
        growth = max(energies[FRAMES // 2 :]) - max(energies[: SECOND + 1])
        growth /= max(inner[: SECOND + 1]) + scale
        if outcome == "held" and case.isolated and growth > 0.1:
            outcome = "heated"
    mean, most = (float(np.mean(counts)), max(counts)) if counts else (first, first)
    return {
        "outcome": outcome,
        "growth": growth,
        "substeps": first,
        "mean_substeps": mean,
        "most_substeps": most,
        "seconds": seconds,
    }


def summarise(rows: list[dict]) -> None:
    """Print how many bodies held, by what was done to them and by damping."""
    outcomes = ("held", "heated", "diverged", "ended")
    for name in ("act", "around", "method", "precision", "damping_ratio"):
        lines = []
        for value in sorted({row[name] for row in rows}, key=str):
            chosen = [row for row in rows if row[name] == value]
            before = [sum(row["fixed_outcome"] == one for row in chosen) for one in outcomes[:3]]
            after = [sum(row["outcome"] == one for row in chosen) for one in outcomes]
            ratio = sum(r["mean_substeps"] for r in chosen) / sum(r["substeps"] for r in chosen)
            lines.append([str(value), str(len(chosen)), *map(str, before), *map(str, after), f"{ratio:.2f}"])
        heads = [*(f"fixed: {one}" for one in outcomes[:3]), *(f"auto: {one}" for one in outcomes)]
        table(f"by {name}", [name, "bodies", *heads, "substeps"], lines)
    worst = max(
        (row for row in rows if row["isolated"] and row["growth"] == row["growth"]), key=lambda r: r["growth"]
    )
    print(f"largest growth of an isolated body: {worst['growth']:.3f} (body {worst['seed']})")


if __name__ == "__main__":
    sys.exit(main())
