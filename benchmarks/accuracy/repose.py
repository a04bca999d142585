"""Measures how steep heaps of grains and of small solid bodies stand, and what they cost.

    python -m benchmarks.accuracy.repose [--device D] [--quick]

200 stones settle in a tube, which is then lifted slowly: the usual experiment for the angle of repose. Stones are
single particles, or PyVista's solids with a particle at each corner, stretched by up to a quarter along each axis
and turned at random. The angle is that of a line from the heap's top to its foot, the first ring around its middle
where none lie on others. Times are those of the processor. Writes results/<device>/repose.csv and, without
--quick, docs/images/repose.webp: grains and octahedra at the end.
"""

import time

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from PIL import Image

import msdwarp as msd

from ..common import IMAGES, arguments, machine, table, write_csv

RADIUS, MASS, FRICTION = 0.03, 0.03, 0.6
"""Of a stone: distance of its corners from its middle [m], mass [kg], friction on others and on the floor."""
TUBE, LIFTS, SPEED, DURATION = 0.15, 0.7, 0.2, 4.0
"""Radius of the tube [m]; when it is lifted [s]; how fast [m/s]; and the end [s]."""
SHAPES = ("grain", "octahedron", "tetrahedron", "cube")


def heap(shape: str, count: int) -> msd.Scene:
    """Return stones in a tube that is lifted."""
    random, step = np.random.default_rng(1), 2.6 * RADIUS

    def stone(place: NDArray) -> msd.System:
        place = place + random.uniform(-0.25, 0.25, 3) * RADIUS  # on no lattice
        if shape == "grain":
            return msd.System(position=[place], mass=MASS)
        mesh = pv.PlatonicSolid(shape, radius=RADIUS).triangulate().scale(random.uniform(0.75, 1.25, 3))
        body = msd.shell(mesh, total_mass=MASS, stiffness=1000.0, damping=0.3)
        return body.rotate(random.uniform(0, 2 * np.pi), random.normal(size=3)).translate(place)

    places = step * np.array([(k % 3 - 1, k // 3 % 3 - 1, k // 9 + 0.6) for k in range(count)])
    height, wall = step * (count // 9 + 1), TUBE + 0.03

    def lifted(t: float) -> tuple[float, ...]:
        return 0.0, 0.0, SPEED * max(0.0, t - LIFTS)

    walls = [
        msd.Box(
            (wall * np.cos(a), wall * np.sin(a), height / 2),
            (0.06, 0.16, height),
            (0, 0, a),
            friction=0.0,
            motion=lifted,
        )
        for a in np.pi / 4 * np.arange(8)
    ]
    own = {"thickness": 2 * RADIUS, "stiffness": 1000.0} if shape == "grain" else {}
    return msd.Scene(
        system=sum(map(stone, places)),
        colliders=[msd.Plane(friction=FRICTION), *walls],
        contact=msd.Contact(friction=FRICTION, restitution=0.2, **own),
        look=msd.Look(color="#a58a64", smooth=shape == "grain", gloss=0.05, elevation=10),
    )


def angle_of_repose(position: NDArray, count: int) -> float:
    """Return the slope of a heap of stones [degrees]; see the top of this file."""
    stones = position.reshape(count, -1, 3)
    middle, top = stones.mean(axis=1)[:, :2], stones[..., 2].max(axis=1)
    away, width = np.linalg.norm(middle - np.median(middle, axis=0), axis=1), 1.5 * RADIUS
    top_ring = high = 0.0
    for ring in range(int(away.max() / width) + 2):
        tops = np.sort(top[(away >= ring * width) & (away < (ring + 1) * width)])
        high = float(tops[-max(1, len(tops) // 4) :].mean()) if len(tops) else 0.0
        top_ring = top_ring or high
        if high < 1.6 * RADIUS:
            break
    return float(np.degrees(np.arctan2(top_ring - high, ring * width)))


def main() -> None:
    """Measure heaps, and draw two of them."""
    options = arguments(__doc__ or "")
    rows, pictures = [], []
    count, duration = (20, 0.2) if options.quick else (200, DURATION)
    for shape in SHAPES:
        scene = heap(shape, count)
        simulation = msd.Simulation.from_scene(scene, device=options.device)
        simulation.step()  # compiles
        frames, began = round(60 * duration) - 1, time.process_time()
        simulation.step(frames)
        ms = 1e3 * (time.process_time() - began) / frames
        end, per = simulation.frame(), scene.system.particle_count // count
        angle = angle_of_repose(end.position, count)
        speed = float(np.sqrt((end.velocity.astype(float) ** 2).sum(axis=1).mean()))
        print(shape, round(angle, 1), round(ms, 1), flush=True)
        rows.append({
            "shape": shape, "particles": per, "connections": scene.system.connection_count // count,
            "angle": angle, "ms_per_frame": ms, "substeps": simulation.substeps, "speed": speed,
        })  # fmt: skip
        if shape in ("grain", "octahedron"):
            scene = scene.replace(colliders=scene.colliders[:1])
            renderer = msd.Renderer(
                scene, end.position[np.abs(end.position[:, :2]).max(axis=1) < 0.4], resolution=(640, 420)
            )
            pictures.append(renderer.image(end.position))
    write_csv(options.folder / "repose.csv", rows, machine(options.device))
    table("Heaps of 200 stones", list(rows[0]), [list(row.values()) for row in rows])
    if not options.quick:
        Image.fromarray(np.concatenate(pictures, axis=1)).save(IMAGES / "repose.webp", quality=82, method=6)


if __name__ == "__main__":
    main()
