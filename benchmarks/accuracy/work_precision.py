"""How much work buys how much accuracy? Position error against force evaluations and against time.

    python -m benchmarks.accuracy.work_precision [--device D] [--quick] [--plot-only] [--auto-only]

Error: RMS distance from a reference at the end of a scene's span over the RMS way of its particles. Before contact
the reference is exact (chain) or SciPy's DOP853 on a NumPy right-hand side of its own, whose error is taken from a
hundredfold looser tolerance; points within 100 times that error are left out. After contact it is leapfrog in
float64 with steps 32 times finer than the finest plotted, its error taken from steps twice as long; points within
10 times that are left out. Each curve's first point is just below the longest step that linear theory calls stable
(RKC2: that the simulator allows). Time is a substep's measured time (median of interleaved repeats, 32 substeps a
frame) times substeps per simulated second. What automatic substeps reach, at 60 frames a second, is written to
automatic.csv, and drawn as a star: `--auto-only` measures nothing else.
"""

import argparse
import math
import sys
import time
from statistics import median

import warp as wp

from msdwarp import RKC2, Simulation, UnstableStep, stability_limit

from ..cases import CASES, CONTACT_CASES, Case, reference, relative_error
from ..common import METHODS, arguments, machine, read_csv, run, table, write_csv
from .stability import body_at_rest
from .theory import stable_step, top_mode
from .work_precision_plots import draw, draw_time

FINER = (1.02, 1.2, 1.5, 2, 3, 4, 6, 8, 11, 16, 22, 32, 64, 128, 256)
FINEST = {"chain": 256, "jelly": 32, "soft_cube": 8}
"""Work tried, over the least that symplectic Euler is stable with; 16 elsewhere, 8 with contact."""
FINER_CONTACT = (1.02, 1.5, 2, 4, 8)
ALL_METHODS = METHODS | {"RKC2, 20 stages": RKC2(20)}
"""A simulation chooses at most 5 stages; 20 are tried where dampers dominate and nothing is touched."""
LOW_PRECISION_SCENES = ("worm", "mattress")
LOW_PRECISIONS = ("float32", "float32-compensated")
TARGETS = (1e-2, 1e-3, 1e-6)


def limits(name: str, case: Case) -> dict[str, float]:
    """Return the longest stable step [s] of each method for a scene's body at rest."""
    body = body_at_rest(name)
    largest, _ = top_mode(body)
    ratio = float(body.damping[0] / body.stiffness[0])
    return {
        key: stability_limit(case.system, method)
        if isinstance(method, RKC2)
        else stable_step(method, largest, ratio)
        for key, method in ALL_METHODS.items()
    }


def substep_times(case: Case, limit: dict[str, float], keys: list, device: str, repeats: int) -> dict:
    """Return the time of an evaluation [s] for each (method, precision), the median of interleaved repeats."""
    simulations = {}
    for method, precision in keys:
        integrator = RKC2(4) if method == "RKC2" else ALL_METHODS[method]
        simulation = Simulation(
            case.system,
            gravity=case.gravity,
            colliders=case.colliders,
            integrator=integrator,
            fps=1 / (32 * 0.25 * limit[method]),
            substeps=32,
            allow_unstable=True,
            energy_limit=math.inf,
            device=device,
            precision=precision,
        )
        simulation.step()
        simulations[method, precision] = simulation
    times = {key: [] for key in keys}
    for _ in range(repeats):
        for key, simulation in simulations.items():
            wp.synchronize_device(device)
            start = time.perf_counter()
            simulation.step(2)
            wp.synchronize_device(device)
            times[key].append((time.perf_counter() - start) / (64 * simulation.integrator.evaluations))
    return {key: median(values) for key, values in times.items()}


def reference_of(case: Case, steps: float, device: str):
    """Return (positions at the end, their own error); after contact by so many steps of leapfrog."""
    if case.colliders:
        leapfrog = METHODS["leapfrog"]
        fine, coarse = (run(case, leapfrog, share * steps, device=device)[0] for share in (1, 0.5))
    else:
        fine, coarse = reference(case, 1e-12), reference(case, 1e-10)
    return fine, max(relative_error(case, coarse, fine), 1e-14)


def measure_automatic(name: str, case: Case, device: str) -> list[dict]:
    """Return a row for every method: what automatic substeps cost and reach at 60 frames a second."""
    limit = limits(name, case)
    steps = 32 * (8 if case.colliders else 16) * case.duration / limit["symplectic Euler"]
    fine, own = reference_of(case, steps, device)
    rows = []
    for method, integrator in METHODS.items():
        if not limit[method] > 0:
            continue
        frames = round(60 * case.duration)
        around = {"gravity": case.gravity, "colliders": case.colliders, "precision": "float64"}
        how = {"integrator": integrator, "fps": frames / case.duration, "device": device}
        try:
            simulation = Simulation(case.system, **around, **how)
        except UnstableStep:
            continue
        work = 0
        for _ in range(frames):
            simulation.step()
            work += simulation.substeps * simulation.integrator.evaluations
        error = relative_error(case, simulation.frame().position.astype("float64"), fine)
        counts = [count for _, count in simulation.substep_history]
        row = {"scene": case.name, "method": method, "evaluations": work, "error": error, "reference_error": own}
        rows.append(row | {"least_substeps": min(counts), "most_substeps": max(counts)})
    return rows


