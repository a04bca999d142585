"""Options: the flags that commands on a scene have for every scene."""

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter

from .results import overlay_path, pass_path

if TYPE_CHECKING:
    from ..world import Look, Plane

# Flags that several commands share, with their help.
Flag = Annotated[bool, Parameter(negative=())]
Device = Annotated[
    str | None,
    Parameter(help="Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none."),
]
PrecisionName = Literal["float32", "float32-compensated", "float64"]
MethodName = Literal[
    "symplectic-euler", "leapfrog", "leapfrog-extrapolated", "rk4", "rkc2", "linearly-implicit-euler"
]
IntOrAuto = int | Literal["auto"]
Color = Literal["texture", "strain", "velocity", "energy", "stress", "contact"]
Bodies = Annotated[
    tuple[str, ...],
    Parameter(
        negative=(),
        help="Draw this group of particles only, such as a body; may be repeated. The name obstacles adds these. "
        "Default: everything.",
    ),
]
Cut = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        help="Cut the bodies by a plane, and show what is inside: its normal and its offset [m], such as 0,-1,0 "
        "or 0,0,1,0.5. What is above it at the start is not drawn. Default: set by the scene, or no cut.",
    ),
]
RendererName = Literal["auto", "raster", "raycast", "opengl"]
Quiet = Annotated[bool, Parameter(negative=(), help="Print errors only.")]
Verbose = Annotated[bool, Parameter(negative=(), help="Print messages from Warp and VTK too.")]
FrameFormat = Literal["png", "none"]
FilmFormat = Literal["webp", "mp4", "gif", "none"]


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """Where the camera stands."""

    azimuth: float | None = None
    """Camera angle around the vertical, counter-clockwise from +x [degrees]. Default: set by the scene."""
    elevation: float | None = None
    """Camera angle above the horizon [degrees]. Default: set by the scene."""
    target: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Point in the middle of the picture, such as 0,0,0.5 [m]. Default: set by the scene, or fitted to the run;
    bodies that travel are followed."""
    distance: float | None = None
    """Distance of the camera from the target [m]. Default: set by the scene, or so that all that moves is in
    view."""
    field_of_view: float | None = None
    """Vertical field of view of the camera [degrees]. Default: set by the scene, or 30."""
    follow: str | None = None
    """Name of a body of the scene with which the camera moves. Default: set by the scene, or none."""
    zoom: float = 1.0
    """Zoom factor; 1 fits everything."""

    @property
    def camera(self) -> dict[str, Any]:
        """The given camera fields of a `Look`; raise ValueError if the target is no point."""
        names = ("azimuth", "elevation", "distance", "field_of_view", "follow")
        given: dict[str, Any] = {name: getattr(self, name) for name in names}
        if self.target is not None:
            try:
                given["target"] = tuple(map(float, self.target.split(",")))
            except ValueError:
                raise ValueError(f"target is {self.target!r}; it must be X,Y,Z, such as 0,0,0.5") from None
        return {name: value for name, value in given.items() if value is not None}

    def aimed(self, look: "Look") -> "Look":
        """Return a scene's look, with the camera that these flags set."""
        given = self.camera
        # A body to follow and a target exclude each other: the given one replaces the scene's.
        if self.target is not None and self.follow is None:
            given["follow"] = None
        if self.follow is not None and self.target is None:
            given["target"] = None
        if given.keys() - {"field_of_view"}:
            given["path"] = ()  # a given position replaces the camera's path
        return replace(look, **given)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Pictures(CameraOptions):
    """What to draw."""

    frames: FrameFormat = "png"
    """Image format of the frames; none writes no images."""
    video: FilmFormat = "webp"
    """Film format; none writes no film. mp4 needs `pip install 'msdwarp[video]'`."""
    overlay: int | None = None
    """Draw this many poses into one picture, SCENE_overlay.png. They are evenly spaced in time."""
    resolution: str = "1280x720"
    """Width and height of the pictures in pixels."""
    color: Color | None = None
    """What the colors show: the texture, the strain of connections (blue: shorter than at rest, red: longer), or
    the velocity, energy, stress (von Mises; bodies with a Poisson's ratio) or contact force of particles. Default:
    set by the scene."""
    body: Bodies = ()
    floor: Literal["chequered", "plain", "shadows", "none"] | None = None
    """How the ground is drawn: chequered, plain, none, or shadows alone, in the color of the background. Default:
    set by the scene."""
    shutter: float = 0.0
    """Motion blur: the time that a picture of the film is exposed, over the time between two. 0.5 is that of a
    film camera, 0 none."""
    samples: int | None = None
    """Number of pictures whose mean a picture with motion blur is, or a still. Default: 8, and 64 for a still."""
    passes: Annotated[tuple[Literal["depth", "mask"], ...], Parameter(negative=())] = ()
    """Write beside each picture of the film, for compositing, the distance of what is seen from the camera
    (depth_0000.tif) or which body it is (mask_0000.png, with names in masks.json); may be repeated."""
    transparent: Flag = False
    """Draw no background: PNG and WebP files have an opacity."""
    full_strain: float | None = None
    """Strain at the ends of the color scale. Default: set by the scene, or fitted to the run."""
    cut: Cut = None
    arrows: Flag = False
    """Draw contact forces as arrows, in front of the bodies."""
    renderer: RendererName = "auto"
    """Renderer: opengl (PyVista), raster (on the CPU), raycast (on a GPU if there is one), or auto: raycast if the
    simulation runs on a GPU, else opengl if a graphics card draws it, else raster."""

    @property
    def plane(self) -> "Plane | None":
        """The plane that cuts the bodies, if one is given; raise ValueError if it is none."""
        if self.cut is None:
            return None
        from ..world import Plane

        try:
            x, y, z, *offset = map(float, self.cut.split(","))
            (offset,) = offset or [0.0]
            return Plane((x, y, z), offset)
        except ValueError as error:
            raise ValueError(
                f"cut is {self.cut!r}; it must be X,Y,Z or X,Y,Z,OFFSET, such as 0,-1,0 or 0,0,1,0.5"
            ) from error

    def aimed(self, look: "Look") -> "Look":
        """Return a scene's look, with the camera and the cut that these flags set."""
        return super().aimed(look if self.cut is None else replace(look, cut=self.plane))

    @property
    def any(self) -> bool:
        """Whether anything is to be drawn."""
        return self.overlay is not None or bool(self.passes) or not self.frames == self.video == "none"

    def are_in(self, folder: Path, name: str, frame_count: int) -> bool:
        """Return whether a folder has all pictures of a run with `frame_count` frames."""
        wanted = [] if self.overlay is None else [overlay_path(folder, name)]
        wanted += [] if self.video == "none" else [folder / f"{name}.{self.video}"]
        wanted += [pass_path(folder, name, frame_count - 1) for name in self.passes]
        wanted += [] if self.frames == "none" else [folder / f"frame_{frame_count - 1:04d}.{self.frames}"]
        return all(path.exists() for path in wanted)

    def check(self, frame_count: int) -> None:
        """Raise ValueError unless `frame_count` frames can be drawn."""
        from .. import checks
        from ..pictures import check_formats, no_opengl
        from ..world import Look

        check_formats(self.frames, self.video, self.transparent)
        parse_resolution(self.resolution)
        checks.positive("zoom", self.zoom)
        if self.renderer == "opengl" and (why := no_opengl()) is not None:
            raise ValueError(f"renderer is opengl, which cannot draw here; it must be another one or auto: {why}")
        if self.full_strain is not None:
            checks.positive("full_strain", self.full_strain)
        checks.between("shutter", self.shutter, 0, 1)
        if self.samples is not None:
            checks.count("samples", self.samples, 1)
        Look(**self.camera, cut=self.plane)  # checks the fields
        if self.overlay is not None and checks.count("overlay", self.overlay, 2) > frame_count:
            raise ValueError(
                f"overlay is {self.overlay}; it must be at most the number of frames drawn, {frame_count}"
            )
        if self.transparent and self.overlay is not None:
            raise ValueError("overlay is given; it must not be with a transparent background")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True, kw_only=True)
