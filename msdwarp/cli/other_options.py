"""The flags of the commands beside `run` that take a scene, whatever the scene."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .integer_flags import Whole, WholeOrAuto, WholeOrWord
from .options import ForceAlgorithmName, MethodName, Options, Pictures, PrecisionName


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """The flags of every view, whatever the scene.

    Parameters
    ----------
    browser
        Show it in a browser, even if there is a display.
    window
        Show it in a window, even if no display is found.
    host
        Address to serve the page at. With the default only this machine can open it.
    port
        Port of the page. Default: 8080, or the next free one.
    allow_origin
        Origins of other pages that may control this one, such as https://lab.example; may be repeated.
    paused
        Start paused, at the first frame.
    device
        Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none.
    precision
        Floating-point precision. Default: float32.
    force_algorithm
        How forces are summed; this affects speed only. auto picks the fastest.
    integrator
        Time-stepping method. Default: symplectic-euler.
    substeps
        Integrator steps per frame; auto picks them from the scene's stability limit.
    fps
        Frames per second of simulated time.
    renderer
        Renderer of snapshots and films: raster, raycast, opengl, or auto. See `msdwarp run`.
    verbose
        Print messages from Warp and VTK too.
    """

    browser: Annotated[bool, Parameter(negative=())] = False
    window: Annotated[bool, Parameter(negative=())] = False
    host: str = "127.0.0.1"
    port: Whole | None = None
    allow_origin: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    paused: Annotated[bool, Parameter(negative=())] = False
    device: str | None = None
    precision: PrecisionName | None = None
    force_algorithm: ForceAlgorithmName = "auto"
    integrator: MethodName | None = None
    substeps: WholeOrAuto = "auto"
    fps: float = 60.0
    renderer: Literal["auto", "raster", "raycast", "opengl"] = "auto"
    verbose: Annotated[bool, Parameter(negative=())] = False

    @property
    def of_run(self) -> Options:
        """The same as the options of a run."""
        return Options(
            device=self.device,
            precision=self.precision,
            force_algorithm=self.force_algorithm,
            integrator=self.integrator,
            substeps=self.substeps,
            fps=self.fps,
        )


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """The flags of every tuning, whatever the scene.

    Parameters
    ----------
    tolerance
        Largest allowed error, as a fraction of the body's size.
    horizon
        Simulated time after which errors are measured [s].
    device
        Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none.
    verbose
        Print Warp's messages too.
    """

    tolerance: float = 1e-3
    horizon: float = 1.0
    device: str | None = None
    verbose: Annotated[bool, Parameter(negative=())] = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The flags of every fit, whatever the scene.

    Parameters
    ----------
    parameters
        Parameters to fit, separated by commas: stiffness, damping, rest_length, mass, friction, gravity. The
        search starts from the scene's values, or from those given: stiffness=500,damping.
    bounds
        Bounds of parameters: stiffness=100:2000,damping=0.1:5. Default: from 1/10 to 10 times the start.
    noise
        Standard deviation of the measurement noise, in the unit of the data.
    loss
        Loss function. All but linear give large residuals less weight, and need --noise.
    horizon
        growing fits a short time first, then longer ones; whole fits the whole time at once.
    starts
        Number of starting points of the search.
    substeps
        Integrator steps per frame; auto picks a number that is stable within the bounds, and more in the end if
        the values depend on it.
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


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Undrawn(Pictures):
    """What to draw of each point: nothing, if nothing is asked for."""

    frames: Literal["png", "none"] = "none"
    video: Literal["webp", "mp4", "gif", "none"] = "none"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SweepOptions(Options):
    """The flags of every sweep, whatever the scene.

    Parameters
    ----------
    out
        Folder of the sweep. An earlier sweep in it is continued. Default: out/SCENE_sweep.
    jobs
        Number of processes; auto takes one for each GPU, or one for each core if there is no GPU. With ensemble,
        points that differ only in numbers such as stiffness are simulated together in one process (with --keep
        summary).
    keep
        What to keep of each point: the whole run, as `msdwarp run` does, or only a summary.
    """

    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None
    pictures: Pictures = field(default_factory=Undrawn)
    jobs: WholeOrWord = "auto"
    keep: Literal["run", "summary"] = "run"

    def of_a_run(self, folder: Path, keeps_files: bool) -> Options:
        """Return the options of the run of a point in a folder."""
        options = Options(**{one.name: getattr(self, one.name) for one in fields(Options)})
        options = replace(options, out=folder, quiet=True, force=False)
        if not keeps_files:
            options = replace(options, trajectory="none", pictures=Undrawn(), restart=0.0, log=None)
        return options
