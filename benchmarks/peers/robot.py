"""A robot learns to walk: by msdwarp's gradient, by DiffTaichi's as published, and by CMA-ES without a gradient.

    python -m benchmarks.peers.robot --difftaichi PATH [--codes 'A;B'] [--quick]

PATH is the folder examples of https://github.com/taichi-dev/difftaichi. All have the same masses and springs,
2.7 s, and 100 iterations of normalised gradient descent for each seed. What msdwarp learns are the 55 weights of
the scene `robot`: muscles as functions of time, on a soft ground, in steps of 2 ms. DiffTaichi's is a network of
1547 weights that feels positions and velocities, on a ground that sticks, in steps of 4 ms, with its `toi` off
and on. So distances are those of different controllers. CMA-ES seeks the same 55 weights as msdwarp, from the
same start, in the wall time of msdwarp's 100 gradients. `finer_m` is the distance with the same weights at a
quarter of the step. `kept` is what iterations gained, over what their gradients promised for a step of 0.2;
`growth` how much the derivative by the state grew backwards at most. The scene has the weights of msdwarp's seed
0, which are printed. Writes results/<device>/peers_robot.csv.
"""

import argparse
import importlib
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msdwarp import Frames, Simulation
from msdwarp.scenes.robot import robot, waves

from ..common import arguments, machine, read_csv, table, write_csv
from . import difftaichi

SUBSTEPS, STEP_TIME, SWING = 1364, 0.002, 0.1
"""Substeps of 2 ms in the 2.728 s of DiffTaichi; largest strain of a muscle."""
FRAMES, FRAMES_AHEAD = 22, 11
"""Into how many frames they are cut, with a gradient and without one: what takes least time."""
SEEDS, ITERATIONS, STEP, SIGMA = 5, 100, 0.2, 0.5
"""Length of a step against the gradient, as DiffTaichi's; the standard deviation with which CMA-ES begins."""
CODES = ("msdwarp", "CMA-ES", "DiffTaichi", "DiffTaichi, toi")
MEASURED = ("distance_m", "best_m", "finer_m", "seconds", "evaluations", "growth", "kept")


def start(seed: int) -> NDArray[np.float64]:
    """Return small random weights."""
    return np.random.default_rng(seed).normal(0.0, 0.1, (5, 11))


def simulated(weights: NDArray, frames: int, finer: int = 1) -> Simulation:
    """Return the robot's simulation, its step divided by `finer`."""
    rate, substeps = frames / (SUBSTEPS * STEP_TIME), finer * SUBSTEPS // frames
    return Simulation.from_scene(robot(weights, SWING), fps=rate, substeps=substeps, device="cpu")


def distance(weights: NDArray, finer: int = 1) -> float:
    """Return how far particle 0 goes [m]."""
    simulation = simulated(weights, FRAMES_AHEAD, finer)
    before = simulation.frame().position[0, 0]
    simulation.step(FRAMES_AHEAD)
    return float(simulation.frame().position[0, 0] - before)


def gradient(weights: NDArray) -> tuple[float, NDArray[np.float64], float]:
    """Return how far particle 0 goes [m], the derivatives by the weights, and how much they grew backwards."""

    def gone(frames: Frames) -> tuple[float, NDArray, None]:
        by_position = np.zeros(frames.position.shape)
        by_position[-1, 0, 0] = 1.0
        return frames.position[-1, 0, 0] - frames.position[0, 0, 0], by_position, None

    simulation = simulated(weights, FRAMES)
    found = simulation.gradient(gone, FRAMES, by=["strain"])
    wave = waves(simulation.dt * np.arange(len(found["strain"])))
    by_strain = found["strain"] * SWING * (1 - np.tanh(wave @ weights) ** 2)
    return found.value, wave.T @ by_strain, float(found.growth.max())


