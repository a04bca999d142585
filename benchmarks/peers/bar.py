"""The same elastic bar in msdwarp, newton and MuJoCo: the error of its first period, and the time it takes.

    python -m benchmarks.peers.bar [--device D] [--quick]

A bar of 1.2 × 0.2 × 0.2 m (E = 100 kPa, ρ = 1000 kg/m³, ν = 0.25 and 0.45) is clamped at one end and given small
velocities in the shape of its first bending mode. Its period, from the times at which the tip passes its place of
rest, is compared with finite elements (scikit-fem, hexahedra of second order, consistent mass). Every code has as
many cells across as the row says, no damping, and the longest step at which the period is that of half the step to
1 %, found by halving; time is that of a simulated second at it. msdwarp takes its own automatic step.

newton has tetrahedra of a neo-Hookean solid, explicit (SolverSemiImplicit) and implicit (SolverVBD, 10 iterations,
which damps by itself); MuJoCo's flex has tetrahedra of a St. Venant-Kirchhoff solid. Linear tetrahedra are stiff
where they bend. newton runs on the same device as msdwarp, on a GPU in CUDA graphs; MuJoCo always on a CPU.
"""

import importlib
import importlib.metadata
import math
import sys
import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from msdwarp import Leapfrog, Material, Simulation, box

from ..common import arguments, machine, read_csv, table, write_csv

HEIGHT, SLENDERNESS, MODULUS, DENSITY = 0.2, 6, 1e5, 1000.0
SPEED = 0.02
"""Speed of the tip at first [m/s]: small, so that all is linear."""
RATIOS, ACROSS = (0.25, 0.45), (2, 4, 8, 12)
RECORDED = 20
"""Steps of newton that are recorded in one CUDA graph."""
COLUMNS = ["code", "ratio", "across", "particles", "step_us", "error", "seconds", "note"]
FPS = 60.0
"""Frames a second of msdwarp."""
LONGEST = 15.0
"""Seconds of work after which a code's trial ends."""
Run = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times [s], and the tip's height there [m]."""


@cache
def reference(ratio: float) -> float:
    """Return the period of the bar's first bending mode [s], by finite elements."""
    from scipy.sparse.linalg import eigsh
    from skfem import Basis, BilinearForm, ElementHex2, ElementVector, MeshHex, condense
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    @BilinearForm
    def inertia(u, v, _):
        return DENSITY * sum(u[k] * v[k] for k in range(3))

    along, across = np.linspace(0, SLENDERNESS * HEIGHT, 19), np.linspace(-HEIGHT / 2, HEIGHT / 2, 4)
    basis = Basis(MeshHex.init_tensor(along, across, across), ElementVector(ElementHex2()))
    stiffness = BilinearForm(linear_elasticity(*lame_parameters(MODULUS, ratio))).assemble(basis)
    clamped = basis.get_dofs(lambda x: np.isclose(x[0], 0.0)).all()
    k, m = (condense(one, D=clamped, expand=False) for one in (stiffness, inertia.assemble(basis)))
    return 2 * math.pi / math.sqrt(eigsh(k.tocsc(), k=1, M=m.tocsc(), sigma=0.0, return_eigenvectors=False)[0])


