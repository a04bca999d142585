"""The gradient of the same run in msdwarp, newton and Taichi: how long it takes, and how much memory.

    python -m benchmarks.peers.gradient [--device D] [--quick]

Blocks of n³ particles with all neighbours, 200 steps of symplectic Euler in float32, and a weighted sum of the
positions at the end, as a loss. Each code gives its derivatives by all positions and velocities at the start and
by the stiffness of every spring. newton's SolverSemiImplicit is differentiated by `wp.Tape`, forward and backward
recorded in a CUDA graph; Taichi's program has the structure of DiffTaichi's mass_spring (Hu et al. 2020) with our
law, differentiated by `ti.ad.Tape`. `difference` is that of the derivative by positions from msdwarp's in float64,
by the norm. Memory is what the arrays of a run take. Writes results/<device>/peers_gradient.csv.
"""

import importlib
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from msdwarp import Simulation, SymplecticEuler, box
from msdwarp.simulation.gradient_run import MOST_KEPT

from ..common import arguments, machine, read_csv, table, write_csv
from .codes import newton_model
from .compare import Body

SIZES, FRAMES, SUBSTEPS, REPEATS = (10, 20, 32, 64), 10, 20, 5
STEPS = FRAMES * SUBSTEPS
BY = ("position", "velocity", "stiffness")
Run = tuple[Callable[[], None], Callable[[], NDArray], float]
"""Gives value and gradient; returns the derivative by positions; memory of a run [bytes]."""


def body_of(n: int) -> Body:
    """Return a block that falls and swings."""
    system = box((n, n, n), 0.05, stiffness=500.0, damping=0.05)
    return Body(f"{n}³", system.replace(position=1.01 * system.position), (n, n, n), 1 / 1200)


def weights(body: Body) -> NDArray[np.float64]:
    """Return the derivatives of the loss by the positions at the end."""
    count = body.system.particle_count
    return np.linspace(1.0, 2.0, 3 * count).reshape(count, 3) / count


def of_msdwarp(body: Body, device: str, precision: str = "float32") -> Run:
    """Return msdwarp's run."""
    simulation = Simulation(
        body.system,
        integrator=SymplecticEuler(),
        fps=1 / (SUBSTEPS * body.step),
        substeps=SUBSTEPS,
        precision=precision,
        device=device,
    )
    run, _ = simulation.differentiated(1, BY)
    by_position = [*[None] * FRAMES, weights(body)]

    def both() -> None:
        run.take(FRAMES)
        run.backward(by_position, [None] * (FRAMES + 1))

    count, c = body.system.particle_count, body.system.connection_count
    # States: a checkpoint a frame, and the tapes of all or of one; derivatives; constants in two precisions.
    tapes = FRAMES + 1 if count <= MOST_KEPT else 1
    memory = 32.0 * count * (FRAMES + 1 + tapes * (SUBSTEPS + 1)) + 92.0 * count + 12.0 * c
    return both, lambda: run.found(["position"])["position"], memory


def of_newton(body: Body, device: str) -> Run:
    """Return newton's run."""
    newton = importlib.import_module("newton")
    model = newton_model(newton, body, device, requires_grad=True)
    solver = newton.solvers.SolverSemiImplicit(model)
    states = [model.state(requires_grad=True) for _ in range(STEPS + 1)]
    last = wp.array(weights(body).astype(np.float32), dtype=wp.vec3, device=device)
    tape = wp.Tape()

    def launch() -> None:
        tape.reset()
        with tape:
            for k in range(STEPS):
                states[k].clear_forces()
                solver.step(states[k], states[k + 1], None, None, body.step)
        tape.backward(grads={states[-1].particle_q: last})

    launch()
    graph = None
    if device != "cpu":
        with wp.ScopedCapture(device=device) as capture:
            launch()
        graph = capture.graph

    def act() -> None:
        tape.zero()
        if graph is None:
            launch()
        else:
            wp.capture_launch(graph)

    arrays = [one for state in states for one in (state.particle_q, state.particle_qd, state.particle_f)]
    memory = 2.0 * sum(one.size * 12 for one in arrays) + 8.0 * body.system.connection_count
    return act, lambda: states[0].particle_q.grad.numpy().astype(np.float64), memory


