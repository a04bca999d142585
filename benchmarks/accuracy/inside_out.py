"""At what speed do bodies turn inside out when they hit the ground? Cubes that are thrown, materials that fall.

    python -m benchmarks.accuracy.inside_out [--device D] [--quick]

- inside_out_speeds.csv: a cube, six cells across, is thrown at a plane with its face, an edge or a corner ahead,
  without gravity. By Poisson's ratio: the lowest of some speeds, as fractions of the speed of sound c = √(E/ρ), at
  which a cell is inside out in any frame (`crushed`), and at which one still is at the end (`for_ever`).
- inside_out_drops.csv: bodies of the materials that come with msdwarp fall by five times their size, with each of
  these parts ahead. `speed` is that of landing over c, `crushed` the largest share of cells that are inside out at
  once, and `for_ever` the share a second after landing.
"""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

import msdwarp as msd

from ..common import arguments, machine, table, write_csv

SPEEDS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
RATIOS = (None, 0.3, 0.35, 0.4, 0.45, 0.49)
TURNS = {"face": (0.0, (1, 0, 0)), "edge": (0.785, (1, 0, 0)), "corner": (0.955, (1, -1, 0))}
STUFF = msd.Material(density=1000.0, youngs_modulus=1e5, damping_ratio=0.05)
MATERIALS = ("FOAM", "JELLY", "MUSCLE", "RUBBER", "SILICONE")
SIDE, ACROSS, FPS = 0.3, 6, 240.0
NEVER = float("inf")


def shares(body: msd.System, ahead: str, height: float, frames: int, device: str, **how: Any) -> np.ndarray:
    """Return the share of cells that are inside out at the end of each frame."""
    angle, axis = TURNS[ahead]
    body = body.rotate(angle, axis=axis)
    body = body.translate((0, 0, height - body.position[:, 2].min()))
    simulation = msd.Simulation(body, colliders=[msd.Plane(friction=0.6)], device=device, **how)
    count = simulation.assembly.inverted_cells.find(simulation.state.x).shape[1]
    return np.array([simulation.step() or simulation.measure().inverted for _ in range(frames)]) / count


def measure_speeds(options: Any) -> list[dict[str, Any]]:
    """Throw cubes."""
    rows = []
    for ratio in RATIOS[::4] if options.quick else RATIOS:
        material = replace(STUFF, poissons_ratio=ratio)
        cube = msd.box((ACROSS + 1, ACROSS + 1, ACROSS + 1), SIDE / ACROSS, material=material)
        for ahead in TURNS:
            row: dict[str, Any] = {"ratio": "springs" if ratio is None else ratio, "ahead": ahead}
            row |= {"crushed": NEVER, "for_ever": NEVER}
            for speed in SPEEDS[::4] if options.quick else SPEEDS:
                thrown = cube.with_velocity((0, 0, -speed * material.wave_speed))
                # As long as sound takes to pass the cube 15 times.
                frames = round(15 * SIDE / material.wave_speed * FPS)
                found = shares(thrown, ahead, 1e-3, frames, options.device, gravity=0.0, fps=FPS)
                for name, share in {"crushed": found.max(), "for_ever": found[-1]}.items():
                    row[name] = min(row[name], speed) if share > 0 else row[name]
                if row["for_ever"] < NEVER:
                    break
            rows.append(row)
            print(row, flush=True)
    return rows


def measure_drops(options: Any) -> list[dict[str, Any]]:
    """Drop bodies of each material, and of those that have a Poisson's ratio without it."""
    rows = []
    for name in MATERIALS:
        own = getattr(msd, name)
        for material in [own] + ([replace(own, poissons_ratio=None)] if own.poissons_ratio else []):
            for size in (0.3,) if options.quick else (0.1, 0.3, 1.0):
                h, fall = size / ACROSS, 5 * size
                bodies = {
                    "cube": msd.box((ACROSS + 1, ACROSS + 1, ACROSS + 1), h, material=material),
                    "ball": msd.ball(size / 2, h, material=material),
                    "bar": msd.box((2 * ACROSS + 1, ACROSS + 1, ACROSS + 1), h, material=material),
                }
                frames = round(60 * ((2 * fall / 9.82) ** 0.5 + 1))
                found = [
                    shares(body, ahead, fall, frames, options.device)
                    for shape, body in bodies.items()
                    for ahead in (("face",) if shape == "ball" else TURNS)
                ]
                rows.append(
                    {
                        "material": name,
                        "ratio": material.poissons_ratio or "springs",
                        "size": size,
                        "speed": (2 * 9.82 * fall) ** 0.5 / material.wave_speed,
                        "crushed": max(one.max() for one in found),
                        "for_ever": max(one[-1] for one in found),
                    }
                )
                print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    warnings.simplefilter("ignore", msd.InvertedWarning)
    for part, measure in {"speeds": measure_speeds, "drops": measure_drops}.items():
        rows = measure(options)
        path = options.folder / f"inside_out_{part}.csv"
        write_csv(path, rows, machine(options.device))
        table(path.name, list(rows[0]), [list(row.values()) for row in rows])


if __name__ == "__main__":
    main()
