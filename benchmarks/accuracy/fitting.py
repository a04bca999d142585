"""How far off may fits begin, and are they as sure as they say where there is noise.

A block that is dropped on an edge, and one that hangs: where 9 of their particles are, 60 times a second for a
second. Its stiffness and damping are fitted.
"""

import argparse
import sys
import warnings
from collections.abc import Callable

import numpy as np

from msdwarp import Ensemble, FitWarning, Leapfrog, Plane, Scene, Simulation, TrackedPoints, box, fit

from ..common import arguments, machine, pyplot, read_csv, save, table, write_csv

STIFFNESS, DAMPING = 200.0, 0.2
"""What made the motion [N/m], [N s/m]."""
BOUNDS = {"stiffness": (10.0, 4000.0), "damping": (0.01, 4.0)}
NEARER = {"stiffness": (50.0, 1000.0), "damping": (0.02, 1.0)}
METHOD = Leapfrog(damper_extrapolation=0.5)
SUBSTEPS, NEARER_SUBSTEPS = 60, 32
"""What is stable within the bounds."""
DURATION = 1.0
HORIZONS = (0.25, 0.5, 1.0)
FACTORS = np.geomspace(0.1, 10, 161)
STARTS = np.geomspace(0.2, 5.0, 7)
NOISE = 1e-3
"""[m]"""


def dropped(stiffness: float = STIFFNESS, damping: float = DAMPING) -> Scene:
    """Return a block that falls onto a floor with an edge first."""
    body = box((3, 3, 3), 0.1, mass=0.05, stiffness=stiffness, damping=damping)
    body = body.rotate(35.0, (1.0, 0.5, 0.2)).translate((0.0, 0.0, 0.35))
    return Scene(system=body, colliders=[Plane(restitution=0.3)])


def hung(stiffness: float = STIFFNESS, damping: float = DAMPING) -> Scene:
    """Return a block that is held at its top and let go."""
    body = box((3, 3, 3), 0.1, mass=0.05, stiffness=stiffness, damping=damping)
    return Scene(system=body.pin(body.position[:, 2] > body.position[:, 2].max() - 1e-6))


def measured(scene: Scene, substeps: int, device: str, noise: float = 0.0, seed: int = 0) -> TrackedPoints:
    """Return where every third particle is in each frame."""
    simulation = Simulation.from_scene(
        scene, integrator=METHOD, precision="float64", substeps=substeps, device=device
    )
    frames = list(simulation.frames(DURATION))
    followed = np.arange(0, scene.system.particle_count, 3)
    position = np.array([frame.position[followed] for frame in frames])
    position += noise * np.random.default_rng(seed).normal(size=position.shape)
    time = np.repeat([frame.time for frame in frames], len(followed))
    return TrackedPoints(time, np.tile(followed, len(frames)), position.reshape(-1, 3))


def landscape(device: str) -> list[dict]:
    """Return how far points are off with other stiffnesses, up to several times."""
    how = {"integrator": METHOD, "precision": "float64", "substeps": SUBSTEPS, "device": device}
    worlds = Ensemble(dropped(), 1 + len(FACTORS), stiffness=STIFFNESS * np.append(1.0, FACTORS), **how)
    sums, rows = np.zeros(len(FACTORS)), []
    for frame in range(1, round(DURATION * worlds.fps) + 1):
        worlds.step()
        position = worlds.frame().position[:, ::3]
        sums += ((position[1:] - position[0]) ** 2).mean(axis=(1, 2))
        if any(abs(worlds.time - one) < 1e-6 for one in HORIZONS):
            off = np.sqrt(sums / frame)
            rows += [
                {"horizon": worlds.time, "factor": factor, "off": value}
                for factor, value in zip(FACTORS, off, strict=True)
            ]
    return rows


