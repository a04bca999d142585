"""How long does a frame take on cores that other programs use, too: in this version and in another one.

    git worktree add ../before SOME_COMMIT
    python -m benchmarks.speed.shared_cores ../before [--quick] [--only block] [--neighbors 0,2,4]

The other version is a folder with `msdwarp` in it. Both simulate the same frames in turn, each in a process of its
own, while so many other processes compute without a pause. Times are medians over rounds, in which the one that
comes first alternates. `times_alone` is this version's time over its time beside no other process. Apart from the
neighbors that the script starts, nothing may run.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[2]
BUSY = "while True: pass"
SECONDS = 0.15
"""About how long a round takes where nothing else runs."""
SETTLING = 3
"""Rounds before the first that counts, in which this version finds out how many threads are best."""


def serve() -> None:
    """Simulate frames whenever the parent asks for it: a process that imports one of the versions."""
    import warp as wp

    import msdwarp
    from msdwarp import Contact, Plane, Simulation, ball, box

    wp.config.log_level = wp.LOG_ERROR
    block = box((20, 20, 20), stiffness=1000.0, damping=1.0)
    low = ball(0.5, 0.05, stiffness=500.0, damping=1.0).translate((0, 0, 0.51))
    options = {"device": "cpu", "colliders": [Plane()], "energy_limit": float("inf")}
    made = {
        "block 20³": lambda: Simulation(block.translate((0, 0, 11)), substeps=30, **options),
        "balls in contact": lambda: Simulation(
            low + low.translate((0, 0, 1.002)), contact=Contact(), substeps=30, fps=240, **options
        ),
    }
    print(Path(msdwarp.__file__).parents[1], flush=True)
    simulation, frames = None, 1
    for line in sys.stdin:
        word, _, rest = line.strip().partition(" ")
        if word == "prepare":
            simulation = made[rest]()
            simulation.step()
            print("ready", flush=True)
            continue
        assert simulation is not None
        frames = int(rest)
        start = time.perf_counter()
        for _ in range(frames):
            simulation.step()
        print(1e3 * (time.perf_counter() - start) / frames, simulation.threads, flush=True)


BODIES = ("block 20³", "balls in contact")


class Version:
    """A process that has imported one version."""

    def __init__(self, folder: Path) -> None:
        path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path},
        )
        imported = self._read()
        assert Path(imported).resolve() == folder.resolve(), f"{folder} has no msdwarp: {imported} was imported"

    def ask(self, line: str) -> str:
        """Have it do something, and return what it says then."""
        print(line, file=self._process.stdin, flush=True)
        return self._read()

    def _read(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if not line:
            raise SystemExit("a version ended; see above")
        return line

    def timed(self, frames: int) -> tuple[float, int]:
        """Return the time of a frame [ms], and the number of threads."""
        milliseconds, threads = self.ask(f"time {frames}").split()
        return float(milliseconds), int(threads)


def measure(versions: list[Version], body: str, neighbors: list[int], rounds: int):
    """Yield a row for each number of neighbors."""
    for one in versions:
        one.ask(f"prepare {body}")
    frames = max(1, round(1e3 * SECONDS / versions[1].timed(5)[0]))
    alone = 0.0
    for count in neighbors:
        others = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
        try:
            times, threads = ([], []), []
            for _ in range(SETTLING):
                versions[1].timed(frames)
            for k in range(rounds):
                for which in (0, 1) if k % 2 else (1, 0):
                    found = versions[which].timed(frames)
                    times[which].append(found[0])
                    threads += [found[1]] * which
        finally:
            for one in others:
                one.kill()
        before, after = map(median, times)
        alone = alone or after
        yield {
            "body": body,
            "neighbors": count,
            "before_ms": before,
            "after_ms": after,
            "ratio": median(b / a for a, b in zip(*times, strict=True)),
            "times_alone": after / alone,
            "threads": median(threads),
        }


def main() -> None:
    """Measure, write and print."""
    from benchmarks.common import arguments, machine, table, write_csv

    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("before", type=Path, help="the folder of the other version")
    own.add_argument("--rounds", type=int, default=7)
    own.add_argument("--only", default="", help="only bodies whose names contain this")
    own.add_argument("--neighbors", default="0,2,4", help="numbers of busy processes, with commas between")
    options = arguments(__doc__.splitlines()[0], own)
    versions, rows = [Version(options.before.resolve()), Version(HERE)], []
    neighbors = [int(one) for one in options.neighbors.split(",")]
    for body in (one for one in BODIES if options.only in one):
        for row in measure(versions, body, neighbors, 3 if options.quick else options.rounds):
            rows.append(row)
            print(row, flush=True)
    write_csv(options.folder / "shared_cores.csv", rows, machine("cpu"))
    table("ms a frame, before and after", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    serve() if sys.argv[1:2] == ["--serve"] else main()
