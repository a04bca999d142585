"""Fitting a scene's parameters to measured motion from the command line."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from .. import checks
from ..integrators import METHODS
from ..studies import Fitted, fit
from ..world import Scene
from .options import MethodName
from .scene_files import Origin
from .whole import Whole, WholeOrAuto


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The flags of every fit, whatever the scene.

    Parameters
    ----------
    parameters
        What to fit, separated by commas: stiffness, damping, rest_length, mass, friction, gravity. The search
        starts from the scene's values, or from those given: stiffness=500,damping.
    bounds
        Bounds of parameters: stiffness=100:2000,damping=0.1:5. Default: from a tenth of the start to ten times
        it.
    noise
        Standard deviation of the measurement's noise, in the unit of the data.
    loss
        Loss function. All but linear give large differences less weight, and need --noise.
    horizon
        growing fits a short time first and then longer ones; whole fits all of it at once.
    starts
        Number of starting points of the search.
    substeps
        Integrator steps per frame; auto picks what is stable within the bounds.
    fps
        Frames per second of simulated time. Default: those of the file.
    integrator
        Time-stepping method. Default: leapfrog-extrapolated.
    precision
        Floating-point precision.
    device
        Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none.
    plot
        Plot the residuals to this file, such as residuals.png.
    quiet
        Print the values only.
    verbose
        Print Warp's messages too.
    """

    parameters: str = "stiffness,damping"
    bounds: str = ""
    noise: float | None = None
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = "linear"
    horizon: Literal["growing", "whole"] = "growing"
    starts: Whole = 1
    substeps: WholeOrAuto = "auto"
    fps: float | None = None
    integrator: MethodName = "leapfrog-extrapolated"
    precision: Literal["float64", "float32-compensated", "float32"] = "float64"
    device: str | None = None
    plot: Path | None = None
    quiet: Annotated[bool, Parameter(negative=())] = False
    verbose: Annotated[bool, Parameter(negative=())] = False


def fit_scene(measured: str, origin: Origin, scene: Scene, options: FitOptions) -> None:
    """Print the parameters with which a scene moves as a file says it was measured.

    Raises
    ------
    ValueError
        If an option is out of its range, or the file does not belong to the scene.
    OSError
        If there is no such file.
    """
    if not Path(measured).is_file():
        raise FileNotFoundError(f"measured is {measured}, which is no file; it must be a CSV file or a trajectory")
    with warnings.catch_warnings(record=True) as doubts, Console(stderr=True).status("fitting") as status:
        warnings.simplefilter("always", checks.DoubtfulFit)
        found = fit(
            scene,
            measured,
            _starts(options.parameters),
            bounds=_bounds(options.bounds),
            noise=options.noise,
            loss=options.loss,
            horizon=options.horizon,
            starts=options.starts,
            fps=options.fps,
            substeps=options.substeps,
            integrator=METHODS[options.integrator],
            precision=options.precision,
            device=options.device,
            report=lambda line: status.update(f"fitting: {line}"),
        )
    if options.quiet:
        for name, value in found.values.items():
            print(f"{name} {value:.8g}")
    else:
        _print(origin.name, found)
    for one in doubts:
        Console(stderr=True, soft_wrap=True).print(f"note: {one.message}", markup=False, highlight=False)
    if options.plot is not None:
        found.plot(options.plot)


def _print(name: str, found: Fitted) -> None:
    """Print a table of the values, and what is left over."""
    table = Table(title=f"{name}: {found.runs} worlds of {found.substeps} substeps a frame")
    for heading in ("parameter", "value", "standard deviation", "unit"):
        table.add_column(heading, justify="right" if heading in ("value", "standard deviation") else "left")
    for one, deviation in found.standard_deviations.items():
        table.add_row(one, f"{found.values[one]:.6g}", f"{deviation:.2g}", found.units[one])
    Console().print(table)
    for one, size in found.residual_size.items():
        print(f"left over, root mean square: {one} {size:.3g} {found.residual_units[one]}".rstrip())
    if found.alone:
        print(f"worlds were simulated one after the other: {found.alone}")


def _starts(text: str) -> dict[str, float | None]:
    """Return what "stiffness=500,damping" says."""
    starts: dict[str, float | None] = {}
    for word in text.split(","):
        name, says, value = word.strip().partition("=")
        if name in starts:
            raise ValueError(f"parameters is {text!r}; each must be named once")
        starts[name] = _number("parameters", text, value) if says else None
    return starts


def _bounds(text: str) -> dict[str, tuple[float, float]]:
    """Return what "stiffness=100:2000" says."""
    bounds = {}
    for word in filter(None, text.split(",")):
        name, _, both = word.strip().partition("=")
        low, _, high = both.partition(":")
        bounds[name] = (_number("bounds", text, low), _number("bounds", text, high))
    return bounds


def _number(flag: str, text: str, word: str) -> float:
    """Return a number of a flag; raise ValueError that says how the flag is written."""
    example = {"parameters": "stiffness=500,damping", "bounds": "stiffness=100:2000,damping=0.1:5"}[flag]
    try:
        return float(word)
    except ValueError as error:
        raise ValueError(f"{flag} is {text!r}; it must be written as in {example}") from error