def starts(device: str, some: slice, keep: Callable[[list[dict]], None]) -> None:
    """Keep how far fits end from what made the motion, by where they start."""
    points, rows = measured(dropped(), SUBSTEPS, device), []
    for factor in STARTS[some]:
        for horizon in ("growing", "whole"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FitWarning)
                scene = dropped(factor * STIFFNESS, 0.5 * DAMPING)
                how = {"bounds": BOUNDS, "substeps": SUBSTEPS, "horizon": horizon, "device": device}
                found = fit(scene, points, ["stiffness", "damping"], **how)
            rows.append(
                {
                    "horizon": horizon,
                    "factor": factor,
                    "stiffness": found.values["stiffness"] / STIFFNESS - 1,
                    "damping": found.values["damping"] / DAMPING - 1,
                    "worlds": found.runs,
                }
            )
            keep(rows)


def with_noise(build: Callable[..., Scene], seed: int, device: str) -> dict:
    """Return by how many standard deviations a fit to noisy points is off, and how large one is."""
    points = measured(build(), NEARER_SUBSTEPS, device, NOISE, seed)
    scene = build(1.6 * STIFFNESS, 0.5 * DAMPING)
    how = {"bounds": NEARER, "substeps": NEARER_SUBSTEPS, "device": device}
    found = fit(scene, points, ["stiffness", "damping"], **how)
    row = {"scene": build.__name__, "seed": seed}
    for name, true in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        said = found.standard_deviations[name]
        row |= {name: (found.values[name] - true) / said, f"{name}_deviation": said / true}
    return row | {"worlds": found.runs}


def draw(shape: list[dict], ends: list[dict]) -> None:
    """Draw both into one chart."""
    plt = pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    colors = ("#009e73", "#56b4e9", "#c8352b")
    for horizon, color in zip(HORIZONS, colors, strict=True):
        own = [row for row in shape if abs(row["horizon"] - horizon) < 1e-6]
        x, y = [row["factor"] for row in own], [1e3 * row["off"] for row in own]
        left.loglog(x, y, color=color, label=f"first {horizon:g} s")
    left.set_xlabel("stiffness / true stiffness")
    left.set_ylabel("points are off by, root mean square [mm]")
    left.set_title("What is made small")
    left.legend(frameon=False)
    for horizon, color, marker in (("growing", "#009e73", "o"), ("whole", "#c8352b", "x")):
        own = [row for row in ends if row["horizon"] == horizon]
        off = [max(abs(row["stiffness"]), abs(row["damping"]), 1e-12) for row in own]
        word = "growing horizon" if horizon == "growing" else "1 s at once"
        right.loglog([row["factor"] for row in own], off, marker, color=color, ms=8, mew=2, label=word)
    right.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    right.minorticks_off()
    right.axhline(1e-6, color="#999999", lw=1, ls="--")
    right.set_xlabel("stiffness at the start / true stiffness")
    right.set_ylabel("largest relative error in the end")
    right.set_title("Where searches end")
    right.legend(frameon=False)
    save(figure, "fitting.png")


def main() -> None:
    """Measure, write, print and draw."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--seeds", type=int, default=0, help="also fit so many times to points with noise")
    options = arguments(__doc__.splitlines()[0], own)
    paths = [options.folder / f"fitting_{name}.csv" for name in ("landscape", "starts", "noise")]
    if not options.plot_only:
        write_csv(paths[0], landscape(options.device), machine(options.device))
        some = slice(2, 4) if options.quick else slice(None)
        starts(options.device, some, lambda rows: write_csv(paths[1], rows, machine(options.device)))
        if options.seeds:
            rows = []
            for build in (hung, dropped):
                for seed in range(options.seeds):
                    rows.append(with_noise(build, seed, options.device))
                    print(rows[-1], flush=True)
            write_csv(paths[2], rows, machine(options.device))
            for scene in ("hung", "dropped"):
                off = [max(abs(r["stiffness"]), abs(r["damping"])) for r in rows if r["scene"] == scene]
                print(scene, sum(one < 3 for one in off), "of", len(off), "within three standard deviations")
    shape, ends = (read_csv(path)[1] for path in paths[:2])
    table("fitting_starts.csv", list(ends[0]), [list(row.values()) for row in ends])
    if not options.quick:
        draw(shape, ends)


if __name__ == "__main__":
    sys.exit(main())
