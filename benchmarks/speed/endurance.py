"""Half a minute of every scene with automatic substeps: does it hold, how fast, how quiet is it at the end.

    python -m benchmarks.speed.endurance [--device D] [--quick]

writes results/<device>/endurance.csv.
"""

import time
from types import ModuleType

import numpy as np

from msdwarp import Simulation, SimulationDiverged

from ..common import arguments, machine, read_csv, scene_scripts, table, write_csv

SECONDS = 30.0


def endure(name: str, script: ModuleType, device: str, seconds: float) -> dict:
    """Simulate a scene and say what became of it."""
    simulation = Simulation.of(script.build(), device=device)
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
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    seconds = 2.0 if options.quick else SECONDS
    path = options.folder / "endurance.csv"
    if not options.plot_only:
        rows = [endure(name, script, options.device, seconds) for name, script in scene_scripts().items()]
        write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    table(f"{seconds:g} s of every scene on {options.device}", list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    main()
