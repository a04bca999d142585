"""What acts on a few, tears or moves: what it costs beside the same scene without it.

    python -m benchmarks.speed.loads [--device D] [--quick]

A pair of lattices of 64³ particles lies side by side, and is tied along a face; a lattice of 100³ has a force on
each particle of its surface, which are 6 % of all, or on as many at random, or a spring from each of these to
where it is; a lattice of 100³ and the cloth of the scene can tear, though nothing does; lattices of 10³, 32³ and
100³ of a material have a Poisson's ratio of 0.45, by cells. There are 48 substeps a frame, gravity and one plane
that nothing touches, random velocities and steps of 2 µs, as in `throughput`. Rounds go through both in turn; the
ratio is the median over rounds of one time over the other, the spread the middle half of these ratios. Times are
of the recorded frame replayed and of `Simulation.step()`, in which besides the host prepares each frame. The scene
jelly, whose obstacle moves, is compared with the same whose obstacle stands still, at the same number of substeps:
there `step(60)` counts.
"""

import gc
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from statistics import median

import numpy as np
import warp as wp
from numpy.typing import NDArray

from msdwarp import Attachment, Force, Material, Plane, Scene as SceneToRun, Simulation, System, box, join, sheet
from msdwarp.scenes import jelly

from ..common import arguments, machine, read_csv, replay, table, write_csv

SUBSTEPS, FPS = 48, 1e4
ROUNDS, QUICK_ROUNDS = 21, 5
ROUND_SECONDS = 0.02
"""A round replays a frame until so much time has passed, as far as a first trial tells."""
STIFFNESS = 1000.0
PAIR_AIM, LOAD_AIM, TEAR_AIM, MOVE_AIM, CELLS_AIM = 1.1, 1.05, 1.15, 1.3, 1.6
"""How many times the substep without them one with them may take."""

Scene = tuple[System, Sequence] | Simulation
"""A system, and the loads on it; or a simulation as it is."""


def pair(n: int) -> tuple[System, System]:
    """Return two lattices of n³ particles side by side, joined along a face, and the same unjoined."""
    one = box((n, n, n), damping=20.0)
    other = one.translate((float(n), 0.0, 0.0))
    return join(one, other, within=1.0, stiffness=STIFFNESS, damping=20.0), one + other


def surface(system: System) -> NDArray[np.bool_]:
    """Return the particles of a box that lie on its surface."""
    x = system.position
    return ((x == x.min(axis=0)) | (x == x.max(axis=0))).any(axis=1)


def cases(quick: bool) -> dict[str, tuple[float, Callable[[], tuple[Scene, Scene]]]]:
    """Return for each case what is aimed at, and a function that makes the scene with and the one without."""
    few, many = (12, 16) if quick else (64, 100)

    def tied() -> tuple[Scene, Scene]:
        joined, apart = map(moving, pair(few))
        return (joined, ()), (apart, ())

    def loaded(load: Callable[[NDArray], object], spread: bool = False) -> tuple[Scene, Scene]:
        body = moving(box((many, many, many), damping=20.0))
        chosen = surface(body)
        if spread:
            chosen = np.random.default_rng(1).permutation(chosen)
        return (body, [load(chosen)]), (body, ())

    def wave(t: float) -> tuple:
        return np.sin(9.0 * t), 0.0, 1.0

    def tearing() -> tuple[Scene, Scene]:
        body = moving(box((many, many, many), damping=20.0))
        return (body.replace(break_strain=1e6), ()), (body, ())

    def tearing_cloth() -> tuple[Scene, Scene]:
        cloth = moving(sheet((31, 31), 0.05, stiffness=120.0, damping=0.06))
        return (cloth.replace(break_strain=1e6), ()), (cloth, ())

    def rubber(n: int) -> tuple[Scene, Scene]:
        made = Material(density=1.0, youngs_modulus=1000.0, damping_ratio=0.1)
        plain = moving(box((n, n, n), material=made))
        return (moving(box((n, n, n), material=replace(made, poissons_ratio=0.45))), ()), (plain, ())

    return {
        f"two {few}³ tied along a face": (PAIR_AIM, tied),
        f"{many}³, force on the surface": (LOAD_AIM, lambda: loaded(lambda on: Force((0, 0, 1.0), on=on))),
        f"{many}³, force of time on the surface": (LOAD_AIM, lambda: loaded(lambda on: Force(wave, on=on))),
        f"{many}³, force on as many at random": (
            LOAD_AIM,
            lambda: loaded(lambda on: Force((0, 0, 1.0), on=on), True),
        ),
        f"{many}³, surface attached": (LOAD_AIM, lambda: loaded(lambda on: Attachment(on, stiffness=STIFFNESS))),
        f"{many}³ that can tear": (TEAR_AIM, tearing),
        "31 × 31 cloth that can tear": (TEAR_AIM, tearing_cloth),
    } | {
        f"{n}³ with Poisson's ratio 0.45": (CELLS_AIM, partial(rubber, n))
        for n in ((10, 16) if quick else (10, 32, 100))
    }


