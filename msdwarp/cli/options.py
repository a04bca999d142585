"""Options: the flags that commands on a scene have for every scene."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .picture_options import CameraOptions, Flag, NoPictures, Pictures, RendererName

# Flags that several commands share, with their help.
Device = Annotated[
    str | None,
    Parameter(help="Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none."),
]
PrecisionName = Literal["float32", "float32-compensated", "float64"]
MethodName = Literal[
    "symplectic-euler", "leapfrog", "leapfrog-extrapolated", "rk4", "rkc2", "linearly-implicit-euler"
]
IntOrAuto = int | Literal["auto"]
Quiet = Annotated[bool, Parameter(negative=(), help="Print errors only.")]
Verbose = Annotated[bool, Parameter(negative=(), help="Print messages from Warp and VTK too.")]


def flattened(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return stored options as one flat mapping, without nested options of pictures."""
    flat = {**options, **options.get("pictures", {})}
    return {name: value for name, value in flat.items() if name != "pictures"}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How a scene is simulated."""

    device: Device = None
    precision: PrecisionName | None = None
    """Floating-point precision. Default: float32."""
    force_algorithm: Literal["auto", "scatter", "gather", "stencil"] = "auto"
    """How forces are summed; this affects speed only. auto picks the fastest. On a GPU, gather and stencil repeat
    a run bit for bit; scatter does not."""
    integrator: MethodName | None = None
    """Time-stepping method. Default: symplectic-euler."""
    substeps: IntOrAuto = "auto"
    """Integrator steps per frame; auto picks them from the scene's stability limit."""
    fps: float = 60.0
    """Frames per second of simulated time."""


@dataclass(frozen=True, kw_only=True)
class Options(SimulationOptions):
    """The flags of every run, whatever the scene."""

    threads: IntOrAuto = "auto"
    """Threads of the CPU that share the work; this affects speed only. auto: one for each core, fewer for small
    bodies."""
    allow_unstable: Flag = False
    """Accept a step beyond the stability limit."""
    tolerance: float | None = None
    """Pick integrator, precision and substeps so that the error stays below this fraction of the body's size (see
    `msdwarp tune`)."""
    settle: Flag = False
    """Start from static equilibrium: do not wait until the body has come to rest."""
    duration: float | None = None
    """Simulated time [s]. Default: set by the scene."""
    out: Path | None = None
    """Folder for the results. Default: out/SCENE, or out/SCENE-2 ... if that exists."""
    pictures: Pictures = field(default_factory=Pictures)
    trajectory: Literal["plain", "compressed", "none"] = "plain"
    """How to store frames in trajectory.vtkhdf, which ParaView opens: plain, compressed (smaller, slower), or
    none."""
    every: int = 1
    """Keep and draw only every Nth frame."""
    strain: bool = True
    """Store the strain of every connection. In a lattice this makes the file about three times as large."""
    contact_forces: Flag = False
    """Store the contact force on every particle. --arrows and --color contact store it too."""
    restart: float = 60.0
    """Write restart.h5 every N seconds of computing, and at the end; `msdwarp resume` continues from it. 0 writes
    none."""
    log: str | None = None
    """Write energies, momentum and strain of every frame to this CSV file, and a plot beside it. A bare name such
    as energy.csv goes into the run's folder; ./energy.csv goes into the current one."""
    force: Flag = False
    """Overwrite earlier results in --out and --log."""
    quiet: Quiet = False
    verbose: Verbose = False

    def check(self, last: int) -> None:
        """Raise ValueError unless a run up to frame `last` can be stored and drawn with these options."""
        from .. import checks

        checks.non_negative("restart", self.restart)
        self.pictures.check(last // checks.count("every", self.every, 1) + 1)

    @property
    def sums_contact(self) -> bool:
        """Whether contact forces are stored or shown."""
        return self.contact_forces or self.pictures.arrows or self.pictures.color == "contact"

    @property
    def logs_in_folder(self) -> bool:
        """Whether the log goes into the run's folder."""
        return self.log is not None and not os.path.dirname(self.log)

    def log_path(self, folder: Path | None) -> Path | None:
        """Return the path of a run's log, which may be in `folder`; None if there is no log."""
        if self.log is None:
            return None
        return folder / self.log if self.logs_in_folder and folder is not None else Path(self.log)

    def as_stored(self) -> dict[str, Any]:
        """Return the options as JSON data."""
        log = self.log
        if log is not None and not self.logs_in_folder:
            log = str(Path(log).absolute())  # the run may be resumed from another folder
        pictures = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self.pictures).items()}
        return asdict(self) | {"out": self.out and str(self.out), "log": log, "pictures": pictures}


