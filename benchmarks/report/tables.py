"""The report's tables 2 and 3: the largest stable stiffness, and what each method's steps are worth in accuracy.

    python -m benchmarks.report.tables [--device D] [--quick] [--plot-only]

A body of 1 kg particles 1 m apart with b = 20 N s/m is dropped on a floor with the report's contact rule: from
1 m and, as the report names no height but in its prestudy, from the 15 m of that. It is stable if 20 s pass with
finite numbers and an energy below ten times the scene's scale; bisection to 0.2 %. The linear limit of
semi-implicit Euler is h²λ + 2hbλ/k = 4, that of Runge-Kutta 4 (eq. 6) comes from its stability polynomial over all
modes; λ = Lk/m by Lanczos. Then, on the mattress with the report's k = 5000 before contact: the position error at
equal force evaluations per frame.
"""

import sys
import time
from collections.abc import Callable

from msdwarp import Plane, Simulation, SimulationDiverged, System, box
from msdwarp.engine import rate_bounds
from msdwarp.integrators import choose_forced

from ..accuracy.theory import stable_step, top_mode
from ..cases import mattress_case, reference, relative_error
from ..common import METHODS, arguments, machine, read_csv, run, table, write_csv

DAMPING, FPS = 20.0, 60.0
HEIGHTS = (1.0, 15.0)
FLOOR = Plane(restitution=0.5, tangential_factor=0.9)
BLOCK, MATTRESS = (3, 12, 20), (20, 7, 2)
TABLES = [
    ("table 2", BLOCK, "symplectic Euler", 4, "5550", 5550.0),
    ("table 2", BLOCK, "RK4", 4, "10600, not eq. 6", 33474.0),
    ("table 3", MATTRESS, "symplectic Euler", 44, "2150000", 2150000.0),
    ("table 3", MATTRESS, "RK4", 7, "40000, not eq. 6", 125027.0),
]
"""Table, shape, method, substeps per frame, the report's k, and what this should come to."""


def body(shape: tuple[int, ...], k: float, height: float) -> System:
    """Return a body with its lowest particles at a height [m] above the floor."""
    system = box(shape, stiffness=k, damping=DAMPING)
    return system.translate((0, 0, height - system.position[:, 2].min()))


def linear_limit(shape: tuple[int, ...], method: str, substeps: int) -> tuple[float, float]:
    """Return (L, the k [N/m] at which the longest stable step is a substep)."""
    L, _ = top_mode(box(shape, stiffness=1.0))
    low, high, h = 1.0, 1e8, 1 / (FPS * substeps)
    while high - low > 1e-5 * high:
        k = (low * high) ** 0.5
        low, high = (k, high) if stable_step(METHODS[method], L * k, DAMPING / k) >= h else (low, k)
    return L, low


def holds(system: System, method: str, substeps: int, seconds: float, device: str) -> bool:
    """Tell whether a run in float64 stays within the energy limit.

    The simulator would grant a step near the limit a larger one, the swing of a stable method's energy there;
    the report's criterion has no such thing, and it is divided out.
    """
    choice = choose_forced(rate_bounds(system), METHODS[method], FPS, substeps)
    simulation = Simulation(
        system,
        colliders=[FLOOR],
        collider_rule="report",
        integrator=METHODS[method],
        fps=FPS,
        substeps=substeps,
        allow_unstable=True,
        energy_limit=10.0 / choice.energy_swing,
        device=device,
        precision="float64",
    )
    try:
        simulation.step(round(seconds * FPS))
    except SimulationDiverged:
        return False
    return True


def measured_limit(stable: Callable[[float], bool], start: float) -> float:
    """Return the largest k that is stable [N/m], by bisection from around `start`."""
    low, high = 0.95 * start, 1.05 * start
    while not stable(low):
        low, high = 0.95 * low, low
    while stable(high):
        low, high = high, 1.05 * high
    while high - low > 2e-3 * high:
        k = (low + high) / 2
        low, high = (k, high) if stable(k) else (low, k)
    return low


def limits(options) -> list[dict]:
    """Return a row for every entry of the tables."""
    rows = []
    for name, shape, method, substeps, report, target in TABLES:
        began = time.perf_counter()
        L, linear = linear_limit(shape, method, substeps)
        seconds = 2.0 if options.quick else 20.0
        measured = [
            measured_limit(
                lambda k, h=height: holds(body(shape, k, h), method, substeps, seconds, options.device),  # noqa: B023
                linear,
            )
            for height in HEIGHTS
        ]
        rows.append(
            {
                "what": f"{name}: {'x'.join(map(str, shape))}",
                "method": method,
                "substeps": substeps,
                "L": L,
                "report": report,
                "linear_theory": linear,
                **{f"measured_{height:g}_m": k for height, k in zip(HEIGHTS, measured, strict=True)},
                "expected": target,
            }
        )
        print(f"{name}, {method}: {time.perf_counter() - began:.0f} s", flush=True)
    return rows


def equal_cost(options) -> list[dict]:
    """Return the error of each method at equal evaluations per frame on the mattress before contact."""
    case, rows = mattress_case(), []
    wanted = reference(case, 1e-12)
    for per_frame in (4, 8, 16, 32, 64, 128):
        row = {"evaluations_per_frame": per_frame}
        for name in ("symplectic Euler", "leapfrog", "leapfrog θ=½", "RK4"):
            steps = per_frame * FPS * case.duration / METHODS[name].evaluations
            position, *_ = run(case, METHODS[name], steps, device=options.device)
            error = relative_error(case, position, wanted)
            row[name] = error if error < 1 else float("nan")
        rows.append(row)
    return rows


def show(limit_rows: list[dict], cost_rows: list[dict]) -> None:
    """Print both tables; "unstable" where the error passes the way travelled."""
    head = ["body", "method", "substeps", "L", "report's k", "linear theory", "from 1 m", "from 15 m", "expected"]
    body = [
        [r["what"], r["method"], f"{r['substeps']:.0f}", f"{r['L']:.3f}", str(r["report"])]
        + [f"{r[key]:.0f}" for key in ("linear_theory", "measured_1_m", "measured_15_m", "expected")]
        for r in limit_rows
    ]
    table("Largest stable k [N/m]", head, body)
    body = [[f"{v:.0f}" if k == 0 else "unstable" if v != v else f"{v:.2e}" for k, v in enumerate(r.values())]
            for r in cost_rows]  # fmt: skip
    table("Error on the mattress, k = 5000 N/m", list(cost_rows[0]), body)


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    limit_path, cost_path = options.folder / "report_tables.csv", options.folder / "report_equal_cost.csv"
    if not options.plot_only:
        line = machine(options.device)
        write_csv(cost_path, equal_cost(options), line)
        write_csv(limit_path, limits(options), line)
    show(read_csv(limit_path)[1], read_csv(cost_path)[1])


if __name__ == "__main__":
    sys.exit(main())