def of_taichi(body: Body, device: str) -> Run:
    """Return Taichi's run: DiffTaichi's structure, with fields by step."""
    ti = importlib.import_module("taichi")
    ti.init(arch=ti.cpu if device == "cpu" else ti.cuda, log_level=ti.ERROR, device_memory_fraction=0.7)
    system, n, c = body.system, body.system.particle_count, body.system.connection_count
    x, v, f = (ti.Vector.field(3, ti.f32, shape=(STEPS + 1, n), needs_grad=True) for _ in range(3))
    stiffness, loss = ti.field(ti.f32, shape=c, needs_grad=True), ti.field(ti.f32, shape=(), needs_grad=True)
    rest, pairs = ti.field(ti.f32, shape=c), ti.Vector.field(2, ti.i32, shape=c)
    weight, inverse_mass = ti.Vector.field(3, ti.f32, shape=n), ti.field(ti.f32, shape=n)
    start, at_rest = ti.Vector.field(3, ti.f32, shape=n), ti.Vector.field(3, ti.f32, shape=n)
    given = {rest: system.rest_length, stiffness: system.stiffness, weight: weights(body), start: system.position}
    given |= {inverse_mass: 1 / system.mass, at_rest: system.velocity}
    for field, values in given.items():
        field.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
    pairs.from_numpy(np.ascontiguousarray(system.connections))
    h, gravity, damping = float(body.step), float(body.gravity), float(system.damping[0])

    @ti.kernel
    def pull(t: ti.i32):
        for k in range(c):
            i, j = pairs[k][0], pairs[k][1]
            dx, dv = x[t, i] - x[t, j], v[t, i] - v[t, j]
            length = dx.norm()
            axis = dx / length
            force = -(stiffness[k] * (length - rest[k]) + damping * dv.dot(axis)) * axis
            f[t, i] += force
            f[t, j] -= force

    @ti.kernel
    def advance(t: ti.i32):
        for p in range(n):
            v[t + 1, p] = v[t, p] + h * (inverse_mass[p] * f[t, p] - ti.Vector([0.0, 0.0, gravity]))
            x[t + 1, p] = x[t, p] + h * v[t + 1, p]

    @ti.kernel
    def sum_up():
        for p in range(n):
            loss[None] += x[STEPS, p].dot(weight[p])

    @ti.kernel
    def begin():
        for p in range(n):
            x[0, p], v[0, p] = start[p], at_rest[p]
        for t, p in f:
            f[t, p] = ti.Vector([0.0, 0.0, 0.0])

    def act() -> None:
        begin()
        with ti.ad.Tape(loss=loss):
            for t in range(STEPS):
                pull(t)
                advance(t)
            sum_up()
        ti.sync()

    memory = 2.0 * 3 * (STEPS + 1) * n * 12 + 8.0 * c
    return act, lambda: x.grad.to_numpy()[0].astype(np.float64), memory


CODES = {"msdwarp": of_msdwarp, "newton": of_newton, "Taichi": of_taichi}


def measure(name: str, body: Body, exact: NDArray, device: str, repeats: int) -> dict[str, Any]:
    """Return a code's row."""
    row = {"n": body.shape[0], "code": name, "milliseconds": np.nan, "memory_mb": np.nan, "difference": np.nan}
    row["note"] = ""
    try:
        act, read, memory = CODES[name](body, device)
        act()
        taken = []
        for _ in range(repeats):
            begun = time.perf_counter()
            act()
            if name != "Taichi":  # it waits by itself, and leaves Warp's context
                wp.synchronize_device(device)
            taken.append(time.perf_counter() - begun)
        difference = np.linalg.norm(read() - exact) / np.linalg.norm(exact)
        row |= {"milliseconds": 1e3 * np.median(taken), "memory_mb": memory / 2**20, "difference": difference}
    except Exception as error:  # a peer that is not installed, or has no room, has a row that says so
        row["note"] = f"{type(error).__name__}: {error}"[:80]
    return row


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "peers_gradient.csv"
    if not options.plot_only:
        rows, exact = [], {}
        sizes = SIZES[:1] if options.quick else SIZES if options.device != "cpu" else SIZES[:2]
        for n in sizes:
            act, exact[n], _ = of_msdwarp(body_of(n), options.device, "float64")
            act()
            exact[n] = exact[n]()
        line = machine(options.device)
        for name in CODES:  # Taichi is the last: it takes the device's context from Warp
            for n in sizes:
                rows.append(measure(name, body_of(n), exact[n], options.device, 1 if options.quick else REPEATS))
                write_csv(path, sorted(rows, key=lambda row: row["n"]), line)
    _, rows = read_csv(path)
    table(f"Value and gradient of {STEPS} steps", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    sys.exit(main())