def moved(scene: SceneToRun, device: str) -> tuple[Simulation, Simulation]:
    """Return a scene whose obstacle moves, and the same at rest, at as many substeps."""
    fixed = replace(scene, colliders=[replace(one, motion=None) for one in scene.colliders])
    substeps = Simulation.from_scene(scene, device=device).substeps
    how = {"substeps": substeps, "device": device, "energy_limit": math.inf, "allow_unstable": True}
    return Simulation.from_scene(scene, **how), Simulation.from_scene(fixed, **how)


def moving(system: System) -> System:
    """Return a system with random velocities."""
    return system.with_velocity(np.random.default_rng(0).uniform(-0.5, 0.5, system.position.shape))


class Contestant:
    """A simulation that is timed in turn with another."""

    def __init__(self, scene: Scene, device: str) -> None:
        self.device = device
        if isinstance(scene, Simulation):
            self.simulation, self.times = scene, 1
            self.simulation.step(2)
            return
        system, loads = scene
        self.simulation = Simulation(
            system,
            colliders=[Plane(offset=-5000.0)],
            loads=loads,
            fps=FPS,
            substeps=SUBSTEPS,
            allow_unstable=True,
            energy_limit=math.inf,
            device=device,
        )
        self.simulation.step(2)  # compiles, and records the frame
        self.times = 1
        self.times = max(1, min(200, round(ROUND_SECONDS / self.seconds(self.replay))))

    def replay(self) -> None:
        """Replay the recorded frame; nothing is read back."""
        replay(self.simulation)

    def seconds(self, frame: Callable[[], None]) -> float:
        """Return the time of a frame [s], over several."""
        wp.synchronize_device(self.device)
        start = time.perf_counter()
        for _ in range(self.times):
            frame()
        wp.synchronize_device(self.device)
        return (time.perf_counter() - start) / self.times


def measure_case(name: str, aim: float, make: Callable[[], tuple[Scene, Scene]], device: str, rounds: int) -> dict:
    """Return the row of a case."""
    both = [Contestant(scene, device) for scene in make()]
    replayed: list[list[float]] = [[], []]
    stepped: list[list[float]] = [[], []]
    for k in range(rounds):
        for one in (0, 1) if k % 2 else (1, 0):  # what comes first is not always the same
            replayed[one].append(both[one].seconds(both[one].replay))
            stepped[one].append(both[one].seconds(both[one].simulation.step))
    ratios = [a / b for a, b in zip(*replayed, strict=True)]
    model = both[0].simulation.model
    row = {"case": name, "particles": model.particle_count, "connections": model.connection_count}
    row |= {"us_per_substep": median(replayed[0]) / SUBSTEPS * 1e6}
    row |= {"us_without": median(replayed[1]) / SUBSTEPS * 1e6, "ratio": median(ratios)}
    quarters = np.quantile(ratios, [0.25, 0.75])
    row |= {"spread": float(quarters[1] - quarters[0]), "aim": aim}
    return row | {"ratio_by_step": median(a / b for a, b in zip(*stepped, strict=True))}


def measure_moving(name: str, scene: SceneToRun, device: str, rounds: int) -> dict:
    """Return the row of a scene whose obstacle moves."""
    both = [Contestant(one, device) for one in moved(scene, device)]
    times: list[list[float]] = [[], []]
    frames = 60
    for k in range(rounds):
        for one in (0, 1) if k % 2 else (1, 0):
            simulation = both[one].simulation
            simulation.reset()
            simulation.step(2)
            times[one].append(both[one].seconds(lambda simulation=simulation: simulation.step(frames)) / frames)
    ratios = [a / b for a, b in zip(*times, strict=True)]
    model, substeps = both[0].simulation.model, both[0].simulation.substeps
    row = {"case": name, "particles": model.particle_count, "connections": model.connection_count}
    row |= {"us_per_substep": median(times[0]) / substeps * 1e6, "us_without": median(times[1]) / substeps * 1e6}
    quarters = np.quantile(ratios, [0.25, 0.75])
    row |= {"ratio": median(ratios), "spread": float(quarters[1] - quarters[0]), "aim": MOVE_AIM}
    return row | {"ratio_by_step": median(ratios)}


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "loads.csv"
    if not options.plot_only:
        rows = []
        for name, (aim, make) in cases(options.quick).items():
            rounds = QUICK_ROUNDS if options.quick else ROUNDS
            rows.append(measure_case(name, aim, make, options.device, rounds))
            gc.collect()
            write_csv(path, rows, machine(options.device))
        rounds = 3 if options.quick else 9
        rows.append(measure_moving("jelly, obstacle moving or at rest", jelly.build(), options.device, rounds))
        write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ("case", "us_per_substep", "us_without", "ratio", "spread", "aim", "ratio_by_step")
    head = ["case", "µs/substep", "without", "ratio", "spread", "aim", "ratio by step()"]
    table("ExtraSprings and loads on a few particles", head, [[row[column] for column in columns] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
