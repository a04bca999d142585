"""A minute of every scene whose bodies touch: whether it holds and rests, how deep they overlap, what crosses.

    python -m benchmarks.accuracy.touching [--device D] [--quick] [--stiffness 1 100] [--minutes M] [--only tower]

writes results/<device>/touching.csv, a row as soon as it is there; those of scenes and stiffnesses that are not
run again stay. Springs are as many times as stiff as --stiffness says, and so are contacts; substeps are
automatic. A scene that takes longer than --minutes is ended there: `seconds` says how far it came. With
--crossings every 10th frame is looked at for surfaces that cross, as in `benchmarks.accuracy.crossings`.
"""

import argparse
import time
import warnings
from dataclasses import replace

import numpy as np

from msdwarp import Contact, Scene, Simulation, SimulationDiverged
from msdwarp.engine.collision.body_contact import BodyContact
from msdwarp.scenes import bowl, cloth, cradle, curtain, dice, mattress, pile, tower, trampoline

from ..common import arguments, machine, read_csv, table, write_csv
from .crossings import Oracle

SECONDS, LATE = 60.0, 5
"""How long each scene is simulated, and how long its end is [s]."""
EVERY = 10
"""Every how many frames crossings are looked for."""
SCENES = {
    "tower": tower,
    "trampoline": trampoline,
    "cradle": cradle,
    "pile": pile,
    "curtain": curtain,
    "dice": dice,
    "cloth": cloth,
    "bowl": bowl,
    "mattress": mattress,
}


def built(name: str, stiffer: float) -> Scene:
    """Return a scene with springs, and contacts whose stiffness it gives, so many times as stiff."""
    scene = SCENES[name].build()
    contact = (
        scene.contact if scene.contact is not None else Contact(self_contact=True, restitution=0.1, friction=0.3)
    )
    assert isinstance(contact, Contact)
    if contact.stiffness is not None:
        contact = replace(contact, stiffness=stiffer * contact.stiffness)
    return replace(scene, system=scene.system.replace(stiffness=stiffer * scene.system.stiffness), contact=contact)


def endure(name: str, stiffer: float, device: str, seconds: float, minutes: float, crossings: bool) -> dict:
    """Simulate a scene and say what became of it."""
    simulation = Simulation.from_scene(built(name, stiffer), device=device)
    contacts = next(effect for effect in simulation.assembly.all if isinstance(effect, BodyContact))
    least, system = simulation.substeps, simulation.system
    simulation.step()  # compiles
    second = round(simulation.fps)
    began, done, held = time.perf_counter(), 0, True
    energy, kinetic, strain, deepest = [simulation.measure().energy], [], [], []
    oracle, crossing, furthest = Oracle(system) if crossings else None, 0, 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            while done < seconds and time.perf_counter() - began < 60 * minutes:
                overlap = 0.0
                for frame in range(second):
                    simulation.step()
                    overlap = max(overlap, contacts.deepest)
                    furthest = max(furthest, float(contacts.held_back.max()))
                    if oracle is not None and frame % EVERY == 0:
                        crossing += oracle.crosses(simulation.frame().position)
                now = simulation.measure()
                energy.append(now.energy)
                kinetic.append(now.kinetic_energy)
                strain.append(now.largest_strain)
                deepest.append(overlap)
                done += 1
        except SimulationDiverged:
            held = False
    wall = time.perf_counter() - began
    lowest = np.minimum.accumulate(energy)
    free = ~system.pinned
    mass = np.broadcast_to(system.mass, system.particle_count)[free].sum()
    return {
        "scene": name,
        "stiffer": stiffer,
        "held": int(held),
        "seconds": float(done),
        "times_real_time": done / wall,
        "substeps": least,
        "most_substeps": max(count for _, count in simulation.substep_history),
        "energy_start_J": energy[0],
        "energy_end_J": energy[-1],
        "energy_gained_J": float(np.max(energy - lowest)),
        "kinetic_late_J": max(kinetic[-LATE:], default=float("nan")),
        "speed_late_m_s": float(np.sqrt(2 * max(kinetic[-LATE:], default=float("nan")) / mass)),
        "deepest_m": max(deepest, default=float("nan")),
        "deepest_late_m": max(deepest[-LATE:], default=float("nan")),
        "spacing_m": float(np.median(system.original_length)),
        "largest_strain": max(strain, default=float("nan")),
        "late_strain": max(strain[-LATE:], default=float("nan")),
        "held_back_m": furthest,
        "crossing": float("nan") if oracle is None else crossing,
    }


def main() -> None:
    """Measure, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--stiffness", type=float, nargs="+", default=[1.0, 100.0], help="how many times as stiff")
    own.add_argument("--minutes", type=float, default=60.0, help="of computing, for each scene")
    own.add_argument("--crossings", action="store_true", help="look for surfaces that cross, by ipctk")
    own.add_argument("--only", nargs="+", choices=list(SCENES), default=list(SCENES), help="scenes")
    options = arguments(__doc__.splitlines()[0], own)
    path = options.folder / "touching.csv"
    if not options.plot_only:
        seconds = 1.0 if options.quick else SECONDS
        rows = read_csv(path)[1] if path.exists() else []
        for stiffer in options.stiffness:
            for name in options.only:
                found = endure(name, stiffer, options.device, seconds, options.minutes, options.crossings)
                rows = [row for row in rows if (row["scene"], row["stiffer"]) != (name, stiffer)] + [found]
                write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ("scene", "stiffer", "held", "seconds", "substeps", "energy_gained_J", "speed_late_m_s")
    columns += ("deepest_m", "deepest_late_m", "largest_strain", "held_back_m", "crossing")
    table(f"{SECONDS:g} s of scenes that touch", list(columns), [[row[name] for name in columns] for row in rows])


if __name__ == "__main__":
    main()