def by_gradient(seed: int, iterations: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Learn by msdwarp's gradient; return a row and the weights."""
    weights, found, promised, growth = start(seed), [], [], []
    begun = time.perf_counter()
    for _ in range(iterations):
        gone, slope, grown = gradient(weights)
        size = float(np.linalg.norm(slope))
        weights = weights + STEP * slope / size
        found, promised, growth = [*found, gone], [*promised, STEP * size], [*growth, grown]
    seconds = time.perf_counter() - begun
    found.append(distance(weights))
    kept = (found[-1] - found[0]) / sum(promised)
    row = {"seconds": seconds, "evaluations": iterations, "distance_m": found[-1], "best_m": max(found)}
    return row | {"finer_m": distance(weights, 4), "growth": max(growth), "kept": kept}, weights


def by_cma(seed: int, seconds: float) -> dict[str, Any]:
    """Search by CMA-ES for as long as the gradient took, and return a row."""
    cma = importlib.import_module("cma")
    search = cma.CMAEvolutionStrategy(start(seed).ravel(), SIGMA, {"seed": seed + 1, "verbose": -9})
    begun, count = time.perf_counter(), 0
    best, best_weights = -np.inf, start(seed)
    while time.perf_counter() - begun < seconds:
        tried = search.ask()
        values = []
        for one in tried:
            values.append(distance(one.reshape(5, 11)))
            if values[-1] > best:
                best, best_weights = values[-1], one.reshape(5, 11)
        search.tell(tried, [-value for value in values])
        count += len(tried)
    row = {"seconds": time.perf_counter() - begun, "evaluations": count, "distance_m": best, "best_m": best}
    return row | {"finer_m": distance(best_weights, 4)}


def by_difftaichi(module: Any, seed: int, toi: bool, iterations: int) -> tuple[dict[str, Any], difftaichi.Weights]:
    """Learn by the published code; return a row without `finer_m`, and the weights."""
    learned = difftaichi.learn(module, seed, toi, iterations)
    found = learned["distances"]
    row = {"seconds": learned["seconds"], "evaluations": iterations, "distance_m": found[-1], "best_m": max(found)}
    kept = (found[-1] - found[0]) / learned["promised"]
    return row | {"kept": kept}, learned["weights"]


def measure(
    codes: list[str], folder: Path | None, seeds: int, iterations: int, taken: dict[int, float], keep: Any
) -> None:
    """Learn with each code and seed, one code after the other for each seed; hand rows to `keep`.

    `taken` has the times of msdwarp's gradients by seed [s], as far as they have been measured before.
    """
    published = None
    if folder is not None and any(code.startswith("DiffTaichi") for code in codes):
        published = difftaichi.load(folder)
    learned = []
    for seed in range(seeds):
        if "msdwarp" in codes:
            row, weights = by_gradient(seed, iterations)
            taken[seed] = row["seconds"]
            keep("msdwarp", seed, row)
            if seed == 0:
                print("weights of seed 0:", np.round(weights, 2).tolist(), sep="\n")
        if "CMA-ES" in codes:
            try:
                keep("CMA-ES", seed, by_cma(seed, taken[seed]))
            except ImportError as error:
                keep("CMA-ES", seed, {"note": str(error)})
        for code in (one for one in codes if one.startswith("DiffTaichi")):
            if published is None:
                keep(code, seed, {"note": "needs --difftaichi"})
                continue
            row, weights = by_difftaichi(published, seed, code.endswith("toi"), iterations)
            learned.append((code, seed, row, weights))
            keep(code, seed, row)
    # Taichi has one program at a time: that with a finer step ends the other.
    finer = difftaichi.load(folder, 4) if learned and folder is not None else None
    for code, seed, row, weights in learned:
        finer.use_toi = code.endswith("toi")  # pyright: ignore[reportOptionalMemberAccess]
        difftaichi.write(finer, weights)  # pyright: ignore[reportArgumentType]
        keep(code, seed, row | {"finer_m": difftaichi.distance(finer)})  # pyright: ignore[reportArgumentType]


def main() -> None:
    """Learn, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--difftaichi", type=Path, help="the folder examples of DiffTaichi")
    own.add_argument("--codes", default=";".join(CODES), help="which to run, by ';'; rows of others are left")
    options = arguments(__doc__.splitlines()[0], own)
    path = options.folder / "peers_robot.csv"
    if not options.plot_only:
        line = machine(options.device)
        codes = [code for code in CODES if code in options.codes.split(";")]

        def kept() -> dict[tuple[str, int], dict[str, Any]]:
            """Return the rows that are there, by code and seed."""
            there = read_csv(path)[1] if path.exists() else []
            return {(row["code"], int(row["seed"])): row for row in there}

        def keep(code: str, seed: int, row: dict[str, Any]) -> None:
            """Write a row in its place among the others."""
            rows = kept()
            rows[code, seed] = {"code": code, "seed": seed} | dict.fromkeys(MEASURED, np.nan) | {"note": ""} | row
            order = sorted(rows, key=lambda key: (CODES.index(key[0]), key[1]))
            write_csv(path, [rows[key] for key in order], line)

        small, before = options.quick, kept()
        seeds, iterations = (1, 5) if small else (SEEDS, ITERATIONS)
        taken = {seed: row["seconds"] for (code, seed), row in before.items() if code == "msdwarp"}
        if "CMA-ES" in codes and "msdwarp" not in codes and len(taken) < seeds:
            raise SystemExit("CMA-ES takes the time that msdwarp's gradients took; run msdwarp first, or with it")
        measure(codes, options.difftaichi, seeds, iterations, taken, keep)
    _, found = read_csv(path)
    table("Distance gone in 2.7 s", list(found[0]), [list(row.values()) for row in found])


if __name__ == "__main__":
    sys.exit(main())
