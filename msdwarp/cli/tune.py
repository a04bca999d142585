"""Tune a scene from the command line: errors and costs of all methods, and the chosen method."""

import math

from rich.console import Console
from rich.table import Table

from ..integrators import DEFAULT
from ..studies import cheapest, tune
from ..world import Scene
from .options import TuneOptions
from .process import status_on
from .scene_files import Origin


def tune_scene(origin: Origin, scene: Scene, options: TuneOptions) -> None:
    """Print every method's error and cost on a scene, and the flags of the fastest within the tolerance."""
    with status_on(Console(stderr=True), "tuning") as report:
        device, horizon = options.device, options.horizon
        found, horizon = tune(scene, options.tolerance, device=device, horizon=horizon, report=report)
    best = cheapest(found, options.tolerance)
    table = Table(title=f"{origin.name}: the first {horizon:.3g} s, error as a fraction of its size")
    for heading in ("method", "precision", "substeps", "error", "time per second"):
        table.add_column(heading, justify="left" if heading in ("method", "precision") else "right")
    for one in found:
        style = "bold" if one is best else ("" if one.error <= options.tolerance else "dim")
        seconds = "" if math.isnan(one.seconds) else f"{1e3 * one.seconds:.1f} ms"
        table.add_row(one.method, one.precision, str(one.substeps), f"{one.error:.1e}", seconds, style=style)
    Console().print(table)
    default = next((one for one in found if one.method == DEFAULT), None)
    print(
        f"cheapest under {options.tolerance:g}: --integrator {best.method} --precision {best.precision} "
        f"--substeps {best.substeps}"
    )
    compared = f"the default, {DEFAULT}, diverged"
    if default is not None:
        compared = (
            f"{default.seconds / best.seconds:.2g} times as fast as the default "
            f"({default.method}, {default.substeps} substeps, error {default.error:.1e})"
        )
    print(f"error {best.error:.1e}, {compared}")
