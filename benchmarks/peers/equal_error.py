"""How long does a simulated second take at an error of a hundredth, and of a thousandth? msdwarp beside newton.

    python -m benchmarks.peers.equal_error [--device D] [--quick]

The cases `cloth` and `jelly` of `cases`, without contact, all codes in float32. Error: `cases.relative_error` at
the end of the case against SciPy's DOP853. For every method the fewest steps that reach the error are searched by
doubling, then by bisection to 5 %; then as many steps are timed, as replays of a graph of about 128 (VBD: 16)
steps on CUDA, the median of three. msdwarp's time includes its watch over divergence, once a graph.

What newton's solvers make of a spring of stiffness k and a damper b (newton 1.8):

- SolverSemiImplicit: msdwarp's law and its symplectic Euler, force k (|Δx| − l0) + b Δv·Δx̂ along the axis.
- SolverXPBD: a constraint of compliance 1/k with damping b in the sense of the XPBD paper. Converged, it would be
  backward Euler for the same law. It is relaxed by so many Jacobi iterations, all connections at once, whose sum
  need not converge at large steps; what is left over is an error that no parameter takes away.
- SolverVBD: backward Euler by Newton steps, particle after particle in so many sweeps over the colors of the
  graph (colored here, newton's own coloring sees no springs). The damper acts on a connection's change of
  length over the step, h Δv·Δx̂ to first order.

Backward Euler damps by itself; no parameter takes that away either. Particles are pinned by a mass of 0.
"""

import importlib
import math
import sys
import time
from dataclasses import dataclass, field
from statistics import median

import numpy as np
import warp as wp
from numpy.typing import NDArray

from msdwarp import Simulation, SimulationDiverged

from ..cases import CASES, Case, reference, relative_error
from ..common import METHODS, arguments, frames_and_substeps, machine, read_csv, table, write_csv
from .codes import newton_model
from .compare import attempt

TARGETS = (1e-2, 1e-3)
MSDWARP = ("symplectic Euler", "leapfrog", "leapfrog θ=½", "RK4")
NEWTON = {
    "semi-implicit": ("SolverSemiImplicit", {}),
    "XPBD, 1 iteration": ("SolverXPBD", {"iterations": 1}),
    "XPBD, 2 iterations (default)": ("SolverXPBD", {"iterations": 2}),
    "XPBD, 8 iterations": ("SolverXPBD", {"iterations": 8}),
    "VBD, 2 iterations": ("SolverVBD", {"iterations": 2, "particle_enable_tile_solve": False}),
    "VBD, 10 iterations (default)": ("SolverVBD", {"iterations": 10, "particle_enable_tile_solve": False}),
}
"""Solvers; the tiles of VBD share out the elements round a particle, and springs are none."""
FEWEST, MOST = 60, 60 * 2**12
"""Steps a simulated second that are tried."""
LONGEST = 1.0
"""Longest run [s] that is tried."""


class Msdwarp:
    """A case in msdwarp by one method."""

    def __init__(self, case: Case, method: str, device: str) -> None:
        self.case, self.method, self.device = case, METHODS[method], device

    def run(self, steps: int) -> tuple[NDArray | None, float]:
        """Return (positions at the end, seconds taken); None where the run diverged."""
        frames, substeps = frames_and_substeps(steps, 128)
        simulation = Simulation(
            self.case.system,
            gravity=self.case.gravity,
            integrator=self.method,
            fps=frames / self.case.duration,
            substeps=substeps,
            allow_unstable=True,
            energy_limit=math.inf,
            device=self.device,
            precision="float32",
        )
        try:
            simulation.step(frames)
            position = simulation.frame().position.astype(np.float64)
            return position, self._timed(simulation, frames)
        except SimulationDiverged:
            return None, 0.0

    def _timed(self, simulation: Simulation, frames: int) -> float:
        """Return the time of as many frames again [s], the graph being recorded."""
        start = time.perf_counter()
        simulation.step(frames)
        wp.synchronize_device(self.device)
        return time.perf_counter() - start


class Newton:
    """A case in newton by one solver."""

    def __init__(self, case: Case, method: str, device: str) -> None:
        newton = importlib.import_module("newton")
        name, options = NEWTON[method]
        self.case, self.device = case, device
        self.graph_steps = 16 if "VBD" in name else 128
        self.model = newton_model(newton, case, device, colors(case.system) if "VBD" in name else None)
        self.solver = getattr(newton.solvers, name)(self.model, **options)
        self.states = [self.model.state(), self.model.state()]
        self._steps(2, case.duration / MOST)  # compiles

    def _steps(self, count: int, h: float) -> None:
        """Take an even number of steps of h seconds."""
        here, there = self.states
        for _ in range(count):
            here.clear_forces()
            self.solver.step(here, there, None, None, h)
            here, there = there, here

    def run(self, steps: int) -> tuple[NDArray | None, float]:
        """Return (positions at the end, seconds taken)."""
        replays, count = frames_and_substeps(steps, self.graph_steps)
        count += count % 2
        h = self.case.duration / (replays * count)
        for state in self.states:
            state.particle_q.assign(self.model.particle_q)
            state.particle_qd.assign(self.model.particle_qd)
        graph = None
        if self.device != "cpu":
            with wp.ScopedCapture(device=self.device) as capture:
                self._steps(count, h)
            graph = capture.graph
        wp.synchronize_device(self.device)
        start = time.perf_counter()
        for _ in range(replays):
            if graph is None:
                self._steps(count, h)
            else:
                wp.capture_launch(graph)
        wp.synchronize_device(self.device)
        seconds = time.perf_counter() - start
        return self.states[0].particle_q.numpy().astype(np.float64), seconds


