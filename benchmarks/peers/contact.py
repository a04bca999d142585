"""Contact beside newton and MuJoCo Warp: the same spheres, and the same cloth that lies on itself.

    python -m benchmarks.peers.contact [--device D] [--quick]

Spheres: so many of equal size in a cube, each in contact with some six others, at random speeds of 1 m/s. In both
codes a penalty spring with friction keeps them apart, at the same step; newton's SolverSemiImplicit builds a hash
grid and walks it in every step, msdwarp keeps lists. Time is that of a step.

Cloth: a square sheet folded in two, whose layers lie within the distance at which they touch. The codes differ in
nearly all: newton's SolverVBD is implicit, has triangles of an elastic membrane, 10 substeps of 4 iterations a
frame as in its own example of cloth, and meets itself by vertices with triangles and edges with edges. MuJoCo
Warp's flex keeps the lengths of edges and the distance of layers by constraints, which its CG solver iterates on
with the tolerance of its own example, in 10 steps a frame. msdwarp is explicit, has springs, and takes as many
substeps as stability asks for. Time is that of a frame of 1/60 s.

All take turns, round after round, as recorded graphs; times are medians between two synchronisations. Each code
has a process of its own, since an illegal memory access of one ends all that a process has on a GPU.
"""

import importlib
import importlib.metadata
import math
import os
import sys
import time
import warnings
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import warp as wp

from msdwarp import Contact, Simulation, System, sheet

from ..common import arguments, machine, read_csv, table, write_csv

ROUNDS, STEPS = 9, 48
PATIENCE = 300  # s, for a code to compile and begin
RADIUS, MASS, STIFFNESS, STEP = 0.01, 1e-3, 1e3, 1e-4
FRICTION = 0.5
VBD_SUBSTEPS, VBD_ITERATIONS = 10, 4
FLEX_STEPS = 10
COLUMNS = ["case", "code", "particles", "substeps", "ms", "times_msdwarp", "note"]


def spheres(side: int) -> System:
    """Return side³ spheres of radius RADIUS, on a jittered grid on which neighbours overlap a little."""
    random = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    position = 1.994 * RADIUS * grid + random.uniform(-0.002, 0.002, (len(grid), 3)) * RADIUS
    velocity = random.uniform(-1, 1, position.shape)
    nothing = np.zeros((0, 2), dtype=int)
    return System(position=position, connections=nothing, mass=MASS, velocity=velocity)


def folded(side: int) -> tuple[System, float]:
    """Return a sheet of side² particles, folded in two, and the distance at which its layers touch [m]."""
    spacing = 1.0 / (side - 1)
    thickness = 0.9 * spacing
    one = sheet((side, side), spacing, mass=0.2 / side**2, stiffness=60.0, damping=0.01)
    x = np.array(one.position - one.position.min(axis=0))
    radius = 0.51 * thickness
    along = x[:, 0] - 0.5
    turn = np.clip(along / radius, 0.0, np.pi)
    straight = np.maximum(along - np.pi * radius, 0.0)
    bent = np.where(along < 0, along, radius * np.sin(turn) - straight)
    position = np.stack([bent, x[:, 1], radius * (1 - np.cos(turn))], axis=1)
    velocity = np.random.default_rng(1).uniform(-0.05, 0.05, position.shape)
    return one.replace(position=position, velocity=velocity), thickness


def msdwarp_spheres(system: System, device: str) -> tuple[Callable[[], None], int, str]:
    """Return what takes STEPS steps of the spheres, how many, and a note."""
    contact = Contact(thickness=2 * RADIUS, stiffness=STIFFNESS, friction=FRICTION, restitution=0.9)
    simulation = Simulation(
        system,
        contact=contact,
        gravity=0.0,
        fps=1 / (STEPS * STEP),
        substeps=STEPS,
        allow_unstable=True,
        energy_limit=np.inf,
        device=device,
    )
    return simulation.step, STEPS, "lists"


def newton_spheres(system: System, device: str) -> tuple[Callable[[], None], int, str]:
    """Return the same of newton's SolverSemiImplicit."""
    newton = importlib.import_module("newton")
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    n = system.particle_count
    builder.particle_q = system.position.astype(np.float32)
    builder.particle_qd = system.velocity.astype(np.float32)
    builder.particle_mass = np.full(n, MASS, np.float32)
    builder.particle_radius = np.full(n, RADIUS, np.float32)
    builder.particle_flags = np.full(n, int(newton.ParticleFlags.ACTIVE), np.int32)
    builder.particle_world = np.full(n, -1, np.int32)
    model = builder.finalize(device=device)
    model.particle_ke, model.particle_kd, model.particle_kf = STIFFNESS, 0.05, 0.05
    model.particle_mu, model.particle_max_radius = FRICTION, RADIUS
    solver = newton.solvers.SolverSemiImplicit(model)
    states = [model.state(), model.state()]

    def steps(count: int) -> None:
        for _ in range(count):
            states[0].clear_forces()
            solver.step(states[0], states[1], None, None, STEP)
            states.reverse()

    return recorded(steps, STEPS, device), STEPS, f"newton {newton.__version__}, SolverSemiImplicit"


