"""Options: the flags of every run, whatever its scene."""

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from cyclopts import Parameter

from .integer_flags import Whole, WholeOrAuto
from .results import overlay_path

if TYPE_CHECKING:  # `--help` needs none of it, and so imports neither Warp nor NumPy
    from ..world import Look

MethodName = Literal[
    "symplectic-euler", "leapfrog", "leapfrog-extrapolated", "rk4", "rkc2", "linearly-implicit-euler"
]
PrecisionName = Literal["float32", "float32-compensated", "float64"]
ForceAlgorithmName = Literal["auto", "scatter", "gather", "stencil"]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What to draw.

    Parameters
    ----------
    frames
        Image format of the frames; none writes no images.
    video
        Film format; none writes no film. mp4 needs `pip install 'msdwarp[video]'`.
    overlay
        Draw this many poses into one picture, SCENE_overlay.png. They are evenly spaced in time.
    resolution
        Width and height of the pictures in pixels.
    azimuth
        Camera angle around the vertical, counter-clockwise from +x [degrees]. Default: set by the scene.
    elevation
        Camera angle above the horizon [degrees]. Default: set by the scene.
    zoom
        Zoom factor; 1 fits everything.
    colour
        What the colours show: the texture, the strain of connections (blue: shorter than at rest, red: longer), or
        the velocity, energy or contact force of particles. Default: set by the scene.
    full_strain
        Strain at the ends of the colour scale. Default: set by the scene, or fitted to the run.
    arrows
        Draw contact forces as arrows, in front of the bodies.
    renderer
        Renderer: opengl (PyVista), raster (on the CPU), raycast (on a GPU if there is one), or auto: raycast if
        the simulation runs on a GPU, else opengl if it is found, else raster.
    """

    frames: Literal["png", "none"] = "png"
    video: Literal["webp", "mp4", "gif", "none"] = "webp"
    overlay: Whole | None = None
    resolution: str = "1280x720"
    colour: Literal["texture", "strain", "velocity", "energy", "contact"] | None = None
    full_strain: float | None = None
    arrows: Annotated[bool, Parameter(negative=())] = False
    azimuth: float | None = None
    elevation: float | None = None
    zoom: float = 1.0
    renderer: Literal["auto", "raster", "raycast", "opengl"] = "auto"

    @property
    def any(self) -> bool:
        """Whether anything is to be drawn."""
        return self.overlay is not None or not self.frames == self.video == "none"

    @property
    def of_contact(self) -> bool:
        """Whether contact forces are to be shown."""
        return self.arrows or self.colour == "contact"

    def are_in(self, folder: Path, name: str, frame_count: int) -> bool:
        """Tell whether all that is to be drawn of so many frames has been."""
        wanted = [] if self.overlay is None else [overlay_path(folder, name)]
        wanted += [] if self.video == "none" else [folder / f"{name}.{self.video}"]
        wanted += [] if self.frames == "none" else [folder / f"frame_{frame_count - 1:04d}.{self.frames}"]
        return all(path.exists() for path in wanted)

    def turned(self, look: "Look") -> "Look":
        """Return a look from where the camera is to stand."""
        return replace(look, **self._turned())

    def _turned(self) -> dict[str, Any]:
        angles = {"azimuth": self.azimuth, "elevation": self.elevation}
        return {name: angle for name, angle in angles.items() if angle is not None}

    def check(self, frame_count: int) -> None:
        """Raise ValueError unless so many frames can be drawn."""
        from .. import checks
        from ..pictures import check_formats, no_opengl
        from ..world import Look

        check_formats(self.frames, self.video)
        parse_resolution(self.resolution)
        checks.positive("zoom", self.zoom)
        if self.renderer == "opengl" and (why := no_opengl()) is not None:
            raise ValueError(f"renderer is opengl, which cannot draw here; it must be another one or auto: {why}")
        if self.full_strain is not None:
            checks.positive("full_strain", self.full_strain)
        Look(**self._turned())  # which checks the angles
        if self.overlay is not None and checks.count("overlay", self.overlay, 2) > frame_count:
            raise ValueError(
                f"overlay is {self.overlay}; it must be at most the number of frames drawn, {frame_count}"
            )


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
class Options:
    """The flags of every run, whatever the scene.

    Parameters
    ----------
    device
        Device to simulate on: cpu, cuda:0 ... Default: the first GPU, or the CPU if there is none.
    precision
        Floating-point precision. Default: float32.
    force_algorithm
        How forces are summed; this affects speed only. auto picks the fastest. On a GPU, gather and stencil
        repeat a run bit for bit; scatter does not.
    threads
        Threads of the CPU that share the work; this affects speed only. auto: one for each core, fewer for small
        bodies.
    integrator
        Time-stepping method. Default: symplectic-euler.
    substeps
        Integrator steps per frame; auto picks them from the scene's stability limit.
    allow_unstable
        Accept a step beyond the stability limit.
    tolerance
        Pick integrator, precision and substeps so that the error stays below this fraction of the body's size
        (see `msdwarp tune`).
    duration
        Simulated time [s]. Default: set by the scene.
    fps
        Frames per second of simulated time.
    out
        Folder for the results. Default: out/SCENE, or out/SCENE-2 ... if that exists.
    trajectory
        How to store frames in trajectory.vtkhdf, which ParaView opens: plain, compressed (smaller, slower), or
        none.
    every
        Keep and draw only every Nth frame.
    strain
        Store the strain of every connection. In a lattice this makes the file about three times as large.
    contact_forces
        Store the contact force on every particle. --arrows and --colour contact store it too.
    restart
        Write restart.h5 every N seconds of computing, and at the end; `msdwarp resume` continues from it. 0 writes
        none.
    log
        Write energies, momentum and strain of every frame to this CSV file, and a plot beside it. A bare name
        such as energy.csv goes into the run's folder; ./energy.csv goes into the current one.
    force
        Overwrite earlier results in --out and --log.
    quiet
        Print errors only.
    verbose
        Print messages from Warp and VTK too.
    """

    device: str | None = None
    precision: PrecisionName | None = None
    force_algorithm: ForceAlgorithmName = "auto"
    threads: WholeOrAuto = "auto"
    integrator: MethodName | None = None
    substeps: WholeOrAuto = "auto"
    allow_unstable: Annotated[bool, Parameter(negative=())] = False
    tolerance: float | None = None
    duration: float | None = None
    fps: float = 60.0
    out: Path | None = None
    pictures: Pictures = field(default_factory=Pictures)
    trajectory: Literal["plain", "compressed", "none"] = "plain"
    every: Whole = 1
    strain: bool = True
    contact_forces: Annotated[bool, Parameter(negative=())] = False
    restart: float = 60.0
    log: str | None = None
    force: Annotated[bool, Parameter(negative=())] = False
    quiet: Annotated[bool, Parameter(negative=())] = False
    verbose: Annotated[bool, Parameter(negative=())] = False

    def check(self, last: int) -> None:
        """Raise ValueError unless a run up to frame `last` can be kept and drawn as they say."""
        from .. import checks

        checks.non_negative("restart", self.restart)
        self.pictures.check(last // checks.count("every", self.every, 1) + 1)

    @property
    def sums_contact(self) -> bool:
        """Whether contact forces are to be kept, or shown."""
        return self.contact_forces or self.pictures.of_contact

    @property
    def logs_in_folder(self) -> bool:
        """Whether the log goes into the run's folder."""
        return self.log is not None and not os.path.dirname(self.log)

    def log_path(self, folder: Path | None) -> Path | None:
        """Return the file of the log of a run in a folder, if there is one."""
        if self.log is None:
            return None
        return folder / self.log if self.logs_in_folder and folder is not None else Path(self.log)

    def as_stored(self) -> dict[str, Any]:
        """Return them as JSON has them."""
        log = self.log
        if log is not None and not self.logs_in_folder:
            log = str(Path(log).absolute())  # for whoever goes on from another folder
        return asdict(self) | {"out": self.out and str(self.out), "log": log}

    @classmethod
    def stored(cls, values: Mapping[str, Any], **changes: Any) -> "Options":
        """Return what `as_stored` gave, with changes; raise ValueError where a later version, or none, stored it.

        What an earlier version did not know is as it is by default: so it was then.
        """
        from .. import checks

        values = dict(checks.mapping("the run's options", values))
        if "route" in values:  # its name in version 0.1
            values["force_algorithm"] = values.pop("route")
        pictures = checks.mapping("the run's pictures", values.get("pictures", {}))
        unknown = (values.keys() - _names(cls)) | (pictures.keys() - _names(Pictures))
        if unknown:
            raise ValueError(f"the run's options are those of a later version of msdwarp: {sorted(unknown)}")
        own = {name: value for name, value in {**values, **changes}.items() if name != "pictures"}
        for kind, given in ((cls, own), (Pictures, pictures)):
            hints = get_type_hints(kind)
            for name, value in given.items():
                if not _fits(value, hints[name]):
                    raise ValueError(f"the run's {name} is {checks.repr_short(value)}, which no run stores")
        out = {"out": values.get("out") and Path(values["out"])}
        return cls(**{**values, **out, "pictures": Pictures(**pictures), **changes})


def _fits(value: Any, kind: Any) -> bool:
    """Tell whether a value of JSON is one of a type that an option has."""
    if get_origin(kind) in (Union, UnionType):
        return any(_fits(value, one) for one in get_args(kind))
    if get_origin(kind) is Literal:
        return any(type(value) is type(one) and value == one for one in get_args(kind))
    kinds = {float: (int, float), Path: str}.get(kind, kind)
    return isinstance(value, kinds) and (kind is bool or not isinstance(value, bool))


def _names(options: type) -> set[str]:
    return {one.name for one in fields(options)}
