"""What a world of an ensemble costs, beside the same bodies joined into one system.

    python -m benchmarks.speed.ensemble [--device D] [--quick] [--threads N] [--force-algorithm R] [--alone]

Worlds differ in stiffness and in how they start. The joined system is as large, and its bodies are all alike: it
is what could be had without ensembles. Both take the same substeps, in turn, in several rounds; times are medians.
A frame is replayed as it was recorded, with its check for divergence.
"""

import argparse
import gc
import math
import sys
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import warp as wp

from msdwarp import Ensemble, Plane, Simulation, System, box, sheet

from ..common import arguments, machine, read_csv, replay, table, write_csv

FPS, SUBSTEPS = 1e4, 48
ROUND_SECONDS, ROUNDS, QUICK_ROUNDS = 0.2, 9, 3
MOST_JOINED = 10_000
"""More bodies would take longer to be joined than to be measured."""
DICE = (1, 10, 100, 1_000, 10_000, 100_000)
DIE_AIM, JELLY_AIM = 1.5, 250.0
"""On an H200: at most so many ns a die and substep, of 10 000; at least so many 10⁹ updates/s, of 132 jellies."""
AROUND = {"colliders": [Plane(offset=-5000.0)], "fps": FPS, "substeps": SUBSTEPS, "energy_limit": math.inf}


def bodies() -> dict[str, Callable[[], System]]:
    """Return the bodies by name; all are stable with the substeps taken."""
    return {
        "die 3³": lambda: box((3, 3, 3), damping=20.0),
        "jelly 10³": lambda: box((10, 10, 10), damping=20.0),
        "cloth 31², pinned": lambda: sheet((31, 31), damping=20.0).pin([0, 30]),
    }


def cases(quick: bool, on_gpu: bool) -> list[tuple[str, int]]:
    """Return names of bodies, and numbers of worlds."""
    if quick:
        return [*(("die 3³", count) for count in DICE[:3]), ("jelly 10³", 4), ("cloth 31², pinned", 4)]
    if not on_gpu:
        return [*(("die 3³", count) for count in DICE[:5]), ("jelly 10³", 16), ("cloth 31², pinned", 16)]
    return [*(("die 3³", count) for count in DICE), ("jelly 10³", 132), ("cloth 31², pinned", 1_000)]


def joined(body: System, count: int) -> System:
    """Return so many of a body as one system, each in its own place, joined two by two."""
    apart = 2.0 * float(np.ptp(body.position[:, 0])) + 1.0
    many = [body.translate((k * apart, 0.0, 0.0)) for k in range(count)]
    while len(many) > 1:
        pairs = [a + b for a, b in zip(many[::2], many[1::2], strict=False)]
        many = pairs + (many[-1:] if len(many) % 2 else [])
    return many[0]


class Contestant:
    """What is timed in turn with another."""

    def __init__(self, device: str, replay: Callable[[], object]) -> None:
        self._device, self._replay = device, replay
        replay()  # compiles, and records the frame
        self._times, self.seconds = 1, []
        self._times = max(1, min(200, round(ROUND_SECONDS / self._timed())))

    def _timed(self) -> float:
        """Return the time of a frame [s], over several."""
        wp.synchronize_device(self._device)
        start = time.perf_counter()
        for _ in range(self._times):
            self._replay()
        wp.synchronize_device(self._device)
        return (time.perf_counter() - start) / self._times

    def measure(self) -> None:
        """Time one round more."""
        self.seconds.append(self._timed())


def measure_case(name: str, worlds: int, options: argparse.Namespace) -> dict:
    """Return the row of a case."""
    body, random = bodies()[name](), np.random.default_rng(1)
    stiffness = body.stiffness[0] * random.uniform(0.5, 1.0, worlds)
    velocity = random.uniform(-0.5, 0.5, (worlds, 3))
    how = {**AROUND, "allow_unstable": True, "device": options.device}
    own = {"stiffness": stiffness, "velocity": velocity, "threads": options.threads}
    # Not by scatter, which on a GPU does not repeat to the last bit.
    ensemble = Ensemble(
        body,
        worlds,
        **how,
        **own,
        **({"force_algorithm": options.force_algorithm} if options.force_algorithm else {}),
    )
    contestants = [Contestant(options.device, ensemble.step)]
    if worlds <= MOST_JOINED and not options.alone:
        one = Simulation(joined(body, worlds), **how)
        one.step(2)
        contestants.append(Contestant(options.device, lambda: replay(one)))
    for k in range(QUICK_ROUNDS if options.quick else ROUNDS):
        for contestant in contestants if k % 2 else contestants[::-1]:  # what comes first is not always the same
            contestant.measure()
    each = [median(contestant.seconds) / (SUBSTEPS * worlds) for contestant in contestants]
    if not (ensemble.status == "running").all():
        raise SystemExit(f"{name}: worlds have diverged, and cost nothing")
    row = {"body": name, "worlds": worlds, "particles": body.particle_count, "connections": body.connection_count}
    row |= {"force_algorithm": ensemble.model.force_algorithm, "threads": ensemble.threads or 0}
    row |= {"ns_per_world_substep": 1e9 * each[0], "giga_updates": 1e-9 * body.connection_count / each[0]}
    row |= {"joined_ns": 1e9 * each[1] if len(each) > 1 else math.nan}
    row |= {"joined_over_ensemble": each[1] / each[0] if len(each) > 1 else math.nan}
    return row | {"aim": aim(name, worlds)}


def aim(name: str, worlds: int) -> str:
    """Say what is aimed at on an H200."""
    if (name, worlds) == ("die 3³", 10_000):
        return f"at most {DIE_AIM} ns"
    return f"at least {JELLY_AIM:g} G/s" if (name, worlds) == ("jelly 10³", 132) else ""


def main() -> None:
    """Measure, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--threads", default="auto", help="of a world: a power of 2; none: a launch for each stage")
    own.add_argument("--force-algorithm", help="of the ensemble; by default what it takes by itself")
    own.add_argument("--alone", action="store_true", help="leave out what is joined")
    options = arguments(__doc__.splitlines()[0], own)
    if options.threads != "auto":
        options.threads = None if options.threads == "none" else int(options.threads)
    path = options.folder / "ensemble.csv"
    if not options.plot_only:
        rows = []
        for name, worlds in cases(options.quick, options.device != "cpu"):
            rows.append(measure_case(name, worlds, options))
            gc.collect()
            write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    head = [
        "body",
        "worlds",
        "force_algorithm",
        "threads",
        "ns/world/substep",
        "10⁹ updates/s",
        "joined",
        "ratio",
        "aim",
    ]
    columns = ["body", "worlds", "force_algorithm", "threads", "ns_per_world_substep", "giga_updates", "joined_ns"]
    columns += ["joined_over_ensemble", "aim"]
    title = "Worlds of an ensemble, and the same bodies joined"
    table(title, head, [[row[one] for one in columns] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