def msdwarp_cloth(case: tuple[System, float], device: str) -> tuple[Callable[[], None], int, str]:
    """Return what takes a frame of the cloth, in how many substeps, and a note."""
    system, thickness = case
    contact = Contact(self_contact=True, thickness=thickness, friction=0.2)
    simulation = Simulation(system, contact=contact, gravity=0.0, fps=60.0, device=device)
    return simulation.step, simulation.substeps, "explicit, springs"


def newton_cloth(case: tuple[System, float], device: str) -> tuple[Callable[[], None], int, str]:
    """Return the same of newton's SolverVBD."""
    newton = importlib.import_module("newton")
    system, thickness = case
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    surface = system.surface
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vertices=[wp.vec3(*x) for x in system.position.tolist()],
        indices=surface.particle[surface.triangles].ravel().tolist(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        density=0.2,
        tri_ke=1e3,
        tri_ka=1e3,
        tri_kd=2e-4,
        edge_ke=1e-3,
        edge_kd=1e-2,
    )
    builder.color()
    model = builder.finalize(device=device)
    model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e3, 0.1, 0.2
    solver = newton.solvers.SolverVBD(
        model,
        iterations=VBD_ITERATIONS,
        particle_enable_self_contact=True,
        particle_self_contact_margin=thickness,
        particle_self_contact_gap=0.75 * thickness,
        particle_vertex_contact_buffer_size=64,
        particle_edge_contact_buffer_size=128,
    )
    states = [model.state(), model.state()]
    states[0].particle_qd.assign(system.velocity.astype(np.float32))
    control = model.control()

    def steps(count: int) -> None:
        solver.rebuild_bvh(states[0])
        for _ in range(count):
            states[0].clear_forces()
            solver.step(states[0], states[1], control, None, 1 / 60 / VBD_SUBSTEPS)
            states.reverse()

    note = f"newton {newton.__version__}, SolverVBD, {VBD_ITERATIONS} iterations"
    return recorded(steps, VBD_SUBSTEPS, device), VBD_SUBSTEPS, note


def mujoco_cloth(case: tuple[System, float], device: str) -> tuple[Callable[[], None], int, str]:
    """Return the same of MuJoCo Warp's flex."""
    mujoco, mjw = importlib.import_module("mujoco"), importlib.import_module("mujoco_warp")
    system, thickness = case
    surface = system.surface
    points = " ".join(f"{x:.7g}" for x in system.position.ravel())
    triangles = " ".join(map(str, surface.particle[surface.triangles].ravel()))
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{1 / 60 / FLEX_STEPS}" gravity="0 0 0" solver="CG" tolerance="1e-6" jacobian="sparse"/>
          <worldbody>
            <flexcomp name="cloth" type="direct" dim="2" mass="0.2" radius="{thickness / 2}"
                      point="{points}" element="{triangles}">
              <contact selfcollide="auto" friction="0.2"/>
              <edge equality="true"/>
            </flexcomp>
          </worldbody>
        </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:] = system.velocity.ravel()
    mujoco.mj_forward(model, data)
    with wp.ScopedDevice(device):
        there = mjw.put_model(model)
        there.opt.warn_overflow = 0  # it says in each step that it has not converged
        state = mjw.put_data(model, data, nconmax=2 * data.ncon + 1000, njmax=2 * data.nefc + 4000)

    def steps(count: int) -> None:
        with wp.ScopedDevice(device):
            for _ in range(count):
                mjw.step(there, state)

    note = f"MuJoCo Warp {importlib.metadata.version('mujoco-warp')}, CG"
    advance = recorded(steps, FLEX_STEPS, device)
    contacts, rows = int(state.nacon.numpy()[0]), int(state.nefc.numpy().max())
    return advance, FLEX_STEPS, f"{note}, {contacts} contacts, {rows} constraints; MuJoCo on a CPU has {data.ncon}"


