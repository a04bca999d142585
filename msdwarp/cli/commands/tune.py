"""Tune a scene from the command line: errors and costs of all methods, and the chosen method."""

import math

from rich.console import Console
from rich.table import Table

from ...integrators import DEFAULT
from ...studies import as_fast, cheapest, tune
from ...world import Scene
from ..options import TuneOptions
from ..process import status_on
from ..scene_files import Origin


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
        low, high = (1e3 * bound for bound in one.seconds_between)
        seconds = "" if math.isnan(one.seconds) else f"{1e3 * one.seconds:.1f} ms ({low:.1f} to {high:.1f})"
        table.add_row(one.method, one.precision, str(one.substeps), f"{one.error:.1e}", seconds, style=style)
    Console().print(table)
    default = next((one for one in found if one.method == DEFAULT), None)
    print(
        f"cheapest under {options.tolerance:g}: --integrator {best.method} --precision {best.precision} "
        f"--substeps {best.substeps}"
    )
    if default is None:
        compared = f"the default, {DEFAULT}, diverged"
    elif default is best:
        compared = "the default"
    else:
        between = zip(default.seconds_between, reversed(best.seconds_between), strict=True)
        least, most = (one / other for one, other in between)
        compared = (
            f"{default.seconds / best.seconds:.2g} times ({least:.2g} to {most:.2g}) as fast as the default "
            f"({default.method}, {default.substeps} substeps, error {default.error:.1e})"
        )
    print(f"error {best.error:.1e}, {compared}")
    for one in as_fast(found, options.tolerance):
        print(f"as fast, by what was measured: {one.method}, {one.precision}, {one.substeps} substeps")