class PicturesAgain(Pictures):
    """What to draw of a run that goes on: what it was to draw, but for the flags that are given."""

    given: ClassVar[Mapping[str, Any]] = {}

    def __new__(cls, **given: Any) -> "PicturesAgain":
        """Keep which flags are given, to tell them from defaults."""
        one = super().__new__(cls)
        object.__setattr__(one, "given", given)
        return one

    def over(self, before: Pictures) -> Pictures:
        """Return what was to be drawn before, changed by the flags that are given."""
        return replace(before, **self.given)


def flattened(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return stored options as one flat mapping, without nested options of pictures."""
    flat = {**options, **options.get("pictures", {})}
    return {name: value for name, value in flat.items() if name != "pictures"}


def parse_resolution(text: str) -> tuple[int, int]:
    """Return (width, height) of "WIDTHxHEIGHT"; raise ValueError unless both are even, from 64 to 16384."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = tuple(map(int, match.groups())) if match else ()
    if len(size) != 2 or any(not 64 <= n <= 16384 or n % 2 for n in size):
        raise ValueError(
            f"resolution is {text!r}; it must be WIDTHxHEIGHT, both even and from 64 to 16384, such as 1280x720"
        )
    return size


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
class NoPictures(Pictures):
    """What to draw for each point of a sweep: nothing by default."""

    frames: FrameFormat = "none"
    video: FilmFormat = "none"


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
