"""How fast is msdwarp beside other codes? The same body, law, step and number of steps in each.

    python -m benchmarks.peers.compare [--device D] [--quick] [--peers msdwarp,newton,...]

Law: F_i = Σ_j (−k (|Δx| − l0) − b Δv·Δx̂) Δx̂, gravity 9.82 m/s², 1 kg a particle, semi-implicit Euler
(v += h a(x, v), then x += h v), float32. Velocities are random (±0.5 m/s) at the start, so that every connection
works. The floor lies 1 km below and is never touched: msdwarp and the CUDA kernels test every particle against
it in every step; newton, Taichi, Numba and NumPy have no contact here. See `codes` and `cuda` for what
each peer does, reads and lacks. Mind when reading: msdwarp and newton are simulators, in which every connection
may have its own numbers; the others are programs for this one task, and the lattice kernels know of the lattice.

Each peer's positions after 20 steps are first compared with a float64 reference in NumPy (for the largest bodies:
with msdwarp's, which the smaller ones have checked); who fails is not timed. Then all are timed in turn, round
after round, each as a graph of steps where it has one: a wall-clock time between two synchronisations, the median
over rounds. Codes on the host take fewer steps a round. A peer that is missing or fails has a row that says why.
"""

import argparse
import math
import sys
import time
import traceback
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from msdwarp import SymplecticEuler, System, box, stability_limit

from ..cases import Case, acceleration, cloth_case, incidence
from ..common import arguments, machine, read_csv, table, write_csv
from .codes import Msdwarp, Newton, Numba, Numpy, OnTheHost, Taichi, steps_in
from .cuda import Lanes, Marching, OneBlock, Scatter, Unsuitable

PEERS = {
    "msdwarp": Msdwarp,
    "msdwarp scatter": partial(Msdwarp, force_algorithm="scatter"),
    "msdwarp gather": partial(Msdwarp, force_algorithm="gather"),
    "msdwarp stencil": partial(Msdwarp, force_algorithm="stencil"),
    "newton": Newton,
    "newton by particle": partial(Newton, by_particle=True),
    "Taichi": Taichi,
    "CUDA lattice": Marching,
    "CUDA lanes": Lanes,
    "CUDA one block": OneBlock,
    "CUDA scatter": Scatter,
    "Numba": Numba,
    "NumPy": Numpy,
}
SIZES_GPU = (3, 10, 32, 64, 100, 160)
SIZES_CPU = (10, 20, 40)
CHECKED_STEPS = 20
CHECKED_MOST = 900_000
"""Connections of the largest body that the float64 reference is computed for, a second or two."""
ROUNDS = 9
MEASURED = ("us_per_step", "spread", "connections_per_second", "times_msdwarp", "error")


@dataclass(frozen=True)
class Body:
    """What is simulated, and how."""

    name: str
    system: System
    shape: tuple[int, int, int] | None
    """Particles along x, y and z, where it is a lattice with all its diagonals."""
    step: float
    """Length of a step [s]."""
    gravity: float = 9.82
    floor: float = -1000.0
    """Height of the floor [m]."""


def bodies(sizes: tuple[int, ...]) -> list:
    """Return a function for each body, for one of them is in memory at a time."""
    return [*(partial(cube, n) for n in sizes), die, cloth, worm, mattress]


def cube(n: int) -> Body:
    """Return n³ particles, 12 steps a frame: h²λ + 2hμ is about 1 of the 4 that are stable."""
    return Body(f"cube {n}³", moving(box((n, n, n), stiffness=1000.0, damping=20.0)), (n, n, n), 1 / 720)


def die() -> Body:
    """Return the report's die."""
    return scene("die", box((3, 3, 3), stiffness=1e5, damping=20.0), (3, 3, 3))


def cloth() -> Body:
    """Return the report's cloth, pinned at three points."""
    return scene("cloth", cloth_case().system, (31, 31, 1))


def worm() -> Body:
    """Return the report's worm."""
    return scene("worm", box((2, 2, 400), stiffness=1e5, damping=20.0), (2, 2, 400))


def mattress() -> Body:
    """Return the report's mattress."""
    return scene("mattress", box((20, 7, 2), stiffness=5000.0, damping=20.0), (20, 7, 2))


def scene(name: str, system: System, shape: tuple[int, int, int]) -> Body:
    """Return a scene with 12 steps a frame of 1/60 s, or as many as are stable with a margin."""
    limit = stability_limit(system, SymplecticEuler())
    return Body(name, moving(system), shape, min(1 / 720, 0.8 * limit))


def moving(system: System) -> System:
    """Return a system with random velocities."""
    return system.with_velocity(np.random.default_rng(0).uniform(-0.5, 0.5, system.position.shape))


def reference(body: Body, steps: int) -> NDArray:
    """Return the positions after so many steps, computed in float64 by NumPy."""
    system = body.system
    case = Case(body.name, body.name, system, steps * body.step, body.gravity)
    difference = incidence(system)
    rest_dx = difference @ system.position
    u, v = np.zeros_like(system.position), system.velocity.copy()
    for _ in range(steps):
        v += body.step * acceleration(difference, case, u, v, rest_dx)
        u += body.step * v
    return system.position + u


def tolerance(body: Body, steps: int) -> float:
    """Return by how much rounding to float32 may displace a particle [m], with u = 2⁻²⁴.

    A sum x + hv is rounded by u|x|. A connection's stretch is wrong by u (2|x| + 8 l0): its Δx is a difference of
    rounded positions, and some eight roundings follow (approximate roots and divisions count as two each). Forces
    as if stretches were wrong by e move a particle by less than h²λ e < 4e in a step, since the step is stable.
    Roundings go either way, so that those of n steps add up like √n of them.
    """
    u, size = 2.0**-24, float(np.abs(body.system.position).max())
    return math.sqrt(steps) * u * (size + 4 * (2 * size + 8))


