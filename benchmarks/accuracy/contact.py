"""How much does contact between bodies depend on the step? What does its accuracy cost, in force evaluations.

    python -m benchmarks.accuracy.contact [--device D] [--quick] [--plot-only]

Four questions, each a CSV, and all but energy a chart, in float64:

- Error against cost, contact_work.csv. Pairs of particles that meet at 16 moments of a substep, against the closed
  form; four dice that fly at each other; a die thrown onto a pinned block, where it slides and comes to rest. The
  reference of the last two is leapfrog with steps 4 times finer than the finest plotted, its error taken from
  steps twice as long. Error: RMS distance at the end over the RMS way of the particles. Steps are the automatic
  one and finer ones. Points within 3 times the reference's own error are left out.
- Restitution against the step, contact_restitution.csv: the pairs again, also at steps longer than automatic.
- Energy, contact_energy.csv: of two balls of the scene cradle, where nothing is damped, for two seconds (float32):
  that which the method conserves, and that of `Measures`, with the mean of two velocities.
- Friction against the step, contact_friction.csv: a die on a pinned block at 15° and μ = 0.5, where it should
  hold, and at 35° and μ = 0.3, where it should slide as Coulomb says.
"""

import math
import sys
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msdwarp import Contact, Simulation, System, box
from msdwarp.scenes import cradle

from ..common import METHODS, arguments, machine, read_csv, table, write_csv
from .contact_plots import draw_friction, draw_restitution, draw_work

G, FPS = 9.82, 60.0
PHASES = 16
"""Moments of a substep at which pairs meet."""
CONTACT_METHODS = ("symplectic Euler", "leapfrog", "leapfrog θ=½", "RK4")
FINER = (1, 1.5, 2, 3, 4, 6, 8, 16, 32)
"""Substeps tried, over the automatic ones of each method."""
FINEST = {"dice": 8, "slide": 4}
RESTITUTIONS = (0.2, 0.5, 0.9, 1.0)
RESTITUTION_FINER = (0.25, 0.5, 1, 2, 4, 8)
SLOPES = {"hold": (15.0, 0.5, 5, 60), "slide": (35.0, 0.3, 9, 33)}
"""Angle [°], friction, length of the block below in particles, and frames."""
SLOPE_METHODS = ("symplectic Euler", "leapfrog", "RK4")
SLOPE_FINER = {"symplectic Euler": (1, 2, 4, 8), "leapfrog": (1, 2, 4, 8), "RK4": (1, 2, 4)}
ENERGY_FINER = (1, 2)
CONSTANTS = {"mass": 0.02, "stiffness": 2e4, "damping": 8.0}


class Case(NamedTuple):
    """Bodies that come into contact, and for how long."""

    title: str
    system: System
    contact: Contact
    gravity: tuple[float, float, float]
    frames: int


# --- Two particles, head on ---


def pairs(gaps: NDArray) -> System:
    """Return pairs of particles that come towards each other at 1 m/s each, so far from where they touch [m]."""
    position, velocity = np.zeros((2, 2 * len(gaps), 3))
    position[:, 1] = np.repeat(np.arange(len(gaps)), 2)
    position[1::2, 0] = 0.1 + gaps
    velocity[0::2, 0], velocity[1::2, 0] = 1.0, -1.0
    return System(position=position, velocity=velocity, mass=1.0, connections=np.zeros((0, 2), int))


def touch_of_pairs(restitution: float) -> Contact:
    """Return how pairs touch."""
    return Contact(thickness=0.1, stiffness=1e4, friction=0.0, restitution=restitution)


def apart_after(gaps: NDArray, seconds: float, contact: Contact) -> NDArray:
    """Return how far the particles of each pair are apart after a time [m], shape [pair_count]: the closed form.

    An overlap δ follows δ'' + ω² δ = 0 from δ = 0 for half a period; nothing is damped, as the restitution is 1. A
    pair touches twice, as a point and as a facet of each: ω² = 2k by half the mass of one. See docs/contact.md.
    """
    assert contact.stiffness is not None
    assert contact.thickness is not None
    assert contact.restitution == 1.0
    speed = 2.0
    after = seconds - gaps / speed - math.pi / math.sqrt(4 * contact.stiffness)
    assert (after > 0).all()
    return contact.thickness + speed * after