def mode(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shape of the first bending mode of a clamped beam at x/L, 1 at the tip."""
    b, s = 1.87510407, 0.73409551
    return (np.cosh(b * x) - np.cos(b * x) - s * (np.sinh(b * x) - np.sin(b * x))) / 2


def period(run: Run) -> float:
    """Return the time of the second return to the place of rest [s]; NaN if there is none."""
    t, z = run
    k = np.flatnonzero(z[:-1] * z[1:] < 0)
    k = k[k > 0][:2]
    if len(k) < 2 or not np.isfinite(z).all() or np.abs(z).max() > 2 * SPEED * reference(0.25):
        return math.nan
    return float((t[k] - z[k] * (t[k + 1] - t[k]) / (z[k + 1] - z[k]))[1])


def nodes(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return the places of particles, x fastest, their first velocities, and the one in the middle of the tip."""
    a = HEIGHT / n
    z, y, x = np.meshgrid(*(a * np.arange(m + 1) for m in (n, n, SLENDERNESS * n)), indexing="ij")
    place = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    velocity = np.zeros_like(place)
    velocity[:, 2] = SPEED * mode(place[:, 0] / (SLENDERNESS * HEIGHT))
    middle = place - [SLENDERNESS * HEIGHT, HEIGHT / 2, HEIGHT / 2]
    return place, velocity, int(np.argmin((middle**2).sum(axis=1)))


def of_msdwarp(ratio: float, n: int, device: str, span: float) -> tuple[float, Run, float, str]:
    """Return the step [s], the motion, the seconds of a simulated second, and a note."""
    bar = box((SLENDERNESS * n + 1, n + 1, n + 1), HEIGHT / n, material=Material(DENSITY, MODULUS, 0.0, ratio))
    x = bar.position - bar.position.min(axis=0)
    velocity = np.zeros_like(x)
    velocity[:, 2] = SPEED * mode(x[:, 0] / (SLENDERNESS * HEIGHT))
    tip = int(np.argmin(((x - [SLENDERNESS * HEIGHT, HEIGHT / 2, HEIGHT / 2]) ** 2).sum(axis=1)))
    bar = bar.with_velocity(velocity).pin(x[:, 0] < HEIGHT / n / 2)
    simulation = Simulation(bar, gravity=0.0, fps=FPS, integrator=Leapfrog(), device=device)
    simulation.step()
    simulation.reset()
    begun, heights = time.perf_counter(), [0.0]
    frames = math.ceil(span * FPS)
    for _ in range(frames):
        simulation.step()
        heights.append(float(simulation.frame().position[tip, 2] - bar.position[tip, 2]))
    took = time.perf_counter() - begun
    step = 1 / (FPS * simulation.substeps)
    motion = np.arange(frames + 1) / FPS, np.array(heights)
    return step, motion, took / (frames / FPS), "leapfrog, springs and cells"


def of_newton(solver: str, ratio: float, n: int, device: str, span: float) -> tuple[float, Run, float, str]:
    """Return the same of newton, for the longest step that stays bounded."""
    newton = importlib.import_module("newton")
    _place, velocity, tip = nodes(n)
    shear, lame = MODULUS / (2 * (1 + ratio)), MODULUS * ratio / ((1 + ratio) * (1 - 2 * ratio))
    if solver == "SolverSemiImplicit":  # its numbers are not Lamé's (Smith et al., ACM ToG 37 (2018) 12, sec. 3.4)
        shear, lame = 4 / 3 * shear, lame + 5 / 6 * shear
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    size = {"dim_x": SLENDERNESS * n, "dim_y": n, "dim_z": n}
    cell = dict.fromkeys(("cell_x", "cell_y", "cell_z"), HEIGHT / n)
    builder.add_soft_grid(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        density=DENSITY,
        k_mu=shear,
        k_lambda=lame,
        k_damp=0.0,
        fix_left=True,
        particle_radius=0.0,  # no contact between particles
        **size,
        **cell,
    )
    if solver == "SolverVBD":
        builder.color()
    model = builder.finalize(device=device)
    x = model.particle_q.numpy()
    order = np.lexsort((x[:, 0].round(5), x[:, 1].round(5), x[:, 2].round(5)))
    first = np.zeros_like(x)
    first[order] = velocity
    # Each particle of newton's grid has the mass of a cell: give those on the surface what belongs to them.
    on_side = np.isclose(x, x.min(axis=0), atol=1e-5) | np.isclose(x, x.max(axis=0), atol=1e-5)
    model.particle_mass.assign(model.particle_mass.numpy() / 2.0 ** on_side.sum(axis=1))
    model.particle_inv_mass.assign(model.particle_inv_mass.numpy() * 2.0 ** on_side.sum(axis=1))
    tip = int(order[tip])
    made = getattr(newton.solvers, solver)
    stepper = made(model, iterations=10) if solver == "SolverVBD" else made(model)

    def simulate(steps: int) -> tuple[Run, float]:
        states, dt = [model.state(), model.state()], span / steps
        states[0].particle_qd.assign(first)
        control, heights, each = model.control(), [0.0], min(RECORDED, steps // 8)  # an even number

        def advance() -> None:
            for _ in range(each):
                states[0].clear_forces()
                stepper.step(states[0], states[1], control, None, dt)
                states.reverse()

        advance()  # compiles
        states[0].particle_q.assign(x)
        states[0].particle_qd.assign(first)
        go: Callable[[], object] = advance
        if wp.get_device(device).is_cuda:
            with wp.ScopedCapture(device) as capture:
                advance()
            go = partial(wp.capture_launch, capture.graph)
        parts, every = math.ceil(steps / each), max(1, steps // each // 200)
        wp.synchronize()
        begun = time.perf_counter()
        for k in range(parts):
            go()
            if (k + 1) % every == 0:
                heights.append(float(states[0].particle_q.numpy()[tip, 2] - x[tip, 2]))
                if not abs(heights[-1]) < 10 or time.perf_counter() - begun > LONGEST:
                    break
        took = (time.perf_counter() - begun) / (dt * each * (k + 1))
        return (dt * each * every * np.arange(len(heights)), np.array(heights)), took

    note = f"newton {newton.__version__}, {solver}, neo-Hookean tetrahedra"
    return *longest_step(simulate, span), note


def of_mujoco(ratio: float, n: int, _device: str, span: float) -> tuple[float, Run, float, str]:
    """Return the same of MuJoCo's flex."""
    mujoco = importlib.import_module("mujoco")
    a = HEIGHT / n
    counts = SLENDERNESS * n + 1, n + 1, n + 1
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option gravity="0 0 0" integrator="Euler"/>
          <size memory="1G"/>
          <worldbody>
            <flexcomp name="bar" type="grid" dim="3" count="{" ".join(map(str, counts))}" spacing="{a} {a} {a}"
                      mass="{DENSITY * SLENDERNESS * HEIGHT**3}" radius="0.001">
              <edge equality="false"/>
              <elasticity young="{MODULUS}" poisson="{ratio}" damping="0"/>
              <contact selfcollide="none" contype="0" conaffinity="0"/>
              <pin gridrange="0 0 0 0 {n} {n}"/>
            </flexcomp>
          </worldbody>
        </mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x = data.flexvert_xpos.copy()
    x0 = x - x.min(axis=0)
    tip = int(np.argmin(((x0 - [SLENDERNESS * HEIGHT, HEIGHT / 2, HEIGHT / 2]) ** 2).sum(axis=1)))
    speed = SPEED * mode(x0[:, 0] / (SLENDERNESS * HEIGHT))
    of_body = {int(model.flex_vertbodyid[k]): k for k in range(len(x))}

    def simulate(steps: int) -> tuple[Run, float]:
        mujoco.mj_resetData(model, data)
        model.opt.timestep = span / steps
        for body, vertex in of_body.items():
            if model.body_dofnum[body] == 3:
                data.qvel[model.body_dofadr[body] + 2] = speed[vertex]
        heights, every, begun = [0.0], max(1, steps // 200), time.perf_counter()
        for k in range(steps):
            mujoco.mj_step(model, data)
            if (k + 1) % every == 0:
                heights.append(float(data.flexvert_xpos[tip, 2] - x[tip, 2]))
                if not abs(heights[-1]) < 10 or time.perf_counter() - begun > LONGEST:
                    break
        took = (time.perf_counter() - begun) / span * steps / (k + 1)
        return (span / steps * every * np.arange(len(heights)), np.array(heights)), took

    note = f"MuJoCo {importlib.metadata.version('mujoco')} on a CPU, flex"
    return *longest_step(simulate, span), note


def longest_step(simulate: Callable[[int], tuple[Run, float]], span: float) -> tuple[float, Run, float]:
    """Halve the step until the period no longer changes by 1 %; return the step before the last."""
    steps, last = 320, None  # 40, 80, ... times eight
    while steps < 2**17:
        run, seconds = simulate(steps)
        now = period(run)
        if last is not None and abs(now / last[3] - 1) < 0.01:
            return last[:3]
        last = (span / steps, run, seconds, now) if math.isfinite(now) else None
        if seconds * span > LONGEST:
            break
        steps *= 2
    if last is None:
        raise RuntimeError(f"no bounded motion at {steps} steps in {span:.2f} s")
    return last[:3]


CODES: dict[str, Callable[..., tuple[float, Run, float, str]]] = {
    "msdwarp": of_msdwarp,
    "newton, explicit": lambda *given: of_newton("SolverSemiImplicit", *given),
    "newton, VBD": lambda *given: of_newton("SolverVBD", *given),
    "MuJoCo": of_mujoco,
}


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "peers_bar.csv"
    if not options.plot_only:
        rows: list[dict[str, Any]] = []
        for ratio in RATIOS[:1] if options.quick else RATIOS:
            for n in ACROSS[:1] if options.quick else ACROSS:
                wanted = reference(ratio)
                for code, run in CODES.items():
                    row: dict[str, Any] = {"code": code, "ratio": ratio, "across": n}
                    row["particles"] = (SLENDERNESS * n + 1) * (n + 1) ** 2
                    try:
                        step, motion, seconds, note = run(ratio, n, options.device, 1.3 * wanted)
                        row |= {"step_us": 1e6 * step, "error": period(motion) / wanted - 1, "seconds": seconds}
                    except Exception as error:  # it is not installed, or does not run here
                        note = f"{type(error).__name__}: {str(error)[:150]}"
                    rows.append({column: (row | {"note": note}).get(column, "") for column in COLUMNS})
                    print(rows[-1], file=sys.stderr, flush=True)
                    write_csv(path, rows, machine(options.device))
    line, kept = read_csv(path)
    print(line)
    table("The first period of a clamped bar", COLUMNS, [[row[column] for column in COLUMNS] for row in kept])


if __name__ == "__main__":
    sys.exit(main())
