"""Options of pictures: the flags that say what is drawn, and where the camera stands."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from cyclopts import Parameter

from .results import overlay_path, pass_path

if TYPE_CHECKING:
    from ..world import Look, Plane

# Flags that several commands share, with their help.
Flag = Annotated[bool, Parameter(negative=())]
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


@dataclass(frozen=True, kw_only=True)
class NoPictures(Pictures):
    """What to draw for each point of a sweep: nothing by default."""

    frames: FrameFormat = "none"
    video: FilmFormat = "none"


def parse_resolution(text: str) -> tuple[int, int]:
    """Return (width, height) of "WIDTHxHEIGHT"; raise ValueError unless both are even, from 64 to 16384."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = tuple(map(int, match.groups())) if match else ()
    if len(size) != 2 or any(not 64 <= n <= 16384 or n % 2 for n in size):
        raise ValueError(
            f"resolution is {text!r}; it must be WIDTHxHEIGHT, both even and from 64 to 16384, such as 1280x720"
        )
    return size