def colors(system) -> list[NDArray]:
    """Return groups of particles no two of which are connected, found greedily."""
    neighbours = [[] for _ in range(system.particle_count)]
    for i, j in system.connections.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    color = np.full(system.particle_count, -1)
    for i, others in enumerate(neighbours):
        taken = {color[j] for j in others}
        color[i] = next(c for c in range(len(others) + 1) if c not in taken)
    return [np.flatnonzero(color == c) for c in range(color.max() + 1)]


@dataclass
class Search:
    """The runs of a method on a case so far."""

    solver: Msdwarp | Newton
    case: Case
    wanted: NDArray
    longest: float
    found: dict[int, tuple[float, float]] = field(default_factory=dict)
    """(error, seconds) by steps a simulated second."""

    def error(self, rate: int) -> float:
        """Return the error with so many steps a simulated second; infinite where the run diverges."""
        if rate not in self.found:
            position, seconds = self.solver.run(round(rate * self.case.duration))
            error = relative_error(self.case, position, self.wanted)
            self.found[rate] = (error if math.isfinite(error) else math.inf, seconds)
        return self.found[rate][0]

    def fewest(self, target: float) -> int | None:
        """Return the fewest steps a simulated second that reach the target; None if none do that were tried."""
        rate = FEWEST
        while self.error(rate) > target:
            if 2 * rate > MOST or 2 * self.found[rate][1] > self.longest:
                return None
            rate *= 2
        missed = rate // 2
        while rate - missed > 0.05 * rate:
            middle = (rate + missed) // 2
            rate, missed = (middle, missed) if self.error(middle) <= target else (rate, middle)
        return rate

    def seconds(self, rate: int) -> float:
        """Return the time of a simulated second [s], the median of three runs."""
        times = [self.solver.run(round(rate * self.case.duration))[1] for _ in range(3)]
        return median(times) / self.case.duration


def measure_method(case: Case, code: str, method: str, wanted: NDArray, options) -> list[dict]:
    """Return a row for each target."""
    rows, search = [], None
    for target in TARGETS:
        row = {"case": case.name, "code": code, "method": method, "target": target, "substeps": float("nan")}
        row |= {"error": float("nan"), "seconds_per_simulated_second": float("nan"), "note": ""}
        rows.append(row)
        if search is None:
            solver = attempt(row, {"msdwarp": Msdwarp, "newton": Newton}[code], case, method, options.device)
            if solver is None:
                continue
            search = Search(solver, case, wanted, LONGEST)
        rate = attempt(row, search.fewest, target)
        if rate is not None:
            row["substeps"], row["error"] = rate, search.found[rate][0]
            row["seconds_per_simulated_second"] = attempt(row, search.seconds, rate) or float("nan")
        elif not row["note"]:
            most = max(search.found)
            row["note"] = f"not reached: {search.found[most][0]:.2g} with {most} steps a second"
    return rows


def measure(options) -> list[dict]:
    """Measure every case and method; what is known is written after each case."""
    rows = []
    for name in ("cloth",) if options.quick else ("cloth", "jelly"):
        start = time.perf_counter()
        case = CASES[name]()
        wanted = reference(case, 1e-9)
        print(f"{case.title}: reference after {time.perf_counter() - start:.0f} s", flush=True)
        for code, methods in {"msdwarp": MSDWARP, "newton": NEWTON}.items():
            for method in methods:
                rows += measure_method(case, code, method, wanted, options)
        write_csv(options.folder / "equal_error.csv", rows, machine(options.device))
        print(f"{case.title}: {time.perf_counter() - start:.0f} s", flush=True)
    return rows


def show(rows: list[dict]) -> None:
    """Print a table for every case and error."""
    head = ["code", "method", "steps a second", "error", "s a simulated second", "note"]
    for name, target in dict.fromkeys((row["case"], row["target"]) for row in rows):
        body = []
        for row in rows:
            if (row["case"], row["target"]) == (name, target):
                cells = [row["substeps"], row["error"], row["seconds_per_simulated_second"]]
                cells = ["–" if cell != cell else cell for cell in cells]
                body.append([row["code"], row["method"], *cells, row["note"]])
        table(f"{name}, error {target:g}", head, body)


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    if not options.plot_only:
        measure(options)
    line, rows = read_csv(options.folder / "equal_error.csv")
    print(line)
    show(rows)


if __name__ == "__main__":
    sys.exit(main())
