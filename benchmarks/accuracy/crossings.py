"""Does anything go through anything? Random bodies are thrown at each other, and crossings counted.

    python -m benchmarks.accuracy.crossings [--first SEED] [--count N] [--device D] [--quick]

Boxes, slabs of one cell, balls, filled meshes, shells, sheets, cloths with an outline, ropes and grains. The
second of two bodies is thrown at the first, which is pinned in half of the cases, at 0.1 to 5 times the speed of
sound of its lattice, at automatic steps. Each seed has a pair of which one is open, and a pair of closed bodies:
no contact meshes are to cross, and no energy to be gained. Counted are the frames in which
edges go through triangles, by the Incremental Potential Contact Toolkit (ipctk.xyz), and, where frames are
substeps, those in which grains go through triangles or ropes through ropes. Writes
results/<device>/contact_crossings.csv. `--quick --first 17 --count 1` repeats one seed.
"""

import argparse
import math
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msdwarp import (
    RK4,
    Contact,
    Leapfrog,
    Simulation,
    SimulationDiverged,
    SymplecticEuler,
    System,
    ball,
    box,
    chain,
    cloth,
    from_mesh,
    icosphere,
    sheet,
    shell,
)
from msdwarp.bodies import contact_surfaces

from ..common import arguments, machine, table, write_csv

SPACING = 0.1
"""Of the lattices [m]."""
OPEN = ("sheet", "outline", "rope", "grains")
CLOSED = ("box", "slab", "mesh", "shell", "ball")
METHODS = {"symplectic Euler": SymplecticEuler(), "leapfrog": Leapfrog(), "RK4": RK4()}
GAINED = 1.02
"""Energy at the end over that at the start, above which it was gained; that of a first-order method swings."""
FLIGHTS = 3.0
"""How long a case takes, by the time that the second body takes to the first one's middle."""
LONGEST = 120.0
"""A case ends with the frame in which it has taken so long [s]."""


