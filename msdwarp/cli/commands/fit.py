"""Fit a scene's parameters to measured motion from the command line."""

import warnings
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from ... import checks
from ...integrators import METHODS
from ...studies import FitResult, fit, output_path
from ...world import Scene
from ..options import FitOptions
from ..process import status_on
from ..scene_files import Origin


def fit_scene(measured: str, origin: Origin, scene: Scene, options: FitOptions) -> None:
    """Fit parameters to a measured motion, and print the result."""
    if not Path(measured).is_file():
        raise FileNotFoundError(f"measured is {measured}, which is no file; it must be a CSV file or a trajectory")
    if options.plot is not None:
        output_path(options.plot, ".png", options.force, "plot")
    talk = Console(stderr=True, quiet=options.quiet)
    names = ("noise", "loss", "horizon", "starts", "fps", "substeps", "precision", "device")
    how: dict[str, Any] = {name: getattr(options, name) for name in names}
    how |= {"bounds": _bounds(options.bounds), "integrator": METHODS[options.integrator]}

    def note(message: Warning | str, *_: Any) -> None:
        Console(stderr=True, soft_wrap=True).print(f"note: {message}", markup=False, highlight=False)

    with warnings.catch_warnings(), status_on(talk, "fitting") as report:
        warnings.simplefilter("always", checks.FitWarning)
        warnings.showwarning = note  # at once: some are about the measurements, before a long search
        found = fit(scene, measured, _starts(options.parameters), report=report, **how)
    if options.quiet:
        for name, value in found.values.items():
            print(f"{name} {value:.8g}")
    else:
        _print(origin.name, found)
    if options.plot is not None:
        found.plot(options.plot)


def _print(name: str, found: FitResult) -> None:
    table = Table("parameter", title=f"{name}: {found.runs} worlds of {found.substeps} substeps a frame")
    table.add_column("value", justify="right")
    table.add_column("standard deviation", justify="right")
    table.add_column("unit")
    for one, deviation in found.standard_deviations.items():
        table.add_row(one, f"{found.values[one]:.6g}", f"{deviation:.2g}", found.units[one])
    Console().print(table)
    for one, size in found.residual_size.items():
        print(f"left over, root mean square: {one} {size:.3g} {found.residual_units[one]}".rstrip())
    if found.alone:
        print(f"worlds were simulated one after the other: {found.alone}")


def _starts(text: str) -> dict[str, float | None]:
    """Return the starting values in "stiffness=500,damping"."""
    words = [word.strip().partition("=") for word in text.split(",")]
    starts = {name: _number("parameters", text, value) if given else None for name, given, value in words}
    if len(starts) < len(words):
        raise ValueError(f"parameters is {text!r}; each must be named once")
    return starts


def _bounds(text: str) -> dict[str, tuple[float, float]]:
    """Return the bounds in "stiffness=100:2000"."""
    bounds = {}
    for word in filter(None, text.split(",")):
        name, _, both = word.strip().partition("=")
        low, _, high = both.partition(":")
        bounds[name] = (_number("bounds", text, low), _number("bounds", text, high))
    return bounds


def _number(flag: str, text: str, word: str) -> float:
    """Return a number in a flag; raise ValueError, with an example of the flag, if the text is no number."""
    example = {"parameters": "stiffness=500,damping", "bounds": "stiffness=100:2000,damping=0.1:5"}[flag]
    try:
        return float(word)
    except ValueError as error:
        raise ValueError(f"{flag} is {text!r}; it must be written as in {example}") from error
