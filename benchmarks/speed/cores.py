"""Several threads of a CPU: how much faster are they than one, and than Numba's.

The same bodies by each algorithm and number of threads, and by loops over particles that Numba compiles
(`prange`), if it is installed. All are measured in turn, in many short rounds, so that what else the machine does
meets them alike: of the rounds the CSV has the fastest and the median.

    python -m benchmarks.speed.cores --threads 1,2,4,8
"""

import argparse
import importlib
import importlib.util
import math
import time
from collections.abc import Callable, Iterator

import numpy as np

from msdwarp import Simulation, System, box, sheet

from ..common import RESULTS, arguments, machine, read_csv, table, write_csv

STIFFNESS, DAMPING, STEP = 1000.0, 1.0, 1e-4
FORCE_ALGORITHMS = ("scatter", "gather", "stencil")
SECONDS = 0.02
"""About how long one thread takes for a round."""


def bodies(quick: bool) -> dict[str, System]:
    """Return the bodies, by name."""
    numbers = {"spacing": 0.1, "stiffness": STIFFNESS, "damping": DAMPING}
    found = {f"block {n}³": box((n, n, n), **numbers) for n in ((10,) if quick else (10, 20, 30, 64))}
    return found | ({} if quick else {"cloth 200²": sheet((200, 200), **numbers)})


class Msdwarp:
    """A body by one algorithm and so many threads."""

    def __init__(self, system: System, force_algorithm: str, threads: int, substeps: int) -> None:
        self.simulation = Simulation(
            system,
            device="cpu",
            force_algorithm=force_algorithm,
            threads=threads,
            fps=1 / (STEP * substeps),
            substeps=substeps,
            energy_limit=math.inf,
        )

    def advance(self) -> None:
        """Take the substeps of a round."""
        self.simulation.step()


class Numba:
    """The same law and method in loops over particles, from a table of each one's neighbours."""

    def __init__(self, system: System, threads: int, substeps: int) -> None:
        self.numba = importlib.import_module("numba")
        self.threads, self.substeps = threads, substeps
        ends = np.concatenate([system.connections, system.connections[:, ::-1]])
        order = np.argsort(ends[:, 0], kind="stable")
        self.first = np.searchsorted(ends[order, 0], np.arange(system.particle_count + 1)).astype(np.int32)
        self.other = ends[order, 1].astype(np.int32)
        self.rest = np.tile(system.rest_length, 2)[order].astype(np.float32)
        self.x, self.v = system.position.astype(np.float32), system.velocity.astype(np.float32)
        self.v_new = self.v.copy()
        self.numbers = [np.float32(one) for one in (STIFFNESS, DAMPING, STEP, 9.82)]
        self.steps = compiled(self.numba)

    def advance(self) -> None:
        """Take the substeps of a round."""
        self.numba.set_num_threads(self.threads)
        lists = self.first, self.other, self.rest, self.x, self.v, self.v_new
        self.steps(*lists, *self.numbers, self.substeps)


def compiled(numba) -> Callable:
    """Return the loops, compiled once."""
    if hasattr(compiled, "steps"):
        return compiled.steps
    prange = numba.prange

    @numba.njit(parallel=True, fastmath=True)
    def steps(first, other, rest, x, v, v_new, stiffness, damping, h, gravity, count):
        for _ in range(count):
            for i in prange(len(x)):
                fx = fy = fz = np.float32(0)
                for k in range(first[i], first[i + 1]):
                    j = other[k]
                    dx, dy, dz = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
                    dv = (v[i, 0] - v[j, 0]) * dx + (v[i, 1] - v[j, 1]) * dy + (v[i, 2] - v[j, 2]) * dz
                    length = math.sqrt(dx * dx + dy * dy + dz * dz)
                    s = -(stiffness * (length - rest[k]) + damping * dv / length) / length
                    fx += s * dx
                    fy += s * dy
                    fz += s * dz
                v_new[i, 0] = v[i, 0] + h * fx
                v_new[i, 1] = v[i, 1] + h * fy
                v_new[i, 2] = v[i, 2] + h * (fz - gravity)
            for i in prange(len(x)):
                for d in range(3):
                    v[i, d] = v_new[i, d]
                    x[i, d] += h * v_new[i, d]

    compiled.steps = steps
    return steps


def measure(system: System, threads: list[int], rounds: int) -> Iterator[dict]:
    """Yield the time of a substep by each code, algorithm and number of threads [µs]."""
    substeps = max(1, round(SECONDS / (1.2e-8 * system.connection_count)))
    codes: dict = {
        ("msdwarp", force_algorithm, n): Msdwarp(system, force_algorithm, n, substeps)
        for force_algorithm in FORCE_ALGORITHMS
        for n in threads
    }
    if importlib.util.find_spec("numba"):
        codes |= {("Numba", "gather", n): Numba(system, n, substeps) for n in threads}
    for code in codes.values():
        code.advance()
    taken = {name: [] for name in codes}
    for _ in range(rounds):
        for name, code in codes.items():
            start = time.perf_counter()
            code.advance()
            taken[name].append((time.perf_counter() - start) / substeps * 1e6)
    for name, times in taken.items():
        of = {"particles": system.particle_count, "connections": system.connection_count}
        found = {"us_fastest": min(times), "us_median": float(np.median(times))}
        yield dict(zip(("code", "force_algorithm", "threads"), name, strict=True)) | of | found


def show(rows: list[dict]) -> None:
    """Print how long a substep takes, and how many times as fast it is as by one thread."""
    single = {(r["body"], r["code"], r["force_algorithm"]): r for r in rows if r["threads"] == 1}
    lines = []
    for r in rows:
        one = single.get((r["body"], r["code"], r["force_algorithm"]), r)
        gain = [f"{one[name] / r[name]:.2f}" for name in ("us_fastest", "us_median")]
        times = [f"{r[name]:.0f}" for name in ("us_fastest", "us_median")]
        lines.append([r["body"], r["code"], r["force_algorithm"], f"{r['threads']:.0f}", *times, *gain])
    columns = [
        "body",
        "code",
        "force_algorithm",
        "threads",
        "fastest [µs]",
        "median [µs]",
        "times",
        "times, median",
    ]
    table("A substep by several threads", columns, lines)


def main() -> None:
    """Measure, or print what was measured."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--threads", default="1,2", help="numbers of threads, with commas between")
    own.add_argument("--rounds", type=int, default=40, help="of each body, by each code in turn")
    options = arguments("Several threads of a CPU beside one.", own)
    path = (options.folder if options.quick else RESULTS / "cpu") / "cores.csv"
    if not options.plot_only:
        rows = []
        for name, system in bodies(options.quick).items():
            found = measure(system, [int(n) for n in options.threads.split(",")], options.rounds)
            rows += [{"body": name} | row for row in found]
        write_csv(path, rows, machine("cpu"))
    show(read_csv(path)[1])


if __name__ == "__main__":
    main()