class Oracle:
    """Finds out whether bodies go through each other, or an open one through itself, by ipctk.

    It shares no code with msdwarp but the lists of facets and of what their vertices are the means of.
    """

    def __init__(self, system: System, itself: bool = True, ways: bool = False) -> None:
        """Find the edges and triangles of a system, of which open bodies may cross themselves without `itself`.

        With `ways`, grains through triangles and ropes through ropes are found on the straight way since the last
        call, or the start. That is right where calls are a substep apart.
        """
        import ipctk  # for those who count crossings only

        self._surfaces = surfaces = contact_surfaces(system)
        a, b, c = surfaces.corner.T
        triangles = surfaces.corner[(a != b) & (b != c)]
        # Sheets may have a second triangle for their other side.
        _, different = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
        triangles, segments = triangles[different], surfaces.corner[(b == c) & (a != b), :2]
        edges = np.concatenate([ipctk.edges(triangles), segments]) if len(triangles) else segments
        edges = np.unique(np.sort(edges, axis=1), axis=0)
        self._places = self.places(system.position)
        self.mesh = ipctk.CollisionMesh(self._places, edges, triangles)
        # Vertices of one patch do not meet: solid bodies are a patch each, of the others each vertex is one.
        body, vertices = surfaces.body, np.arange(len(surfaces.body))
        alone = np.where(itself, len(surfaces.solid) + vertices, body)
        patch = np.where(surfaces.solid[body], body, alone)
        self.mesh.can_collide = ipctk.make_vertex_patches_filter(patch.astype(np.int32))
        self._has_intersections, self._ways = ipctk.has_intersections, ways
        grains = np.unique(surfaces.corner[a == c, 0])
        g, t = (one.ravel() for one in np.meshgrid(grains, np.arange(len(triangles)), indexing="ij"))
        k, m = np.triu_indices(len(segments), 1)
        apart = (segments[k][:, :, None] != segments[m][:, None, :]).all(axis=(1, 2))
        through = np.column_stack([g, triangles[t]]) if len(g) else np.zeros((0, 4), dtype=int)
        across = np.column_stack([segments[k[apart]], segments[m[apart]]])
        self._corners = np.concatenate([through, across])
        self._signs = np.repeat([[1, -1, -1, -1], [1, 1, -1, -1]], [len(through), len(across)], axis=0)

    def places(self, position: NDArray) -> NDArray[np.float64]:
        """Return the places of the vertices."""
        x = np.asarray(position, dtype=np.float64)
        return np.einsum("vk,vkd->vd", self._surfaces.weight, x[self._surfaces.particle])

    def crosses(self, position: NDArray) -> bool:
        """Return whether anything crosses where the particles are, or crossed on the way there."""
        before, self._places = self._places, self.places(position)
        found = self._has_intersections(self.mesh, self._places)
        return bool(found or (self._ways and self._passed(before, self._places)))

    def _passed(self, before: NDArray, after: NDArray) -> bool:
        """Return whether a grain or a segment went straight through what moved straight, too."""
        start, end = before[self._corners], after[self._corners]

        def volume(x: NDArray) -> NDArray:
            return np.einsum("ni,ni->n", x[:, 1] - x[:, 0], np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]))

        turned = volume(start) * volume(end) < 0
        start, end, signs = start[turned], end[turned], self._signs[turned]
        low, high = np.zeros((2, len(start), 1, 1))
        high += 1.0
        sign = np.sign(volume(start))
        for _ in range(50):  # when the four corners lie in a plane
            middle = (low + high) / 2
            same = (np.sign(volume(start + middle * (end - start))) == sign)[:, None, None]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        flat = start + low * (end - start)
        flat = np.concatenate([flat - flat.mean(axis=1, keepdims=True), np.ones((len(flat), 4, 1))], axis=2)
        # Of four points in a plane those of one sign and those of the other have a common mean.
        weights = np.linalg.svd(flat.transpose(0, 2, 1))[2][:, 3] if len(flat) else np.zeros((0, 4))
        weights = weights * signs
        return bool(((weights > 0).all(axis=1) | (weights < 0).all(axis=1)).any())


def crossings(simulation: Simulation, frames: int) -> list[int]:
    """Take so many frames; return those in which bodies cross each other, or an open one itself."""
    oracle, found = Oracle(simulation.system), []
    for frame in range(frames):
        simulation.step()
        if oracle.crosses(simulation.frame().position):
            found.append(frame)
    return found


class Throw(NamedTuple):
    """Two bodies of which the second flies at the first, and how that is to be simulated."""

    kinds: tuple[str, str]
    pinned: bool
    speed: float
    """[m/s]."""
    sound: float
    """The speed of sound in the second one [m/s]."""
    duration: float
    """[s]."""
    method: str
    system: System
    options: dict[str, Any]
    """Arguments of `Simulation`."""

    @property
    def ways(self) -> bool:
        """Whether it takes the ways of all substeps to see whether something went through."""
        return "grains" in self.kinds or self.kinds == ("rope", "rope")