def bounced(method: str, restitution: float, finer: float, device: str) -> tuple[Simulation, NDArray]:
    """Return a simulation of pairs that have met, and how far they were apart before."""
    contact = touch_of_pairs(restitution)
    options = {"gravity": 0.0, "contact": contact, "precision": "float64", "device": device, "fps": FPS}
    options |= {"integrator": METHODS[method]}
    substeps = max(1, round(finer * Simulation(pairs(np.ones(1)), **options).substeps))
    # Moments are those of the automatic substep, or of a shorter one: distances are small beside the ways.
    gaps = 2.0 / (FPS * substeps) * (np.arange(PHASES) + 0.5) / PHASES
    simulation = Simulation(pairs(gaps), substeps=substeps, allow_unstable=True, energy_limit=math.inf, **options)
    simulation.step(3)
    return simulation, gaps


def measure_restitution(options) -> list[dict]:
    """Return a row for every method, restitution and step."""
    rows = []
    for method in SLOPE_METHODS:
        for restitution in RESTITUTIONS:
            for finer in RESTITUTION_FINER[: 3 if options.quick else None]:
                simulation, _ = bounced(method, restitution, finer, options.device)
                v = simulation.frame().velocity[:, 0]
                found = (v[1::2] - v[0::2]) / 2
                rows.append(
                    {
                        "method": method,
                        "asked": restitution,
                        "finer": finer,
                        "step": 1 / (FPS * simulation.substeps),
                        "least": found.min(),
                        "mean": found.mean(),
                        "most": found.max(),
                    }
                )
    return rows


# --- Error against cost ---


def thrown() -> Case:
    """Return four dice that fly at each other, turning."""
    whole = None
    for k in range(4):
        way = np.array([math.cos(1.6 * k), math.sin(1.6 * k), 0.1 * k])
        die = box((3, 3, 3), 0.1, **CONSTANTS).rotate(0.7 * k + 0.2, axis=(1, k, 2)).translate(0.26 * way)
        die = die.replace(velocity=-1.5 * way + np.cross([0, k - 1.0, 2.0], die.position - 0.26 * way))
        whole = die if whole is None else whole + die
    assert whole is not None
    return Case("Four dice fly at each other", whole, Contact(), (0.0, 0.0, 0.0), 12)


def on_a_block(
    angle: float, friction: float, long: int, frames: int, gap: float = 0.0, speed: float = 0.0
) -> Case:
    """Return a die on, or so far above, a pinned block that leans by an angle [°]."""
    low = box((long, 5, 2), 0.1, **CONSTANTS)
    x = low.position
    low = low.pin(np.flatnonzero(x[:, 2] < x[:, 2].min() + 1e-6))
    die = box((3, 3, 3), 0.1, **CONSTANTS)
    die = die.translate(np.array([x[:, 0].min() + 0.07, -0.09, x[:, 2].max() + gap]) - die.position.min(axis=0))
    die = die.replace(velocity=(speed, 0.0, 0.0))
    falls = (G * math.sin(math.radians(angle)), 0.0, -G * math.cos(math.radians(angle)))
    return Case("A die slides on a block and stops", low + die, Contact(friction=friction), falls, frames)


def start(case: Case, method: str, finer: float, device: str) -> Simulation:
    """Return a simulation of a case with so many times the automatic substeps."""
    options = {
        "gravity": case.gravity,
        "contact": case.contact,
        "precision": "float64",
        "device": device,
        "fps": FPS,
    }
    options |= {"integrator": METHODS[method]}
    substeps = math.ceil(finer * Simulation(case.system, **options).substeps)
    return Simulation(case.system, substeps=substeps, energy_limit=math.inf, **options)


def run(case: Case, method: str, finer: float, device: str) -> Simulation:
    """Return a simulation at the end of a case."""
    simulation = start(case, method, finer, device)
    simulation.step(case.frames)
    return simulation


def row_of(scene: str, title: str, method: str, finer: float, simulation: Simulation, error: float) -> dict:
    """Return what is written of a point of the first chart."""
    evaluations = simulation.substeps * simulation.integrator.evaluations
    return {
        "scene": scene,
        "title": title,
        "method": method,
        "finer": finer,
        "step": 1 / (FPS * simulation.substeps),
        "evaluations": evaluations * FPS,
        "error": error,
    }


def measure_pairs(options) -> list[dict]:
    """Return the rows of pairs, against the closed form."""
    rows, restitution = [], 1.0
    for method in CONTACT_METHODS:
        for finer in FINER[: 3 if options.quick else None]:
            simulation, gaps = bounced(method, restitution, finer, options.device)
            exact = apart_after(gaps, simulation.time, touch_of_pairs(restitution))
            x = simulation.frame().position[:, 0]
            # Each of a pair errs by half of that, and its way is half of what they have come closer or gone apart.
            way = 0.5 * (exact - 0.1 - gaps)
            error = np.sqrt(np.mean((0.5 * (x[1::2] - x[0::2] - exact)) ** 2) / np.mean(way**2))
            row = row_of("pairs", "Two particles, head on (closed form)", method, finer, simulation, float(error))
            rows.append(row | {"reference_error": 0.0})
    return rows


