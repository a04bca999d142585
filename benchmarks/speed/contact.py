"""Bodies that touch: what contact costs beside the same bodies apart, and without contact.

    python -m benchmarks.speed.contact [--device D] [--quick]

Two blocks of 100³ particles, one on the other; 27 blocks of 10³ in a pile; a cloth of 256² particles that has
fallen over a ball onto itself; five dice; and 1000 blocks of 10³ poured into a box. On a CPU the blocks have 30³
particles, the cloth has 64², and 27 blocks are poured. Each is simulated until it has
come together, at automatic substeps and 60 frames a second; then a few frames are timed in turn with the same
bodies side by side (what contact costs where nothing touches) and with bodies that do not feel each other, all at
as many substeps. Ratios are medians over rounds. `real time` is how many simulated seconds a second of work gives.
"""

import gc
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import NamedTuple

import numpy as np
import warp as wp

from msdwarp import Box, Contact, Plane, Simulation, Sphere, System, box, sheet
from msdwarp.scenes import dice

from ..common import arguments, machine, read_csv, table, write_csv

FPS, FRAMES, ROUNDS, QUICK_ROUNDS = 60.0, 4, 9, 3


class Case(NamedTuple):
    """Bodies together, the same apart, and what they are in."""

    together: System
    apart: System | None
    colliders: list
    self_contact: bool = False
    settle: int = 60


def stacked(many: int, count: int, spread: float) -> System:
    """Return blocks of many³ particles in layers, or on each other where there are two; or side by side."""
    spacing = 0.02
    width = spacing * (many - 1)
    random = np.random.default_rng(0)
    one = box((many, many, many), spacing, mass=1e-3, stiffness=400.0, damping=0.2)
    one = one.translate(tuple(-one.position.min(axis=0)))
    found = []
    side = 1 if count == 2 else round(count ** (1 / 3))
    for k in range(count):
        place = np.array([k % side, k // side % side, k // side**2], dtype=float)
        if spread:
            across = int(np.ceil(np.sqrt(count)))
            place = np.array([k % across, k // across, 0.0])
        at = place * (1.5 if spread else 1.05) * width
        at[2] += 0.02
        if side > 1 and not spread:
            at[:2] += 0.02 * width * random.uniform(-1, 1, 2)
        found.append(one.translate(tuple(at)))
    return joined(found)


def joined(systems: list[System]) -> System:
    """Return several systems as one, adding neighbours first: each array is copied a few times only."""
    while len(systems) > 1:
        systems = [sum(systems[k + 1 : k + 2], systems[k]) for k in range(0, len(systems), 2)]
    return systems[0]


def cases(quick: bool, device: str) -> dict[str, Callable[[], Case]]:
    """Return what makes each case, by name."""
    on_gpu = wp.get_device(device).is_cuda
    large, wide, poured = (10, 24, 8) if quick else (100, 256, 1000) if on_gpu else (30, 64, 27)
    floor = Plane(friction=0.5, restitution=0.0)

    def cloth() -> Case:
        spacing = 1.2 / (wide - 1)
        one = sheet((wide, wide), spacing, mass=0.4 / wide**2, stiffness=60.0, damping=0.01)
        one = one.rotate(0.05, axis=(1, 0, 0))
        one = one.translate(tuple(np.array([0.1, 0.05, 0.85]) - one.position.mean(axis=0)))
        ball = Sphere((0, 0, 0.45), 0.3, friction=0.4, restitution=0.0)
        return Case(one, None, [floor, ball], True, 20 if quick else 60)

    def pour() -> Case:
        width = 0.45 * round(poured ** (1 / 3)) + 0.3
        walls = [Box((s * (width / 2 + 0.5), 0, 2.0), (1.0, width + 2, 8.0), restitution=0.0) for s in (-1, 1)] + [
            Box((0, s * (width / 2 + 0.5), 2.0), (width + 2, 1.0, 8.0), restitution=0.0) for s in (-1, 1)
        ]
        random = np.random.default_rng(1)
        side = round(poured ** (1 / 3))
        one = box((10, 10, 10), 0.03, mass=1e-3, stiffness=400.0, damping=0.2)
        one = one.translate(tuple(-one.position.mean(axis=0)))
        found = []
        for k in range(poured):
            place = np.array([k % side, k // side % side, k // side**2]) - [(side - 1) / 2, (side - 1) / 2, -0.6]
            turned = one.rotate(random.uniform(0, 6.28), random.normal(size=3))
            found.append(turned.translate(tuple(0.47 * place)))
        return Case(joined(found), None, [floor, *walls], settle=10 if quick else 90)

    def five_dice() -> Case:
        scene = dice.build()
        return Case(scene.system, None, list(scene.colliders), settle=60)

    return {
        f"two {large}³ blocks, one on the other": lambda: Case(
            stacked(large, 2, 0.0), stacked(large, 2, 1.0), [floor]
        ),
        "27 blocks of 10³ in a pile": lambda: Case(stacked(10, 27, 0.0), stacked(10, 27, 1.0), [floor]),
        f"{wide}² cloth on itself": cloth,
        "five dice": five_dice,
        f"{poured} blocks of 10³ poured": pour,
    }


def measure_case(name: str, case: Case, device: str, rounds: int) -> dict:
    """Return the row of a case."""
    contact = Contact(friction=0.4, restitution=0.2, self_contact=case.self_contact)
    common = {"colliders": case.colliders, "fps": FPS, "device": device}
    first = Simulation(case.together, contact=contact, **common)
    fixed = {"substeps": first.substeps, "allow_unstable": True, "energy_limit": np.inf}
    contestants = {"together": Simulation(case.together, contact=contact, **common, **fixed)}
    if case.apart is not None:
        contestants["apart"] = Simulation(case.apart, contact=contact, **common, **fixed)
    contestants["without"] = Simulation(case.together, **common, **fixed)
    substeps = first.substeps
    del first
    for one in contestants.values():
        one.step(case.settle)
    seconds: dict[str, list[float]] = {kind: [] for kind in contestants}
    for k in range(rounds):
        for kind in list(contestants) if k % 2 else list(contestants)[::-1]:
            wp.synchronize_device(device)
            start = time.perf_counter()
            contestants[kind].step(FRAMES)
            wp.synchronize_device(device)
            seconds[kind].append((time.perf_counter() - start) / FRAMES)

    def ratio(kind: str) -> float:
        if kind not in seconds:
            return np.nan
        return median(a / b for a, b in zip(seconds["together"], seconds[kind], strict=True))

    model = contestants["together"].model
    frame = median(seconds["together"])
    return {
        "case": name,
        "particles": model.particle_count,
        "connections": model.connection_count,
        "substeps": substeps,
        "us_per_substep": frame / substeps * 1e6,
        "us_without": median(seconds["without"]) / substeps * 1e6,
        "by_apart": ratio("apart"),
        "by_without": ratio("without"),
        "real_time": 1 / FPS / frame,
    }


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "contact.csv"
    if not options.plot_only:
        rows = []
        for name, make in cases(options.quick, options.device).items():
            rounds = QUICK_ROUNDS if options.quick else ROUNDS
            rows.append(measure_case(name, make(), options.device, rounds))
            gc.collect()
            write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ("case", "substeps", "us_per_substep", "us_without", "by_apart", "by_without", "real_time")
    head = ["case", "substeps", "µs/substep", "without", "by apart", "by without", "real time"]
    table("Bodies that touch", head, [[row[column] for column in columns] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