def body(kind: str, rng: np.random.Generator) -> tuple[System, float]:
    """Return a body around the origin, and the speed of sound in it [m/s]."""
    mass, stiffness = 10 ** rng.uniform(-2.5, -1.5), 10 ** rng.uniform(2.3, 3.3)
    damping = rng.choice([0.0, 0.02, 0.2]) * 2 * math.sqrt(stiffness * mass)
    lattice = {"mass": mass, "stiffness": stiffness, "damping": damping}
    n = [int(one) for one in rng.integers(3, 7, 2)]
    if kind == "sheet":
        made = sheet((n[0], n[1]), SPACING, **lattice, bending=rng.choice([None, 1e-3]))
    elif kind == "outline":
        angle = np.arange(10) * np.pi / 5
        star = 0.3 * np.where(np.arange(10) % 2, rng.uniform(0.5, 1.0), 1.0)
        made = cloth(np.column_stack([star * np.cos(angle), star * np.sin(angle)]), SPACING, **lattice)
    elif kind == "rope":
        made = chain(2 * n[0], SPACING, **lattice)
    elif kind == "grains":
        x = np.stack(np.meshgrid(*[[-0.06, 0.0, 0.06]] * 3), axis=-1).reshape(-1, 3)
        x = x[rng.choice(27, n[0], replace=False)] + rng.uniform(-0.01, 0.01, (n[0], 3))
        made = System(position=x, mass=mass)
    elif kind == "box":
        made = box((3, 3, n[0] - 1), SPACING, **lattice)
    elif kind == "slab":
        made = box((n[0], n[1], 2), SPACING, **lattice)
    elif kind == "ball":
        made = ball(1.5 * SPACING, SPACING, **lattice)
    elif kind == "mesh":
        made = from_mesh(icosphere(0.2, 1), SPACING, **lattice)
    else:
        points, triangles = icosphere(0.17, 1)
        constants = {"total_mass": mass * len(points), "stiffness": stiffness, "damping": damping}
        made = shell((points, triangles), **constants, folding=rng.choice([0.0, 0.3]) * stiffness)
    made = made.translate(tuple(-made.position.mean(axis=0)))
    sound = SPACING * math.sqrt(stiffness / mass)
    return made.rotate(rng.uniform(0, 2 * np.pi), axis=tuple(rng.normal(size=3))), sound


def throw(seed: int, closed: bool = False) -> Throw:
    """Return the two bodies of a seed, of which one is open, or both are closed."""
    rng = np.random.default_rng([seed, closed])
    weights = [6] * len(OPEN) + [6, 6, 6, 6, 2]  # balls have fine surfaces, which take long
    while True:
        first = str(rng.choice(CLOSED if closed else OPEN))
        kinds = [
            first,
            str(rng.choice(CLOSED if closed else OPEN + CLOSED, p=None if closed else _shares(weights))),
        ]
        if not set(kinds) <= {"rope", "grains"} or kinds == ["rope", "rope"]:  # a grain goes through no rope
            break
    if rng.random() < 0.5:
        kinds.reverse()
    (still, _), (thrown, sound) = (body(kind, rng) for kind in kinds)
    reach = [float(np.linalg.norm(one.position, axis=1).max()) + 0.05 for one in (still, thrown)]
    pinned = bool(rng.random() < 0.5)
    if pinned:
        still = still.pin([0, still.particle_count - 1] if rng.random() < 0.5 else slice(None))
    towards, aside = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    distance, speed = sum(reach) + 0.05, sound * 10 ** rng.uniform(-1.0, math.log10(5.0))
    place = -distance * towards + rng.uniform(0, 0.5) * reach[0] * aside
    thrown = thrown.translate(tuple(place)).with_velocity(tuple(speed * towards))
    # Surfaces finer than the thickness would start in contact with themselves: that of a cloth with an outline,
    # and that of a ball where the thickness is of grains.
    contact = {"restitution": rng.uniform(0.05, 1.0), "friction": rng.uniform(0.0, 1.0)}
    contact["self_contact"] = "outline" not in kinds and set(kinds) != {"ball", "grains"}
    if "grains" in kinds:
        contact |= {"thickness": rng.uniform(0.01, 0.03), "stiffness": 10 ** rng.uniform(2.3, 3.3)}
    method = str(rng.choice(list(METHODS)))
    options = {"gravity": 0.0, "contact": Contact(**contact), "integrator": METHODS[method]}
    options["precision"] = str(rng.choice(["float32", "float64"]))
    duration = FLIGHTS * distance / speed
    return Throw((kinds[0], kinds[1]), pinned, speed, sound, duration, method, still + thrown, options)


def _shares(weights: list[int]) -> NDArray[np.float64]:
    return np.array(weights) / sum(weights)


