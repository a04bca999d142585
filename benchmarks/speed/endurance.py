"""Half a minute of every scene with automatic substeps: does it hold, how fast, how quiet is it at the end.

    python -m benchmarks.speed.endurance [--device D] [--quick] [--stiffer 100]

writes results/<device>/endurance.csv. With --stiffer all springs are so many times as stiff, each scene runs a
minute, and nothing is written.
"""

import argparse
import time
from dataclasses import replace
from types import ModuleType

import numpy as np

from msdwarp import Simulation, SimulationDiverged

from ..common import arguments, machine, read_csv, scene_scripts, table, write_csv

SECONDS = 30.0


def endure(name: str, script: ModuleType, device: str, seconds: float, stiffer: float = 1.0) -> dict:
    """Simulate a scene and say what became of it."""
    scene = script.build()
    if stiffer != 1.0:
        scene = replace(scene, system=scene.system.replace(stiffness=stiffer * scene.system.stiffness))
    simulation = Simulation.from_scene(scene, device=device)
    least = simulation.substeps
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
        "force_algorithm": simulation.model.force_algorithm,
        "substeps": least,
        "most_substeps": max(count for _, count in simulation.substep_history),
        "held_s": float(held),
        "times_real_time": seconds / wall,
        "end_speed_m_s": float(np.sqrt((frame.velocity**2).sum(axis=1)).max()),
        "end_strain": measured.largest_strain,
    }


def main() -> None:
    """Measure, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--stiffer", type=float, default=1.0, help="how many times as stiff springs are")
    options = arguments(__doc__.splitlines()[0], own)
    if options.stiffer != 1.0:
        found = [endure(n, s, options.device, 2 * SECONDS, options.stiffer) for n, s in scene_scripts().items()]
        table(f"{2 * SECONDS:g} s, stiffer", list(found[0]), [list(row.values()) for row in found])
        return
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
