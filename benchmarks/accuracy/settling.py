"""How much faster than waiting does `Simulation.settle` find an equilibrium? And how exactly.

    python -m benchmarks.accuracy.settling [--device D] [--quick] [--plot-only]

settling.csv has a row for each body:

- `sag`: the longest way of a particle from the start to the equilibrium [m], which is found with a tolerance of a
  thousandth of the usual one.
- `substeps`, `seconds`, `error`: of `settle()` with its usual tolerance, and how far from the equilibrium a
  particle is afterwards at most, over the sag.
- `waiting_time`, `waiting_substeps`, `waiting_seconds`: of a simulation from the same start, until no particle was
  further than 1 % of the sag from the equilibrium for a second, or a minute of simulated time; `waiting_error` is
  the largest error in the last second.
"""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from msdwarp import Material, Scene, Simulation, System, box, chain, sheet
from msdwarp.scenes import bridge

from ..common import arguments, machine, read_csv, table, write_csv

NEAR = 0.01
"""Share of the sag within which a body has come to rest."""
LONGEST = 60.0
"""Simulated time [s] after which nobody waits any more."""
SECOND = 60
"""Frames."""


def held(system: System, where: Any) -> System:
    """Return a system with some particles pinned."""
    return system.pin(np.flatnonzero(where))


def bodies() -> dict[str, Scene]:
    """Return the bodies, as scenes."""
    rubber = Material(density=1000.0, youngs_modulus=1e6, damping_ratio=0.05)
    beam, soft = (box((25, 5, 5), 0.05, material=one) for one in (rubber, replace(rubber, poissons_ratio=0.45)))
    cloth = sheet((31, 31), 0.04, mass=0.002, stiffness=60.0, damping=0.02)
    rope = chain(101, 0.02, mass=0.002, stiffness=5e3, damping=0.05)
    rim = (np.abs(cloth.position[:, :2]) > 0.59).any(axis=1)
    return {
        "cantilever": Scene(system=held(beam, beam.position[:, 0] < -0.59)),
        "cantilever, ν 0.45": Scene(system=held(soft, soft.position[:, 0] < -0.59)),
        "cloth held at its rim": Scene(system=held(cloth, rim)),
        "rope": Scene(system=rope.pin([0, 100])),
        "bridge": replace(bridge.build(), loads=()),
    }


def measure(name: str, scene: Scene, device: str) -> dict[str, Any]:
    """Settle a body, and wait for it."""
    exact = Simulation.from_scene(scene, device=device, precision="float64")
    usual = exact.settle().tolerance
    exact.settle(1e-3 * usual)
    rest, start = exact.frame().position, np.array(scene.system.position)
    sag = float(np.linalg.norm(rest - start, axis=1).max())

    def error(simulation: Simulation) -> float:
        return float(np.linalg.norm(simulation.frame().position - rest, axis=1).max()) / sag

    simulation = Simulation.from_scene(scene, device=device)
    begun = time.perf_counter()
    found = simulation.settle()
    row: dict[str, Any] = {"body": name, "particles": scene.system.particle_count, "sag": sag}
    row |= {"substeps": found.substeps, "seconds": time.perf_counter() - begun, "error": error(simulation)}
    waiting = Simulation.from_scene(scene, device=device)
    waiting.step()  # compiles
    begun, substeps, errors = time.perf_counter(), 0, [1.0]
    while waiting.time < LONGEST and max(errors[-SECOND:]) > NEAR:
        waiting.step()
        substeps += waiting.substeps
        errors.append(error(waiting))
    row |= {"waiting_time": waiting.time, "waiting_substeps": substeps}
    return row | {"waiting_seconds": time.perf_counter() - begun, "waiting_error": max(errors[-SECOND:])}


def main() -> None:
    """Measure, write and print."""
    options = arguments("How much faster than waiting is an equilibrium found?")
    path = options.folder / "settling.csv"
    if not options.plot_only:
        chosen = list(bodies().items())[: 1 if options.quick else None]
        write_csv(path, [measure(*one, options.device) for one in chosen], machine(options.device))
    _, rows = read_csv(path)
    table(path.name, list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    main()