def simulate(case: Throw, device: str) -> dict[str, Any]:
    """Return what became of two bodies.

    A frame is a 60th of a second or shorter: the second body flies half of a spacing in it at most, unless it does
    in a substep. Where `ways` counts a frame is a substep.
    """
    began, itself = time.perf_counter(), case.options["contact"].self_contact
    substeps = Simulation(case.system, device=device, **case.options).substeps
    fps = 60.0 * substeps if case.ways else float(np.clip(case.speed / (0.5 * SPACING), 60.0, 60.0 * substeps))
    simulation = Simulation(case.system, device=device, fps=fps, **case.options)
    oracle, crossing, held_back, end, done = Oracle(case.system, itself, case.ways), [], 0.0, "", 0
    energy, substeps = simulation.measure().energy, simulation.substeps
    try:
        for frame in range(max(5, math.ceil(case.duration * fps))):
            simulation.step()
            done = frame + 1
            held_back = max(held_back, simulation.held_back)
            if oracle.crosses(simulation.frame().position):
                crossing.append(frame)
            if time.perf_counter() - began > LONGEST:
                end = "stopped"
                break
        gained = simulation.measure().energy / energy
    except SimulationDiverged:
        end, gained = "diverged", math.inf
    return {
        "fps": fps,
        "substeps": substeps,  # of the first frame
        "frames": done,
        "crossing": len(crossing),
        "first_crossing": crossing[0] if crossing else -1,
        "energy": gained,  # at the end, over that at the start
        "held_back": float(held_back),  # the furthest [m]
        "end": end,  # "stopped" after LONGEST, or "diverged"
        "seconds": time.perf_counter() - began,
    }


def try_out(seed: int, closed: bool, device: str) -> dict[str, Any]:
    """Return the row of a case."""
    case = throw(seed, closed)
    contact = case.options["contact"]
    about = {
        "seed": seed,
        "open": int(not closed),  # whether one of the two is
        "first": case.kinds[0],
        "second": case.kinds[1],
        "pinned": int(case.pinned),
        "speed": case.speed,
        "by_sound": case.speed / case.sound,
        "restitution": contact.restitution,
        "friction": contact.friction,
        "method": case.method,
        "precision": case.options["precision"],
    }
    return about | simulate(case, device)


def main() -> None:
    """Run cases, write contact_crossings.csv, and print a summary."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--first", type=int, default=0, help="the first seed")
    own.add_argument("--count", type=int, default=300, help="how many seeds")
    options = arguments((__doc__ or "").splitlines()[0], own)
    count = min(options.count, 6) if options.quick else options.count
    rows = []
    for seed in range(options.first, options.first + count):
        for closed in (False, True):
            row = try_out(seed, closed, options.device)
            rows.append(row)
            write_csv(options.folder / "contact_crossings.csv", rows, machine(options.device))
            if row["crossing"] or row["energy"] > GAINED or row["end"]:
                print(row, flush=True)
    summarise(rows)


def summarise(rows: list[dict]) -> None:
    """Print what became of pairs of which one is open, and of closed ones."""
    counted = {
        "cases": lambda row: True,
        "frames": lambda row: row["frames"],
        "cases that cross": lambda row: row["crossing"] > 0,
        "cases that gain energy": lambda row: row["energy"] > GAINED,
        "held back": lambda row: row["held_back"] > 0,
        "diverged": lambda row: row["end"] == "diverged",
        f"stopped after {LONGEST:.0f} s": lambda row: row["end"] == "stopped",
        "seconds": lambda row: row["seconds"],
    }
    lines = [
        [name, *(float(sum(of(r) for r in rows if r["open"] == k)) for k in (1, 0))]
        for name, of in counted.items()
    ]
    table("contact_crossings.csv", ["", "one is open", "both are closed"], lines)


if __name__ == "__main__":
    sys.exit(main())