@dataclass(frozen=True, kw_only=True)
class ViewOptions(CameraOptions, SimulationOptions):
    """The flags of every view, whatever the scene."""

    browser: Flag = False
    """Show it in a browser, even if there is a display."""
    window: Flag = False
    """Show it in a window, even if no display is found."""
    host: str = "127.0.0.1"
    """Address to serve the page at. With the default only this machine can open it."""
    port: int | None = None
    """Port of the page. Default: 8080, or the next free one."""
    allow_origin: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    """Origins of other pages that may control this one, such as https://lab.example; may be repeated."""
    paused: Flag = False
    """Start paused, at the first frame."""
    renderer: RendererName = "auto"
    """Renderer of snapshots and films: raster, raycast, opengl, or auto. See `msdwarp run`."""
    verbose: Verbose = False

    @property
    def run_options(self) -> Options:
        """Options of a run that simulates in the same way."""
        return Options(**{one.name: getattr(self, one.name) for one in fields(SimulationOptions)})


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """The flags of every tuning, whatever the scene."""

    tolerance: float = 1e-3
    """Largest allowed error, as a fraction of the body's size."""
    horizon: float = 1.0
    """Simulated time after which errors are measured [s]."""
    device: Device = None
    verbose: Verbose = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ModesOptions:
    """The flags of every search for modes, whatever the scene."""

    modes: int = 10
    """Number of modes, the slowest ones; motions of rigid bodies count."""
    settle: Flag = False
    """Settle the scene first: modes are those about its equilibrium under weight and other loads."""
    plot: Path | None = None
    """Draw the shapes into this file, such as modes.png."""
    films: Path | None = None
    """Write a film of each shape into this folder: mode_01.webp ..."""
    force: Flag = False
    """Overwrite existing files of --plot and --films."""
    verbose: Verbose = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """The flags of every fit, whatever the scene."""

    parameters: str = "stiffness,damping"
    """Parameters to fit, separated by commas: stiffness, damping, rest_length, mass, friction, gravity. The search
    starts from the scene's values, or from those given: stiffness=500,damping."""
    bounds: str = ""
    """Bounds of parameters: stiffness=100:2000,damping=0.1:5. Default: from 1/10 to 10 times the start."""
    noise: float | None = None
    """Standard deviation of the measurement noise, in the unit of the data."""
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = "linear"
    """Loss function. All but linear give large residuals less weight, and need --noise."""
    horizon: Literal["growing", "whole"] = "growing"
    """growing fits a short time first, then longer ones; whole fits the whole time at once."""
    starts: int = 1
    """Number of starting points of the search."""
    substeps: IntOrAuto = "auto"
    """Integrator steps per frame; auto picks a number that is stable within the bounds, and more in the end if the
    values depend on it."""
    fps: float | None = None
    """Frames per second of simulated time. Default: those of the file."""
    integrator: MethodName = "leapfrog-extrapolated"
    """Time-stepping method. Default: leapfrog-extrapolated."""
    precision: PrecisionName = "float64"
    """Floating-point precision."""
    device: Device = None
    plot: Path | None = None
    """Plot the residuals to this file, such as residuals.png."""
    force: Flag = False
    """Overwrite an existing file of --plot."""
    quiet: Flag = False
    """Print the values only."""
    verbose: Verbose = False


@dataclass(frozen=True, kw_only=True)
class SweepOptions(Options):
    """The flags of every sweep, whatever the scene."""

    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None
    """Folder of the sweep. An earlier sweep in it is continued. Default: out/SCENE_sweep."""
    pictures: Pictures = field(default_factory=NoPictures)
    jobs: int | Literal["auto", "ensemble"] = "auto"
    """Number of processes; auto takes one for each GPU, or one for each core if there is no GPU. With ensemble,
    points that differ only in numbers such as stiffness are simulated together in one process (with --keep
    summary)."""
    keep: Literal["run", "summary"] = "run"
    """What to keep of each point: the whole run, as `msdwarp run` does, or only a summary."""

    def run_options(self, folder: Path, keeps_files: bool) -> Options:
        """Return the options of a point's run in a folder."""
        options = Options(**{one.name: getattr(self, one.name) for one in fields(Options)})
        options = replace(options, out=folder, quiet=True, force=False)
        if not keeps_files:
            options = replace(options, trajectory="none", pictures=NoPictures(), restart=0.0, log=None)
        return options