def measure_case(scene: str, case: Case, options) -> list[dict]:
    """Return the rows of a case, against leapfrog at a fine step."""
    finer = [one for one in FINER if one <= FINEST[scene]][: 3 if options.quick else None]
    fine, coarse = (run(case, "leapfrog", share * finer[-1], options.device).frame().position for share in (4, 2))
    way = np.sqrt(np.mean((fine - case.system.position) ** 2))
    own = float(np.sqrt(np.mean((coarse - fine) ** 2)) / way)
    rows = []
    for method in CONTACT_METHODS:
        for share in finer:
            simulation = run(case, method, share, options.device)
            error = float(np.sqrt(np.mean((simulation.frame().position - fine) ** 2)) / way)
            if error > 3 * own:
                row = row_of(scene, case.title, method, share, simulation, error)
                rows.append(row | {"reference_error": own})
    return rows


def measure_work(options) -> list[dict]:
    """Return the rows of the first chart."""
    rows = measure_pairs(options)
    if not options.quick:
        rows += measure_case("dice", thrown(), options)
        rows += measure_case("slide", on_a_block(0.0, 0.5, 9, 30, gap=0.02, speed=1.5), options)
    return rows


# --- Energy ---


def measure_energy(options) -> list[dict]:
    """Return a row for every step: by how much energies change, as shares of the energy at the start."""
    rows = []
    for finer in ENERGY_FINER[: 1 if options.quick else None]:
        scene = cradle.build(count=2)
        automatic = Simulation.from_scene(scene, device=options.device).substeps
        simulation = Simulation.from_scene(scene, device=options.device, substeps=finer * automatic)
        whole, conserved, measured = simulation.measure().energy, [], []
        for _ in range(31):
            conserved.append(simulation.stepping.balance().energy)
            measured.append(simulation.measure().energy)
            simulation.step(4)
        rows.append(
            {
                "finer": finer,
                "step": 1 / (simulation.fps * simulation.substeps),
                "conserved_most": float(np.abs(np.subtract(conserved, conserved[0])).max() / whole),
                "conserved_end": (conserved[-1] - conserved[0]) / whole,
                "measured_end": (measured[-1] - measured[0]) / whole,
            }
        )
    return rows


# --- Friction ---


def measure_friction(options) -> list[dict]:
    """Return a row for every slope, method and step."""
    rows = []
    for slope, (angle, friction, long, frames) in SLOPES.items():
        case = on_a_block(angle, friction, long, frames)
        coulomb = G * (math.sin(math.radians(angle)) - friction * math.cos(math.radians(angle)))
        for method in SLOPE_METHODS[: 1 if options.quick else None]:
            for finer in SLOPE_FINER[method][: 2 if options.quick else None]:
                simulation = start(case, method, finer, options.device)
                along = []
                for _ in range(frames):
                    simulation.step()
                    frame = simulation.frame()
                    along.append((frame.position[-27:, 0].mean(), frame.velocity[-27:, 0].mean()))
                x, v = np.array(along).T
                rows.append(
                    {
                        "slope": slope,
                        "angle": angle,
                        "friction": friction,
                        "method": method,
                        "finer": finer,
                        "step": 1 / (FPS * simulation.substeps),
                        "creep": abs(x[-1] - x[-31]) / 0.5,  # [m/s], over the last half second
                        "acceleration": np.polyfit(np.arange(10, frames) / FPS, v[10:], 1)[0],  # [m/s²]
                        "coulomb": max(coulomb, 0.0),
                    }
                )
    return rows


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments(__doc__.splitlines()[0])
    parts = {
        "contact_restitution.csv": (measure_restitution, draw_restitution),
        "contact_friction.csv": (measure_friction, draw_friction),
        "contact_work.csv": (measure_work, draw_work),
        "contact_energy.csv": (measure_energy, None),
    }
    for name, (measure, draw) in parts.items():
        path = options.folder / name
        if not options.plot_only:
            begun = time.perf_counter()
            write_csv(path, measure(options), machine(options.device))
            print(f"{name}: {time.perf_counter() - begun:.0f} s", flush=True)
        _, rows = read_csv(path)
        table(name, list(rows[0]), [list(row.values()) for row in rows])
        if draw is not None and not options.quick:
            draw(rows)


if __name__ == "__main__":
    sys.exit(main())