def recorded(steps: Callable[[int], None], count: int, device: str) -> Callable[[], None]:
    """Return what takes so many steps: by a graph that is recorded now where there is CUDA, and it can be."""
    steps(2)  # compiles
    if device == "cpu":
        return lambda: steps(count)
    try:
        with wp.ScopedCapture(device=device) as capture:
            steps(count)
        wp.capture_launch(capture.graph)
    except RuntimeError:  # newton's grid of 64³ spheres makes none
        return lambda: steps(count)
    return lambda: wp.capture_launch(capture.graph)


CASE: dict[str, Callable[[int], Any]] = {"spheres": spheres, "cloth": folded}
MAKE: dict[str, dict[str, Callable]] = {
    "spheres": {"msdwarp": msdwarp_spheres, "newton": newton_spheres},
    "cloth": {"msdwarp": msdwarp_cloth, "newton": newton_cloth, "mujoco": mujoco_cloth},
}


def serve(line: Connection, kind: str, side: int, code: str, device: str) -> None:
    """Make a case ready in this process, tell how many substeps it takes and a note, then time it when asked."""
    warnings.simplefilter("ignore")
    try:
        advance, substeps, note = MAKE[kind][code](CASE[kind](side), device)
        for _ in range(3):
            advance()
        wp.synchronize_device(device)
        line.send((substeps, note))
        while line.recv():
            start = time.perf_counter()
            advance()
            wp.synchronize_device(device)
            line.send(time.perf_counter() - start)
    except Exception as error:  # it is not installed, or does not run here
        line.send(f"{type(error).__name__}: {error}")
        os._exit(1)  # what failed on a GPU may hang on its way out


def measure_case(kind: str, side: int, device: str) -> list[dict]:
    """Return the rows of a case, whose codes take turns, each in a process of its own."""
    name = f"{kind} {side}{'³' if kind == 'spheres' else '²'}"
    particles = side**3 if kind == "spheres" else side**2
    spawn = get_context("spawn")
    lines, ready, failed = {}, {}, {}
    for code in MAKE[kind]:
        lines[code], there = spawn.Pipe()
        process = spawn.Process(target=serve, args=(there, kind, side, code, device), daemon=True)
        start = time.perf_counter()
        process.start()
        there.close()
        try:
            ready[code] = ask(lines[code])
        except RuntimeError as error:
            failed[code] = str(error)
            process.kill()
        state = failed.get(code, "is ready")
        print(f"{name}: {code} {state} after {time.perf_counter() - start:.0f} s", file=sys.stderr)
    seconds: dict[str, list[float]] = {code: [] for code in ready}
    for k in range(ROUNDS):
        for code in list(ready)[:: 1 if k % 2 else -1]:
            try:
                lines[code].send(True)
                seconds[code].append(ask(lines[code]))
            except (RuntimeError, OSError) as error:
                failed[code] = str(error)
                del ready[code]
    rows = [{"case": name, "code": code, "note": note} for code, note in failed.items()]
    for code, (substeps, note) in ready.items():
        lines[code].send(False)
        ratios = [a / b for a, b in zip(seconds[code], seconds.get("msdwarp", []), strict=False)]
        rows.append(
            {
                "case": name,
                "code": code,
                "particles": particles,
                "substeps": substeps,
                "ms": 1e3 * median(seconds[code]) / (substeps if kind == "spheres" else 1),
                "times_msdwarp": median(ratios or [math.nan]),
                "note": note,
            }
        )
    return [{column: row.get(column, "") for column in COLUMNS} for row in rows]


def ask(line: Connection) -> Any:
    """Return what a code's process says next; raise ``RuntimeError`` if it has failed or is too slow."""
    if not line.poll(PATIENCE):
        raise RuntimeError(f"no answer in {PATIENCE} s")
    try:
        answer = line.recv()
    except EOFError:
        raise RuntimeError("its process ended") from None
    if isinstance(answer, str):
        raise RuntimeError(answer.splitlines()[0][:150])
    return answer


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path: Path = options.folder / "peers_contact.csv"
    if not options.plot_only:
        rows: list[dict] = []
        cases = [("spheres", 8), ("cloth", 16)]
        if not options.quick:
            on_gpu = wp.get_device(options.device).is_cuda
            cases = [("spheres", 16), ("cloth", 32)]
            if on_gpu:
                cases = [("spheres", 32), ("cloth", 64), ("cloth", 256), ("spheres", 64)]
        for kind, side in cases:
            rows += measure_case(kind, side, options.device)
            write_csv(path, rows, machine(options.device))
    line, kept = read_csv(path)
    print(line)
    table("Contact beside newton and MuJoCo Warp", COLUMNS, [[row[column] for column in COLUMNS] for row in kept])


if __name__ == "__main__":
    sys.exit(main())
