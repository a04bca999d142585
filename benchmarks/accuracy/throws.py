"""Throws five dice many times, and asks whether they are fair.

    python -m benchmarks.accuracy.throws [--worlds 100000] [--at-once 10000] [--device D] [--quick] [--plot-only]

Each throw is a world of an `Ensemble` of the scene `dice`, whose dice knock each other, the floor and the walls
for four seconds. They start turned at random, each rotation as likely as any other. Then symmetry says that a fair
die shows each side once in six throws, whatever else happens to it. Loaded dice have one heavier particle, in the
middle of the side with one dot, which tends to lie below. Writes results/<device>/throws.csv and
docs/images/throws.png.
"""

import argparse
import time
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare

from msdwarp import Ensemble, box
from msdwarp.scenes import dice
from msdwarp.textures import DIE

from ..common import arguments, machine, pyplot, read_csv, save, table, write_csv

DICE, SECONDS, APART = 5, 4.0, 0.56
"""Dice of a throw; how long it is simulated [s]; how far dice start apart, so that none touches another [m]."""
HEAVY = 0.3
"""Mass of the heavier particle of a loaded die, whose others have 0.02 [kg]."""
SIDES = np.arange(1, 7)


def starts(worlds: int, random: np.random.Generator, die: np.ndarray) -> dict[str, Any]:
    """Return positions [m] and velocities [m/s] of the particles of all dice, shape [worlds, 135, 3]."""
    turned = Rotation.random(worlds * DICE, rng=random).as_matrix() @ die.T
    turned = np.swapaxes(turned, 1, 2).reshape(worlds, DICE, -1, 3)
    place = random.uniform(0, 1, (worlds, DICE, 1, 3)) * (0.3, 0.0, 0.5) + (-1.6, 0.0, 0.9)
    place[..., 1] += APART * (np.arange(DICE) - (DICE - 1) / 2)[:, None]
    forwards = random.uniform((2.0, 0.3, -0.5), (3.2, 0.3, 1.0), (worlds, DICE, 1, 3))
    spin = 9.0 * random.normal(size=(worlds, DICE, 1, 3))
    velocity = forwards + np.cross(spin, turned)
    return {"position": (place + turned).reshape(worlds, -1, 3), "velocity": velocity.reshape(worlds, -1, 3)}


def thrown(worlds: int, at_once: int, loaded: bool, device: str) -> dict:
    """Throw the dice so many times, and count how often each side lies up."""
    scene, random = dice.build(count=DICE), np.random.default_rng(1)
    die = box((3, 3, 3), 0.15).position
    counts, diverged, substeps, began = np.zeros(6, dtype=int), 0, 0, time.perf_counter()
    mass = np.full(len(die), 0.02)
    if loaded:
        axis, end = divmod(DIE.index(1), 2)
        mass[np.isclose(die, (2 * end - 1) * 0.15 * np.eye(3)[axis]).all(axis=1)] = HEAVY
    scene = replace(scene, system=scene.system.replace(mass=np.tile(mass, DICE)))
    for first in range(0, worlds, at_once):
        now = min(at_once, worlds - first)
        ensemble = Ensemble(scene, now, device=device, **starts(now, random, die))
        ensemble.step(round(SECONDS * ensemble.fps))
        _, position, velocity = ensemble.frame()
        good = ensemble.status == "running"
        shown = scene.observe["dots"](position, velocity)[good]
        counts += np.bincount(shown.ravel(), minlength=7)[1:]
        diverged, substeps = diverged + int((~good).sum()), ensemble.substeps
        done = first + now
        print(f"  {done} throws in {time.perf_counter() - began:.0f} s: {counts}", flush=True)
    test = chisquare(counts)
    return {
        "dice": "loaded" if loaded else "fair",
        "throws": worlds,
        **{f"side_{side}": int(counts[side - 1]) for side in SIDES},
        "chi_square": float(test.statistic),
        "p": float(test.pvalue),
        "diverged": diverged,
        "substeps": substeps,
        "seconds": time.perf_counter() - began,
    }


def plot(rows: list[dict]) -> None:
    """Draw how often each side lay up, beside what chance gives fair dice."""
    figure, axes = pyplot().subplots(figsize=(7, 3.6), layout="constrained")
    for k, (row, color) in enumerate(zip(rows, ("#0072b2", "#c8352b"), strict=True)):
        counts = np.array([float(row[f"side_{side}"]) for side in SIDES])
        total = counts.sum()
        p, square = float(row["p"]), float(row["chi_square"])
        chance = f"p = {p:.2g}" if p > 1e-300 else "p < 1e-300"
        label = f"{total:.0f} {row['dice']} dice: χ² = {square:.3g}, {chance}"
        axes.bar(SIDES + 0.36 * (k - 0.5), counts / total, 0.34, color=color, label=label)
    total = sum(float(rows[0][f"side_{side}"]) for side in SIDES)
    spread = 2 * np.sqrt(5 / 36 / total)
    axes.axhspan(
        1 / 6 - spread, 1 / 6 + spread, color="0.6", alpha=0.5, lw=0, label="1/6 ± two standard deviations"
    )
    axes.set(xlabel="dots on the side that lies up", ylabel="share of the dice", xticks=SIDES)
    axes.legend(frameon=False)
    save(figure, "throws.png")


def main() -> None:
    """Throw fair and loaded dice."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--worlds", type=int, help="throws of each kind of dice; by default 100000, on a CPU 150")
    own.add_argument("--at-once", type=int, help="throws in one ensemble; by default 10000, on a CPU 50")
    options = arguments("Throws five dice many times, and asks whether they are fair.", own)
    path, on_cpu = options.folder / "throws.csv", options.device == "cpu"
    if not options.plot_only:
        worlds = options.worlds or (4 if options.quick else 150 if on_cpu else 100_000)
        at_once = options.at_once or (50 if on_cpu else 10_000)
        rows = [thrown(worlds, at_once, loaded, options.device) for loaded in (False, True)]
        write_csv(path, rows, machine(options.device))
        columns = ["dice", "throws", *(f"side_{side}" for side in SIDES), "chi_square", "p", "diverged", "seconds"]
        table("How often each side lay up", columns, [[row[name] for name in columns] for row in rows])
    if not options.quick:
        plot(read_csv(path)[1])


if __name__ == "__main__":
    main()
