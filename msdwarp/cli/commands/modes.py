"""Find a scene's modes from the command line: a table, a picture of their shapes, and films of them."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from ...pictures import ColorScale, Renderer, write_film
from ...simulation import Modes, modes
from ...studies import output_path, plot_pictures
from ...world import Scene
from ..options import ModesOptions
from ..process import status_on
from ..scene_files import Origin

SIZE, AMPLITUDE = (640, 400), 0.12
"""Width and height of pictures [pixels]; the largest displacement in them, as a share of the body's extent."""
FRAMES, FPS = 48, 24.0
"""Pictures in a period of a film, and in a second."""


def modes_scene(origin: Origin, scene: Scene, options: ModesOptions) -> None:
    """Print the modes of a scene; draw a picture and films of their shapes, if asked for."""
    if options.plot is not None:
        output_path(options.plot, ".png", options.force, "plot")
    if options.films is not None:
        for k in range(options.modes):
            output_path(_film(options.films, k), ".webp", options.force, "films")
    with status_on(Console(stderr=True), "finding modes") as report:
        found = modes(scene.replace(settled=True) if options.settle else scene, options.modes)
        _print(origin.name, found)
        if options.plot is not None or options.films is not None:
            report("drawing")
            _draw(origin.name, scene.replace(system=scene.system.replace(position=found.position)), found, options)


def _print(name: str, found: Modes) -> None:
    table = Table("mode", title=f"{name}: the {len(found.masses)} slowest modes")
    for heading in ("frequency [Hz]", "damping ratio", "modal mass [kg]"):
        table.add_column(heading, justify="right")
    for k, (frequency, ratio) in enumerate(zip(found.frequencies, found.damping_ratios, strict=True)):
        words = f"{frequency:.5g}" + (" (unstable)" if frequency < 0 else "")
        table.add_row(str(k + 1), words, "" if math.isnan(ratio) else f"{ratio:.3g}", f"{found.masses[k]:.4g}")
    Console().print(table)


def _film(folder: Path, k: int) -> Path:
    return folder / f"mode_{k + 1:02d}.webp"


def _draw(name: str, scene: Scene, found: Modes, options: ModesOptions) -> None:
    """Draw the shapes of those modes whose frequency is not 0."""
    chosen = np.flatnonzero(found.frequencies)
    if not len(chosen):
        print("nothing is drawn, as all frequencies are 0; a larger --modes, or --settle, may find others")
        return
    moved = AMPLITUDE * np.ptp(found.position, axis=0).max() * found.shapes[chosen]
    values = np.linalg.norm(found.shapes[chosen], axis=2)
    seen = np.concatenate([found.position + moved, found.position - moved])
    renderer = Renderer(scene, seen, resolution=SIZE, coloring=ColorScale("displacement", 1.0), device="cpu")

    def image(k: int, phase: float) -> NDArray[np.uint8]:
        return renderer.bare(found.position + phase * moved[k], values=abs(phase) * values[k])

    if options.plot is not None:
        titles = [f"{k + 1}: {found.frequencies[k]:.4g} Hz" for k in chosen]
        about = f"{name}: modes, from blue (at rest) to yellow (the largest displacement)"
        plot_pictures([image(k, 1.0) for k in range(len(chosen))], titles, about, options.plot)
    if options.films is not None:
        for k, number in enumerate(chosen.tolist()):
            images = (image(k, math.sin(2 * math.pi * n / FRAMES)) for n in range(FRAMES))
            write_film(images, options.films, name=_film(options.films, number).stem, fps=FPS, frames="none")
