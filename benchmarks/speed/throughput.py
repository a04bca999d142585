"""How many connections a second, by which algorithm? And how far is that from what the machine could do.

    python -m benchmarks.speed.throughput [--device D] [--quick] [--plot-only]

Every body is simulated with 48 substeps a frame, gravity and one plane that nothing touches, with random
velocities (±0.5 m/s) and steps of 2 µs, so that every connection works and nothing moves much. A connection update
is one connection's force, computed and added at both its ends: there are connections × substeps of them, times
force evaluations a substep (4 in RK4 and in RKC2 with 4 stages). Two times are taken, each the median over rounds
that go through all algorithms in turn: of the recorded frame replayed without reading back (µs per substep; saving
the state and looking it over, once in 48 substeps, are in it), and of `Simulation.step()`, which also reads back
whether the frame was good. The algorithm that "auto" takes is marked; it is one of the three and not timed twice.

What the machine could do, and how near to that a substep comes, is counted in `roofline`.
"""

import gc
import math
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import median

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from msdwarp import RKC2, Plane, Simulation, System, box, sheet
from msdwarp.engine.model.algorithm_choice import FORCE_ALGORITHMS, choose_force_algorithm

from ..common import METHODS, arguments, machine, read_csv, replay, table, write_csv
from .roofline import UNITS, measure_ceilings, shares
from .throughput_plots import draw

SUBSTEPS = 48
FPS = 1e4
ALL_METHODS = {name: METHODS[name] for name in ("symplectic Euler", "leapfrog", "leapfrog θ=½", "RK4")}
ALL_METHODS["RKC2"] = RKC2(4)
PRECISIONS = ("float32", "float32-compensated", "float64")
PLAIN = ("symplectic Euler", "float32")
PRODUCT = [(method, precision) for precision in PRECISIONS for method in ALL_METHODS]
ROUNDS = 7
ROUND_SECONDS = 0.005
"""A round replays a frame until so much time has passed, as far as a first trial tells."""
COMPILING_SECONDS = {True: 900, False: 120}
"""So long the processes that compile ahead are waited for, on the CPU and elsewhere."""


@dataclass(frozen=True)
class Body:
    """What is simulated."""

    name: str
    family: str
    build: Callable[[], System]
    kinds: list[tuple[str, str]] = field(default_factory=lambda: [PLAIN])
    """The methods and precisions it is simulated with."""


def cube(n: int) -> Body:
    """Return a lattice of n³ particles, each joined with 26 others."""
    kinds = PRODUCT if n in (10, 100) else [PLAIN]
    return Body(f"cube {n}³", "lattice", partial(box, (n, n, n), damping=20.0), kinds)


def cloth(n: int) -> Body:
    """Return a sheet of n² particles, each joined with 8 others."""
    return Body(f"cloth {n}²", "cloth", partial(sheet, (n, n), damping=20.0), [PLAIN])


def scenes() -> list[Body]:
    """Return the report's bodies."""

    def scene(name: str, *given, **constants) -> Body:
        return Body(name, "scene", partial(box, *given, **({"damping": 20.0} | constants)))

    return [
        scene("die", (3, 3, 3), stiffness=1e5),
        Body("pinned cloth", "scene", pinned_cloth),
        scene("worm", (2, 2, 400), stiffness=1e5),
        scene("mattress", (20, 7, 2), stiffness=5000.0),
        scene("jelly", (10, 10, 10), stiffness=2200.0, damping=0.1),
    ]


def pinned_cloth() -> System:
    """Return a cloth pinned at three points of an edge."""
    return sheet((31, 31), stiffness=1e4, damping=20.0).pin([930, 945, 960])


def irregular(quick: bool) -> list[Body]:
    """Return bodies of tetrahedra: a torus and, where PyVista is installed, the nut that it ships."""
    size = 10_000 if quick else 100_000
    return [
        Body("torus", "irregular", partial(torus, size)),
        Body("nut", "irregular", partial(nut, size)),
    ]


