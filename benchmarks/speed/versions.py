"""Is this version as fast as another one? Both are timed in turn, each in a process of its own.

    git worktree add ../before SOME_COMMIT
    python -m benchmarks.speed.versions ../before [--device D] [--quick]

The other version is a folder with `msdwarp` in it. Times are µs a substep, of scenes µs a frame, as versions
may take different substeps there. They are medians over rounds in which the one that comes first alternates.
`ratio` is this version's time over the other's: its median over rounds, and the quartiles. On a CPU nothing else
may run.
"""

import argparse
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median, quantiles

HERE = Path(__file__).parents[2]
FPS, SUBSTEPS = 1e4, 48
AROUND = {"fps": FPS, "substeps": SUBSTEPS, "energy_limit": math.inf, "allow_unstable": True}
SCENES = ("dice", "worm", "waffle", "cloth", "tower", "curtain", "bowl")
FRAMES = 60
"""Frames of a scene that are timed one by one, again and again from its start: those that follow the first two."""


def cases(on_gpu: bool, quick: bool) -> list[str]:
    """Return what is timed: lattices, scenes, ensembles."""
    sizes = (3, 6, 10, 16, 24, 31, 64, 100) if on_gpu else (3, 10, 16, 31)
    many = {"die": 10_000, "jelly": 132, "cloth": 1_000} if on_gpu else {"die": 100, "jelly": 4, "cloth": 4}
    names = [f"cube {n}" for n in sizes] + [f"scene {name}" for name in SCENES]
    names += [f"worlds {name} {count}" for name, count in many.items()]
    return [*names[:2], names[-3]] if quick else names


def serve(device: str) -> None:
    """Time what the parent asks for: a process that imports one of the versions."""
    import importlib

    import numpy as np
    import warp as wp

    import msdwarp
    from msdwarp import Ensemble, Plane, Simulation, box, sheet

    wp.config.log_level = wp.LOG_ERROR
    from_scene = getattr(Simulation, "from_scene", None) or Simulation.of
    floor = {"colliders": [Plane(offset=-5000.0)], "device": device, **AROUND}
    bodies = {
        "die": lambda: box((3, 3, 3), damping=20.0),
        "jelly": lambda: box((10, 10, 10), damping=20.0),
        "cloth": lambda: sheet((31, 31), damping=20.0).pin([0, 30]),
    }

    def prepare(name: str):
        kind, what, *count = name.split()
        random = np.random.default_rng(1)
        if kind == "scene":
            simulation = from_scene(importlib.import_module(f"msdwarp.scenes.{what}").build(), device=device)

            def play() -> float:
                simulation.reset()
                simulation.step(2)  # the first frame is recorded
                # The median: frames that are recorded again, or repeated, take long.
                return float(np.median([timed(simulation, 1) for _ in range(FRAMES)]))

            return play
        if kind == "cube":
            body = box((int(what),) * 3, damping=20.0)
            speed = random.uniform(-0.5, 0.5, body.position.shape)
            simulation = Simulation(body.replace(velocity=speed), **floor)
        else:
            body, worlds = bodies[what](), int(count[0])
            stiffness = body.stiffness[0] * random.uniform(0.5, 1.0, worlds)
            simulation = Ensemble(
                body, worlds, stiffness=stiffness, velocity=random.uniform(-0.5, 0.5, (worlds, 3)), **floor
            )

        return lambda: timed(simulation, 10) / (10 * SUBSTEPS)

    def timed(simulation, frames: int) -> float:
        wp.synchronize_device(device)
        start = time.perf_counter()
        simulation.step(frames)
        wp.synchronize_device(device)
        return time.perf_counter() - start

    print(Path(msdwarp.__file__).parents[1], flush=True)
    run, repeats = None, 1
    for line in sys.stdin:
        if line.startswith("prepare "):
            run = prepare(line[8:].strip())
            run()
            start = time.perf_counter()
            run()
            repeats = max(1, min(500, round(0.1 / (time.perf_counter() - start))))
            print("ready", flush=True)
            continue
        assert run is not None
        print(1e6 * sum(run() for _ in range(repeats)) / repeats, flush=True)


class Version:
    """A process that has imported one version."""

    def __init__(self, folder: Path, device: str) -> None:
        path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve", device],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": path},
        )
        imported = self.read()
        assert Path(imported).resolve() == folder.resolve(), f"{folder} has no msdwarp: {imported} was imported"

    def say(self, line: str) -> None:
        """Have it do something."""
        assert self._process.stdin is not None
        print(line, file=self._process.stdin, flush=True)

    def read(self) -> str:
        """Wait for what it says next."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if not line:
            raise SystemExit("a version ended; see above")
        return line

    def timed(self) -> float:
        """Return the time of a substep [µs]."""
        self.say("time")
        return float(self.read())


def main() -> None:
    """Measure, write and print."""
    from benchmarks.common import arguments, machine, table, write_csv

    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("before", type=Path, help="the folder of the other version")
    own.add_argument("--rounds", type=int, default=15)
    own.add_argument("--only", default="", help="only cases whose names contain this")
    options = arguments(__doc__.splitlines()[0], own)
    versions = [Version(options.before.resolve(), options.device), Version(HERE, options.device)]
    rows = []
    for name in (one for one in cases(options.device != "cpu", options.quick) if options.only in one):
        for one in versions:
            one.say(f"prepare {name}")
        for one in versions:
            one.read()
        times = []
        for k in range(3 if options.quick else options.rounds):
            pair = [0.0, 0.0]
            for which in (0, 1) if k % 2 else (1, 0):
                pair[which] = versions[which].timed()
            times.append(pair)
        ratios = [after / before for before, after in times]
        low, _, high = quantiles(ratios, n=4)
        row = {"case": name} | {
            which: median(column)
            for which, column in zip(("before_us", "after_us"), zip(*times, strict=True), strict=True)
        }
        rows.append(row | {"ratio": median(ratios), "ratio_low": low, "ratio_high": high})
        print(rows[-1], flush=True)
    write_csv(options.folder / "versions.csv", rows, machine(options.device))
    table(
        "µs a substep (of scenes: a frame), before and after", list(rows[0]), [list(row.values()) for row in rows]
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        serve(sys.argv[2])
    else:
        main()
