"""Half a minute of every scene with automatic substeps: does it hold, how fast, how quiet is it at the end.

Run: python benchmarks/endurance.py [--device cpu] [--quick]
"""

import importlib
import pkgutil
import time

import numpy as np
from common import arguments, machine, table, write_csv

from msdwarp import Simulation, SimulationDiverged, scenes

SECONDS = 30.0


def endure(name: str, device: str, seconds: float) -> dict:
    """Simulate a scene and say what became of it."""
    scene = importlib.import_module(f"{scenes.__name__}.{name}").build()
    simulation = Simulation.of(scene, device=device)
    simulation.step()  # compiles
    frames = round(seconds * simulation.fps) - 1
    began, held = time.perf_counter(), seconds
    try:
        simulation.step(frames)
    except SimulationDiverged as error:
        held = error.time
    wall = time.perf_counter() - began
    frame = simulation.frame()
    measured = simulation.measure()
    return {
        "scene": name,
        "particles": simulation.system.particle_count,
        "connections": simulation.system.connection_count,
        "coordinates": simulation.system.dim,
        "route": simulation.model.route,
        "substeps": simulation.substeps,
        "held_s": float(held),
        "times_real_time": seconds / wall,
        "end_speed_m_s": float(np.sqrt((frame.velocity**2).sum(axis=1)).max()),
        "end_strain": measured.largest_strain,
    }


def main() -> None:
    """Run every scene and write benchmarks/results/<device>/endurance.csv."""
    options = arguments(__doc__.splitlines()[0])
    names = sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))
    seconds = 2.0 if options.quick else SECONDS
    rows = [endure(name, options.device, seconds) for name in names]
    write_csv(options.folder / "endurance.csv", rows, machine(options.device))
    table(f"{seconds:g} s of every scene on {options.device}", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    main()