def steps_per_round(body: Body, device: str) -> int:
    """Return about as many steps as a tenth of a second is worth, a multiple of 20."""
    updates = 2e7 if device == "cpu" else 1e9
    return 20 * max(1, min(24, round(updates / body.system.connection_count / 20)))


def attempt(row: dict, action, *arguments):
    """Return what an action returns; where it raises, write why into the row and return None."""
    try:
        return action(*arguments)
    except Unsuitable as reason:
        row["note"] = f"skipped: {reason}"
    except ImportError as error:
        row["note"] = f"not installed: {error.name or error}"
    except Exception as error:
        traceback.print_exc(limit=-3)
        lines = str(error).strip().splitlines() or [""]
        row["note"] = f"failed: {type(error).__name__}: {lines[0][:150]}"
    return None


def check(peer, wanted: NDArray | None, bound: float) -> tuple[NDArray, float]:
    """Take the first steps; return the positions and the largest distance from those wanted [m]."""
    peer.advance(CHECKED_STEPS)
    peer.synchronise()
    position = peer.position()
    error = float("nan") if wanted is None else float(np.abs(position - wanted).max())
    if wanted is not None and not error <= bound:
        raise ArithmeticError(f"off by {error:.2g} m, rounding explains {bound:.2g}")
    return position, error


def timed(peer, steps: int) -> float:
    """Return the time of a step [s] in one round."""
    peer.synchronise()
    start = time.perf_counter()
    peer.advance(steps)
    peer.synchronise()
    return (time.perf_counter() - start) / steps


def warm_up(peer, steps: int) -> int:
    """Take a round's steps once, which may compile and record; return how many steps a round shall have."""
    if isinstance(peer, OnTheHost):
        steps = steps_in(peer, 0.1, steps)
    peer.advance(steps)
    return steps


def compare(body: Body, codes: list[str], device: str, rounds: int) -> list[dict]:
    """Return a row for every code: checked, then timed in turn with the others."""
    count = body.system.connection_count
    small = count <= CHECKED_MOST
    wanted = reference(body, CHECKED_STEPS) if small else None
    bound = tolerance(body, CHECKED_STEPS) * (1 if small else 2)
    rows, running = {}, {}
    for code in codes:
        row = rows[code] = {"body": body.name, "particles": body.system.particle_count, "connections": count}
        row |= {"step": body.step, "code": code, "steps_per_round": 0}
        row |= dict.fromkeys(MEASURED, float("nan"))
        row |= {"tolerance": bound, "compared_with": "NumPy float64" if small else "msdwarp", "note": ""}
        peer = attempt(row, PEERS[code], body, device)
        checked = peer and attempt(row, check, peer, wanted, bound)
        if not checked:
            continue
        row["error"], row["note"] = checked[1], peer.note
        if wanted is None:
            wanted, row["compared_with"] = checked[0], "itself"
        steps = attempt(row, warm_up, peer, steps_per_round(body, device))
        if steps:
            running[code], row["steps_per_round"] = peer, steps
    times = {code: [] for code in running}
    for _ in range(rounds):
        for code, peer in list(running.items()):
            seconds = attempt(rows[code], timed, peer, rows[code]["steps_per_round"])
            if seconds is None:
                del running[code]
            else:
                times[code].append(seconds)
    for code in running:
        middle = median(times[code])
        rows[code]["us_per_step"] = middle * 1e6
        rows[code]["spread"] = (max(times[code]) - min(times[code])) / middle
        rows[code]["connections_per_second"] = count / middle
        if "msdwarp" in running:
            rows[code]["times_msdwarp"] = middle / median(times["msdwarp"])
    return list(rows.values())


def measure(options, path: Path, codes: list[str]) -> list[dict]:
    """Measure every body; what is known is written after each, in case a library ends the process."""
    sizes = SIZES_CPU if options.device == "cpu" else SIZES_GPU
    rows = []
    for build in bodies(sizes)[:: 4 if options.quick else 1]:
        start = time.perf_counter()
        body = build()
        rows += compare(body, codes, options.device, 3 if options.quick else ROUNDS)
        write_csv(path, rows, machine(options.device))
        print(f"{body.name}: {time.perf_counter() - start:.0f} s", flush=True)
    return rows


def show(rows: list[dict]) -> None:
    """Print a table for every body."""
    for name in dict.fromkeys(row["body"] for row in rows):
        mine = [row for row in rows if row["body"] == name]
        title = f"{name}: {mine[0]['particles']:.0f} particles, {mine[0]['connections']:.0f} connections"
        body = []
        for row in mine:
            line = [row[key] for key in ("code", *MEASURED, "note")]
            line[3] /= 1e9
            body.append(["–" if cell != cell else cell for cell in line])
        head = ["code", "µs a step", "spread", "G connections/s", "time / msdwarp's", "error [m]", "note"]
        table(title, head, body)


def main() -> None:
    """Measure, write and print."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--peers", default=",".join(PEERS), help="some of them, separated by commas")
    options = arguments(__doc__.splitlines()[0], parser)
    codes = [code.strip() for code in options.peers.split(",")]
    unknown = sorted(set(codes) - set(PEERS))
    if unknown:
        raise SystemExit(f"no peer is called {', '.join(unknown)}; there is: {', '.join(PEERS)}")
    path = options.folder / "peers.csv"
    if not options.plot_only:
        measure(options, path, codes)
    line, rows = read_csv(path)
    print(line)
    show(rows)


if __name__ == "__main__":
    sys.exit(main())
