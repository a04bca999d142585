"""Times many worlds at once beside newton's.

    python -m benchmarks.peers.ensemble [--device D] [--quick]

Worlds of one body differ in stiffness and in how they start. newton has them as one model of springs, each with
its own numbers, and steps them by `SolverSemiImplicit`: the same law, step and number of steps; both are float32.
Springs are in the order that is best for it, the first of all worlds before the second of any: neighbouring
threads then seldom add to the same particle. Nothing touches, so all bodies may lie in one place, where float32 is
as fine as for one.

What differs: an `Ensemble` tests each particle against a plane, looks over each world for divergence once a frame,
and repeats to the last bit. newton does none of this here; its worlds are one system.

Positions are compared after the first frame. Then both are timed in turn; times are medians over the rounds.
"""

import gc
import sys
from statistics import median
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from msdwarp import Ensemble, System

from ..common import arguments, machine, read_csv, table, write_csv
from ..speed.ensemble import AROUND, FPS, QUICK_ROUNDS, ROUNDS, SUBSTEPS, Contestant, bodies
from .codes import Newton

CASES = [("die 3³", 1_000), ("die 3³", 10_000), ("jelly 10³", 132), ("cloth 31², pinned", 1_000)]
QUICK_CASES = [("die 3³", 10), ("jelly 10³", 2)]
GRAVITY = 9.82
CLOSE = 1e-5
"""How far positions may differ after a frame [m]: a few roundings of 10 m in each of 48 steps."""


def together(body: System, stiffness: NDArray, velocity: NDArray) -> SimpleNamespace:
    """Return many of a body, all in one place, as newton's builder takes them: connection by connection."""
    worlds, n = len(stiffness), body.particle_count
    first = n * np.arange(worlds)
    connections = body.connections[:, None, :] + first[None, :, None]

    def of_each(values: NDArray) -> NDArray:
        return np.repeat(values, worlds)

    return SimpleNamespace(
        particle_count=n * worlds,
        connection_count=body.connection_count * worlds,
        position=np.tile(body.position, (worlds, 1)),
        velocity=np.repeat(velocity, n, axis=0) * ~np.tile(body.pinned, worlds)[:, None],
        mass=np.tile(body.mass, worlds),
        pinned=np.tile(body.pinned, worlds),
        connections=connections.reshape(-1, 2),
        rest_length=of_each(body.rest_length),
        stiffness=np.tile(stiffness, body.connection_count),
        damping=of_each(body.damping),
    )


def measure_case(name: str, worlds: int, device: str, rounds: int) -> dict:
    """Return the row of a case."""
    body, random = bodies()[name](), np.random.default_rng(1)
    stiffness = body.stiffness[0] * random.uniform(0.5, 1.0, worlds)
    velocity = random.uniform(-0.5, 0.5, (worlds, 3))
    how = {**AROUND, "gravity": GRAVITY, "allow_unstable": True, "device": device}
    ensemble = Ensemble(body, worlds, **how, stiffness=stiffness, velocity=velocity)
    given = SimpleNamespace(
        system=together(body, stiffness, velocity), gravity=GRAVITY, step=1 / (FPS * SUBSTEPS), floor=-5000.0
    )
    newton = Newton(given, device)
    ensemble.step()
    newton.advance(SUBSTEPS)
    off = float(np.abs(newton.position().reshape(worlds, -1, 3) - ensemble.frame().position).max())
    if not off < CLOSE:
        raise SystemExit(f"{name}: positions differ by {off:.2g} m; it is not the same that is timed")
    contestants = [Contestant(device, ensemble.step), Contestant(device, lambda: newton.advance(SUBSTEPS))]
    for k in range(rounds):
        for contestant in contestants if k % 2 else contestants[::-1]:  # what comes first is not always the same
            contestant.measure()
    own, theirs = (median(one.seconds) / (SUBSTEPS * worlds) for one in contestants)
    return {
        "body": name,
        "worlds": worlds,
        "ns_per_world_substep": 1e9 * own,
        "newton_ns": 1e9 * theirs,
        "newton_over_own": theirs / own,
        "off": off,
        "newton": newton.note,
    }


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "peers_ensemble.csv"
    if not options.plot_only:
        rows = []
        for name, worlds in QUICK_CASES if options.quick else CASES:
            rows.append(measure_case(name, worlds, options.device, QUICK_ROUNDS if options.quick else ROUNDS))
            gc.collect()
            write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ["body", "worlds", "ns_per_world_substep", "newton_ns", "newton_over_own", "off"]
    head = ["body", "worlds", "ns/world/substep", "newton", "ratio", "apart [m]"]
    table("Many worlds at once", head, [[row[one] for one in columns] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
