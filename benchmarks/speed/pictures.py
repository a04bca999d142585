"""Pictures: what a frame costs, stage by stage, by scene, renderer and colors.

    python -m benchmarks.speed.pictures [--device D] [--quick] [--plot-only]

Scenes are simulated on the device, and frames spread over the first second are drawn from positions that are on
the device already, at 1280x720: by the ray caster on a GPU, and by the rasteriser if the device is the CPU. Some
scenes are drawn by the other one too, and by OpenGL where PyVista and an OpenGL library are found. "Prepare" moves
the triangles and what is searched by rays, "render" draws and copies the picture to the host, "png" compresses and
writes it as a run does, "film" adds it to a WebP: milliseconds of a frame, medians of all but the film's, which is
the mean. "Whole" is all of it side by side, as in a run with frames and a film, and "computing" what that takes of
all cores together: where other programs take their share of the machine, the latter says more. "waves" is a sheet
of a million triangles that moves by a formula.
"""

import importlib.util
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import warp as wp

from msdwarp import Plane, Renderer, Scene, Simulation, sheet
from msdwarp.pictures import write_film
from msdwarp.pictures.film import png as png_of
from msdwarp.pictures.opengl_window import opengl_window
from msdwarp.pictures.warp_renderers import RayCaster

from ..common import arguments, machine, read_csv, scene_scripts, table, write_csv

SIZE = (1280, 720)
FRAMES, EVERY = 12, 5
"""Frames that are drawn, and how many are simulated for each."""
FEWER = 4
"""One in so many is drawn by the ray caster where that is slow, on a CPU."""
SOME = ("cube", "dice", "jelly", "mattress", "tower")
"""Scenes that are drawn by every renderer: the others by that which is taken on the device by default."""
EDGE = 708
"""Particles along an edge of the sheet that waves: 2 · 707² triangles."""
STAGES = ["simulate_ms", "prepare_ms", "render_ms", "draw_ms", "png_ms", "film_ms", "whole_ms", "computing_ms"]
COLUMNS = ["scene", "renderer", "mode", "triangles", *STAGES]


def timed(work: Callable[[], Any], device: str) -> tuple[float, Any]:
    """Return how long some work takes with all that it starts on a device [ms], and its result."""
    wp.synchronize_device(device)
    start = time.perf_counter()
    result = work()
    wp.synchronize_device(device)
    return 1e3 * (time.perf_counter() - start), result


def simulated(scene: Scene, device: str, count: int) -> tuple[float, list[np.ndarray]]:
    """Return how long a frame of a scene takes [ms], and the positions in some frames."""
    simulation = Simulation.from_scene(scene, device=device)
    positions, times = [simulation.frame().position], []
    simulation.step()  # compiles
    while len(positions) < count:
        times.append(timed(lambda: simulation.step(EVERY), device)[0] / EVERY)
        positions.append(simulation.frame().position)
    return median(times), positions


def waves(count: int) -> tuple[Scene, list[np.ndarray]]:
    """Return a large sheet above a floor, and positions in frames in which it waves."""
    body = sheet((EDGE, EDGE), 1.0 / EDGE, mass=1e-6, stiffness=1.0, damping=0.0).translate((0, 0, 0.4))
    flat = np.array(body.position, dtype=np.float32)
    positions = []
    for k in range(count):
        x = flat.copy()
        x[:, 2] += 0.05 * np.sin(9 * x[:, 0] + 7 * x[:, 1] + 0.3 * k)
        positions.append(x)
    return Scene(system=body, colliders=[Plane()]), positions


def drawn(scene: Scene, positions: list[np.ndarray], renderer: str, mode: str, device: str) -> dict[str, Any]:
    """Measure the stages of drawing some frames."""
    made = Renderer(scene, np.stack(positions), resolution=SIZE, coloring=mode, backend=renderer, device=device)
    drawing, place = made.drawing, made.drawing.device
    vectors = wp.types.vector(scene.system.dim, wp.float32)
    there = [wp.array(x.astype(np.float32), dtype=vectors, device=place) for x in positions]
    caster = RayCaster(drawing, made.stage) if renderer == "raycast" else None
    prepare, render, png, pictures = [], [], [], []
    made.image(there[0])  # compiles, and makes what is made once
    if caster is not None:
        caster.draw()
    with tempfile.TemporaryDirectory() as folder:
        for k, x in enumerate(there):
            at = k * EVERY / 60
            moved, _ = timed(partial(drawing.follow, x, at), place)
            if caster is not None:
                searched, _ = timed(caster.refit, place)
                rendered, picture = timed(caster.shoot, place)
                moved += searched
            else:
                whole, picture = timed(partial(made.bare, x, at), place)
                rendered = whole - moved
            prepare.append(moved)
            render.append(rendered)
            keep = Path(folder) / "frame.png"
            save = partial(write_png, picture, keep)
            png.append(timed(save, "cpu")[0])
            pictures.append(picture)
        how = {"name": "film", "fps": 60.0, "frames": "none", "video": "webp"}
        film, _ = timed(lambda: write_film(iter(pictures), Path(folder), **how), "cpu")
        drawing_all = (made.bare(x, k * EVERY / 60) for k, x in enumerate(there))
        began = time.process_time()
        whole, _ = timed(lambda: write_film(drawing_all, Path(folder), **how | {"frames": "png"}), place)
        computing = 1e3 * (time.process_time() - began)
    return {
        "triangles": len(drawing.triangles),
        "prepare_ms": median(prepare),
        "render_ms": median(render),
        "draw_ms": median(a + b for a, b in zip(prepare, render, strict=True)),
        "png_ms": median(png),
        "film_ms": film / len(pictures),
        "whole_ms": whole / len(pictures),
        "computing_ms": computing / len(pictures),
    }


def write_png(picture: np.ndarray, path: Path) -> None:
    """Write a picture as a run does."""
    path.write_bytes(png_of(picture))


def main() -> None:
    """Measure all, write and print it."""
    options = arguments(__doc__.split("\n")[0])
    path: Path = options.folder / "pictures.csv"
    if not options.plot_only:
        rows: list[dict[str, Any]] = []
        count = 3 if options.quick else FRAMES
        usual = "raster" if options.device == "cpu" else "raycast"
        others = [name for name in ("raster", "raycast") if name != usual]
        if importlib.util.find_spec("pyvista") is not None and opengl_window() is not None:
            others.append("opengl")
        scripts = scene_scripts()
        names = ["cube", "mattress"] if options.quick else [*scripts, "waves"]
        for name in names:
            if name == "waves":
                simulate, (scene, positions) = float("nan"), waves(count)
            else:
                scene = scripts[name].build()
                simulate, positions = simulated(scene, options.device, count)
            for renderer in (usual, *(others if name in SOME else ())):
                some = positions if renderer != "raycast" or usual == "raycast" else positions[::FEWER]
                for mode in ("texture",) if name == "waves" else ("texture", "strain"):
                    found = drawn(scene, some, renderer, mode, options.device)
                    says = {"texture": "plain"}.get(mode, mode)
                    row = {"scene": name, "renderer": renderer, "mode": says, "simulate_ms": simulate, **found}
                    rows.append({column: row[column] for column in COLUMNS})
        load = os.getloadavg()[0]  # [processes that would run]
        write_csv(path, rows, f"{machine(options.device)}; load {load:.1f} at the end")
    line, kept = read_csv(path)
    table(f"a frame at {SIZE[0]}x{SIZE[1]}, {line}", COLUMNS, [[row[name] for name in COLUMNS] for row in kept])


if __name__ == "__main__":
    main()