def measure_case(name: str, case: Case, options) -> list[dict]:
    """Return a row for every method, precision and step of a scene."""
    limit, contact = limits(name, case), bool(case.colliders)
    cheapest = case.duration / limit["symplectic Euler"]
    finest = 8 if contact else FINEST.get(name, 16)
    finer = [share for share in (FINER_CONTACT if contact else FINER) if share <= finest]
    finer = finer[: 5 if options.quick else None]
    most = finer[-1] * cheapest
    fine, own = reference_of(case, 32 * finer[-1] * cheapest, options.device)

    def starts(method: str) -> bool:
        if method not in METHODS and case.name != "soft_cube":
            return False
        return limit[method] > 0 and ALL_METHODS[method].evaluations * case.duration / limit[method] < most / 2

    keys = [(m, "float64") for m in ALL_METHODS if starts(m)]
    if case.name in LOW_PRECISION_SCENES:
        keys += [(m, precision) for m in ("leapfrog", "RK4") for precision in LOW_PRECISIONS]
    times = substep_times(case, limit, keys, options.device, 3 if options.quick else 9)
    rows = []
    for method, precision in keys:
        for share in finer:
            steps = share * case.duration / limit[method]
            if ALL_METHODS[method].evaluations * steps > most:
                break
            position, taken, evaluations = run(
                case, ALL_METHODS[method], steps, device=options.device, precision=precision
            )
            error = relative_error(case, position, fine)
            if not 100 * own * (0.1 if contact else 1) < error < 1:
                continue
            rows.append(
                {
                    "scene": case.name,
                    "title": case.title,
                    "duration": case.duration,
                    "method": method,
                    "precision": precision,
                    "step": case.duration / taken,
                    "share_of_limit": case.duration / taken / limit[method],
                    "evaluations": taken * evaluations,
                    "seconds_per_second": times[method, precision] * taken * evaluations / case.duration,
                    "error": error,
                    "reference_error": own,
                }
            )
    return rows


def measure(options, measure_one) -> list[dict]:
    """Return the rows of every scene before contact and after it, by `measure_one(name, case)`."""
    cases = [(name, build()) for name, build in [*CASES.items(), *CONTACT_CASES.items()]]
    if options.quick:
        cases = [(n, c) for n, c in cases if n in ("chain", "mattress")]
    rows = []
    for name, case in cases:
        start = time.perf_counter()
        rows += measure_one(name, case)
        print(f"{case.title}: {time.perf_counter() - start:.0f} s", flush=True)
    return rows


def cheapest(rows: list[dict], scene: str, target: float) -> list[tuple[float, str]]:
    """Return (evaluations, method), cheapest first: from there on the float64 error is at most `target`."""
    found = []
    for method in ALL_METHODS:
        mine = [r for r in rows if (r["scene"], r["method"], r["precision"]) == (scene, method, "float64")]
        reached = [r["evaluations"] for r in mine if r["error"] <= target]
        missed = [r["evaluations"] for r in mine if r["error"] > target]
        good = [n for n in reached if n > max(missed, default=0)]
        if good:
            found.append((min(good), method))
    return sorted(found)


def show(rows: list[dict]) -> None:
    """Print the cheapest methods of every scene."""
    body = []
    for scene in dict.fromkeys(r["scene"] for r in rows):
        line = [scene, f"{next(r['reference_error'] for r in rows if r['scene'] == scene):.1g}"]
        for target in TARGETS:
            line.append(
                ", ".join(f"{method} {n:.0f}" for n, method in cheapest(rows, scene, target)[:3]) or "none"
            )
        body.append(line)
    head = ["scene", "reference's error", *(f"error {target:.0e}" for target in TARGETS)]
    table("Force evaluations to an error, float64, the three cheapest methods (of the steps tried)", head, body)


def main() -> None:
    """Measure, write, print and draw."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--auto-only", action="store_true", help="measure automatic substeps alone")
    options = arguments(__doc__.splitlines()[0], own)
    path, automatic = (options.folder / name for name in ("work_precision.csv", "automatic.csv"))
    if not (options.plot_only or options.auto_only):
        write_csv(path, measure(options, lambda n, case: measure_case(n, case, options)), machine(options.device))
    if not options.plot_only:
        found = measure(options, lambda n, case: measure_automatic(n, case, options.device))
        write_csv(automatic, found, machine(options.device))
    _, found = read_csv(automatic)
    table("What automatic substeps cost and reach", list(found[0]), [list(row.values()) for row in found])
    if options.quick and options.auto_only:
        return
    _, rows = read_csv(path)
    show(rows)
    if not options.quick:
        draw(rows, found)
        for measured in sorted(path.parents[1].glob(f"*/{path.name}")):  # every machine that was measured
            line, rows = read_csv(measured)
            draw_time(rows, line, measured.parent.name)


if __name__ == "__main__":
    sys.exit(main())