def torus(size: int) -> System:
    """Return a torus of about so many particles, its tube a quarter as thick as its ring."""
    tube = (size / (8 * math.pi**2)) ** (1 / 3)  # 2π² · 4 tube · tube² is the volume, a particle a cubic metre
    reach = 5 * tube
    place = np.stack(grid((-reach, -reach, -tube), (reach, reach, tube), 1.0), axis=1)
    from_ring = np.hypot(place[:, 0], place[:, 1]) - 4 * tube
    return tetrahedra(place[from_ring**2 + place[:, 2] ** 2 < tube**2])


def nut(size: int) -> System:
    """Return the nut of PyVista's examples, filled with about so many particles."""
    import pyvista
    from pyvista import examples

    surface = examples.load_nut()
    spacing = (surface.volume / size) ** (1 / 3)
    low, high = np.reshape(surface.bounds, (3, 2)).T
    place = np.stack(grid(low, high, spacing), axis=1)
    inside = pyvista.PolyData(place).select_interior_points(surface)["selected_points"].astype(bool)
    return tetrahedra(place[inside] / spacing)


def grid(low, high, spacing: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return x, y, z of a grid's points, along x first."""
    z, y, x = np.meshgrid(
        *(np.arange(a, b, spacing) for a, b in zip(low[::-1], high[::-1], strict=True)), indexing="ij"
    )
    return x.ravel(), y.ravel(), z.ravel()


def tetrahedra(place: NDArray) -> System:
    """Return particles scattered around the places of a grid of 1 m, joined along Delaunay's tetrahedra.

    The order of the grid stays, as software that makes meshes of volumes gives it. Edges of 2 m and more reach
    across a hole and are left out.
    """
    position = place + np.random.default_rng(0).uniform(-0.3, 0.3, place.shape)
    corners = Delaunay(position).simplices.astype(np.int64)
    edges = np.concatenate([corners[:, [a, b]] for a in range(4) for b in range(a)])
    edges.sort(axis=1)
    edges = np.stack(np.divmod(np.unique(edges[:, 0] * len(place) + edges[:, 1]), len(place)), axis=1)
    short = np.linalg.norm(position[edges[:, 0]] - position[edges[:, 1]], axis=1) < 2
    return System(position=position, connections=edges[short], damping=20.0)


def bodies(device: str, quick: bool) -> list[Body]:
    """Return the bodies, the largest last."""
    if quick:
        few = [PLAIN, ("RK4", "float64")]
        return [
            Body("cube 10³", "lattice", cube(10).build, few),
            cube(16),
            cloth(32),
            scenes()[1],
            irregular(True)[0],
        ]
    if device == "cpu":
        cubes, cloths, largest = (3, 6, 10, 16, 25, 32, 40), (32, 64, 128, 256), []
    else:
        cubes, cloths = (3, 6, 10, 16, 25, 32, 48, 64, 100), (32, 64, 128, 256, 512, 1024)
        largest = [cube(160), cloth(2048), cloth(4096), cube(256)]
    return [*map(cube, cubes), *map(cloth, cloths), *scenes(), *irregular(False), *largest]


def simulation(system: System, force_algorithm: str, method: str, precision: str, device: str) -> Simulation:
    """Return a simulation with very short steps and a plane far below."""
    return Simulation(
        system,
        colliders=[Plane(offset=-5000.0)],
        integrator=ALL_METHODS[method],
        fps=FPS,
        substeps=SUBSTEPS,
        allow_unstable=True,
        energy_limit=math.inf,
        device=device,
        precision=precision,
        force_algorithm=force_algorithm,
    )


def moving(system: System) -> System:
    """Return a system with random velocities."""
    random = np.random.default_rng(0)
    return system.with_velocity(random.uniform(-0.5, 0.5, system.position.shape))


def compile_kernels(body: Body, force_algorithm: str, method: str, precision: str, device: str) -> str:
    """Take a frame, for the kernels that this leaves in Warp's cache; return what went wrong, if anything."""
    wp.config.log_level = wp.LOG_ERROR
    try:
        simulation(body.build(), force_algorithm, method, precision, device).step()
    except Exception as error:  # the other kernels are still wanted
        return f"{body.name}, {force_algorithm}, {method}, {precision}: {type(error).__name__}: {str(error)[:200]}"
    return ""


def compile_ahead(device: str) -> None:
    """Compile the kernels of the full product in several processes, as one would take minutes.

    A body whose substeps are one launch has other kernels than a larger one, and the smallest have theirs for each
    size; large lattices have kernels for columns of particles, and each kind of lattice its own stencil.
    """
    start = time.perf_counter()
    pairs = [(cube(10), force_algorithm) for force_algorithm in FORCE_ALGORITHMS]
    if device != "cpu":
        pairs += [*((cube(32), force_algorithm) for force_algorithm in FORCE_ALGORITHMS), (cloth(400), "stencil")]
    jobs = [(body, force_algorithm, *kind, device) for kind in PRODUCT for body, force_algorithm in pairs]
    small = [cube(3), cube(6), cloth(32), cloth(160), *scenes()]
    jobs += [(body, force_algorithm, *PLAIN, device) for body in small for force_algorithm in FORCE_ALGORITHMS]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = min(16, cores or 1)
    try:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            running = pool.starmap_async(compile_kernels, jobs, chunksize=1)
            failed = [said for said in running.get(timeout=COMPILING_SECONDS[device == "cpu"]) if said]
            print(*failed[:3], sep="\n", end="\n" if failed else "")
    except Exception as error:  # what is missing is compiled when it is first used
        print(f"compiling ahead: {type(error).__name__}: {str(error)[:200]}")
    print(f"compiled in {time.perf_counter() - start:.0f} s by {workers} processes", flush=True)


class Contestant:
    """A simulation that is timed in turn with others."""

    def __init__(self, system: System, force_algorithm: str, kind: tuple[str, str], device: str) -> None:
        self.simulation, self.device = simulation(system, force_algorithm, *kind, device), device
        self.simulation.step(2)  # compiles, and records the frame
        self.replayed: list[float] = []
        self.stepped: list[float] = []
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

    def take_round(self) -> None:
        """Time the frame both ways."""
        self.replayed.append(self.seconds(self.replay))
        self.stepped.append(self.seconds(self.simulation.step))


def measure_body(body: Body, device: str, ceilings: dict[str, float], rounds: int) -> list[dict]:
    """Return a row for every algorithm, method and precision of a body."""
    system = moving(body.build())
    automatic = choose_force_algorithm(system, "auto", on_gpu=device != "cpu")[0]
    rows = []
    for kind in body.kinds:
        running = {}
        for force_algorithm in FORCE_ALGORITHMS:
            try:
                running[force_algorithm] = Contestant(system, force_algorithm, kind, device)
            except ValueError as error:  # no lattice, so no stencil
                if "stencil" not in str(error):
                    print_failure(body, force_algorithm, kind)
            except Exception:
                print_failure(body, force_algorithm, kind)
        for _ in range(rounds):
            for contestant in running.values():
                contestant.take_round()
        for force_algorithm, contestant in running.items():
            row = {"body": body.name, "family": body.family, "particles": system.particle_count}
            row |= {
                "connections": system.connection_count,
                "force_algorithm": force_algorithm,
                "automatic": int(force_algorithm == automatic),
            }
            row |= dict(zip(("method", "precision"), kind, strict=True))
            rows.append(row | results(contestant, row, ceilings))
        running.clear()
        contestant = None  # the last reference to a simulation
        gc.collect()
    return rows


def print_failure(body: Body, force_algorithm: str, kind: tuple[str, str]) -> None:
    """Say what failed; the others go on."""
    print(f"failed: {body.name}, {force_algorithm}, {', '.join(kind)}")
    traceback.print_exc(limit=-3)


def results(contestant: Contestant, row: dict, ceilings: dict[str, float]) -> dict:
    """Return what was measured."""
    simulation, substep = contestant.simulation, median(contestant.replayed) / SUBSTEPS
    evaluations = simulation.integrator.evaluations
    return {
        "us_per_substep": substep * 1e6,
        "spread": (max(contestant.replayed) - min(contestant.replayed)) / median(contestant.replayed),
        "us_per_substep_by_step": median(contestant.stepped) / SUBSTEPS * 1e6,
        "evaluations": evaluations,
        "us_per_evaluation": substep / evaluations * 1e6,
        "connections_per_second": row["connections"] / substep,
        "updates_per_second": row["connections"] * evaluations / substep,
        "one_launch": int(simulation.stepping.stepper.blocks is not None),
    } | shares(simulation, row, substep, ceilings)


def measure(options) -> None:
    """Measure everything; what is known is written after each body, in case one ends the process."""
    device, line = options.device, machine(options.device)
    if not options.quick:
        compile_ahead(device)
    ceilings = measure_ceilings(device)
    rows = [{"ceiling": name, "value": v, "unit": UNITS.get(name, "1/s")} for name, v in ceilings.items()]
    write_csv(options.folder / "throughput_ceilings.csv", rows, line)
    rows = []
    for body in bodies(device, options.quick):
        start = time.perf_counter()
        try:
            rows += measure_body(body, device, ceilings, 3 if options.quick else ROUNDS)
        except ImportError as error:
            print(f"{body.name} left out: {error.name or error} is not installed")
        except Exception:
            print_failure(body, "", PLAIN)
        if rows:
            write_csv(options.folder / "throughput.csv", rows, line)
        print(f"{body.name}: {time.perf_counter() - start:.1f} s", flush=True)


def show(rows: list[dict], ceilings: list[dict]) -> None:
    """Print the tables."""
    lines = [[r["ceiling"], r["unit"], r["value"]] for r in ceilings]
    table("What the machine can do", ["ceiling", "unit", "value"], lines)
    columns = ("us_per_substep", "us_per_substep_by_step", "spread", "updates_per_second")
    columns += ("share_of_bandwidth", "share_of_arithmetic")
    head = ["body", "force_algorithm", "particles", "µs/substep", "by step()", "spread", "G updates/s"]
    head += ["of bandwidth", "of arithmetic"]
    plain = [r for r in rows if (r["method"], r["precision"]) == PLAIN]
    printed = [[r["body"], starred(r), r["particles"], *(r[c] for c in columns)] for r in plain]
    for line in printed:
        line[6] /= 1e9
    table("Symplectic Euler, float32; * is what auto takes; shares are those of floors", head, printed)
    head = [
        "body",
        "method, precision",
        *(f"{force_algorithm} [µs/substep]" for force_algorithm in FORCE_ALGORITHMS),
        "G updates/s, auto",
    ]
    table("Methods and precisions", head, product_lines(rows))


def starred(row: dict) -> str:
    """Return a row's algorithm, with a star if it is what "auto" takes."""
    return row["force_algorithm"] + (" *" if row["automatic"] else "")


def product_lines(rows: list[dict]) -> list[list]:
    """Return the lines of the table of methods and precisions."""
    found: dict[tuple, dict] = {}
    for row in rows:
        found.setdefault((row["body"], row["method"], row["precision"]), {})[row["force_algorithm"]] = row
    several = {body for body, method, precision in found if (method, precision) != PLAIN}
    lines = []
    for (body, method, precision), mine in found.items():
        if body in several:
            times = [
                mine[force_algorithm]["us_per_substep"] if force_algorithm in mine else "–"
                for force_algorithm in FORCE_ALGORITHMS
            ]
            automatic = [r["updates_per_second"] / 1e9 for r in mine.values() if r["automatic"]]
            lines.append([body, f"{method}, {precision}", *times, *(automatic or ["–"])])
    return lines


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments(__doc__.splitlines()[0])
    if not options.plot_only:
        measure(options)
    line, rows = read_csv(options.folder / "throughput.csv")
    _, ceilings = read_csv(options.folder / "throughput_ceilings.csv")
    print(line)
    show(rows, ceilings)
    if not options.quick:
        draw(rows, ceilings, line, options.folder)


if __name__ == "__main__":
    sys.exit(main())
