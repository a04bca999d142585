"""Look: colors and other properties of a scene in pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from .colliders import Plane

OF_BODIES = ("color", "inside", "texture", "smooth", "gloss", "finish", "particles", "tube")
"""Fields that a body can set for itself; the others belong to the whole picture."""
OBLIQUE = (-60.0, 16.0)
"""Azimuth and elevation of the camera [degrees], where neither a look nor a plane says other."""
FLOORS = ("chequered", "plain", "shadows", "none")


class Reflectance(NamedTuple):
    """How a surface reflects light, beside its color and its gloss."""

    roughness: float
    """Width of highlights, as in USD's preview surface, 0 … 1; at 1 there are none."""
    metallic: float = 0.0
    """Share of light that is mirrored, in the surface's color, 0 … 1."""
    sheen: float = 0.0
    """Light that fibres scatter where a surface is seen edge-on, in its color."""
    opacity: float = 1.0
    """Share of light from behind that is held back where a surface is seen face-on, 0 … 1; below 1 it mirrors."""


FINISHES = {
    "matt": Reflectance(0.3578),
    "rubber": Reflectance(0.6),
    "metal": Reflectance(0.28, metallic=0.8),
    "glass": Reflectance(0.25, opacity=0.6),
    "cloth": Reflectance(1.0, sheen=0.35),
}
"""What surfaces can be made of, as pictures show it."""


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """Camera settings at one time: a point of `Look.path`. Those that are None are as in the look.

    Parameters
    ----------
    time
        Simulated time [s].
    azimuth, elevation, target, distance
        See `Look`: angles [degrees], a point [m], shape [3], and a distance [m].
    """

    time: float
    azimuth: float | None = None
    elevation: float | None = None
    target: tuple[float, ...] | None = None
    distance: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """How a scene, or a body in it, is drawn.

    A body's look, in `Scene.looks`, sets its color, inside, texture, smooth, gloss, finish, particles and tube.
    All other parameters apply to the whole picture; only the scene's look sets them.

    Parameters
    ----------
    color
        Color of the body in full light, "#rrggbb". A surface with a texture ignores it. Connections of a system
        without surface have it if this, `gloss` or `finish` is not the default; else they are colored by their
        strain.
    inside
        Color of what is inside a solid that is torn or cut, "#rrggbb". None: that of the body, or the mean of its
        texture.
    texture
        Image on the surface, mapped by texture coordinates: uint8 of shape [height, width, 3], or the path of a
        file that Pillow reads, which is read at once.
    smooth
        Smooth shading (True) or flat shading (False).
    gloss
        Strength of highlights on the body, 0 … 1.
    finish
        What the body seems to be made of: "matt"; "rubber", with wide highlights; "metal", which mirrors the sky;
        "glass", through which one sees what is behind, but no other glass; or "cloth", bright where it is seen
        edge-on. Colors that show quantities are matt.
    azimuth, elevation
        Camera angles [degrees]: around the vertical, counter-clockwise from +x, and above the horizon. None: in a
        scene in a plane the camera looks at that from the front, else from -60° and 16°.
    target
        Point in the middle of the picture [m], shape [3]. None: fitted to the run, or, if the bodies travel, their
        middle.
    distance
        Distance of the camera from the target [m]. None: all that moves is in view, with fixed obstacles, of which
        large ones are in view in part; or the bodies at their time, if they travel.
    field_of_view
        Vertical angle of view of the camera [degrees].
    follow
        Name of a group of particles. The camera moves with their mean position, which is then the target; without
        a `distance` the group fills two fifths of the picture.
    path
        Viewpoints in the order of time, between which the camera moves smoothly: it is at rest at the first and
        before, at the last and after. Empty: the camera stands still, or follows a group.
    background, ground
        Colors of the backdrop and of the ground beneath the body, "#rrggbb".
    floor
        How the ground is drawn: "chequered", for scale; "plain"; "shadows", in the color of the background, so
        that only shadows are seen; or "none".
    obstacle
        Color of solid colliders, "#rrggbb". In strain colors it replaces their texture.
    obstacle_texture
        Image on the colliders, given likewise; `msdwarp.pictures.collider_meshes.mesh_of` describes its mapping.
    obstacle_gloss
        Strength of highlights on solid colliders, 0 … 1. The ground has none.
    cut
        A fixed `Plane` that cuts the bodies where they are at the start: what is above it is not drawn. The
        section through solids shows what is inside, in the color `inside` or in those of values, and moves with
        the bodies. Of connections, such as ropes, those are drawn that have both ends below. Obstacles are not
        cut. None: no cut.
    strain
        Color connections by strain, unless a run requests the texture.
    full_strain
        Strain drawn in full red; minus this is drawn in full blue. None: fitted to the run, or 0.2.
    particles
        Draw the particles of connections as balls. None: unless there are too many. If connections have the body's
        color, the balls are no thicker than the connections. Single particles always are balls.
    tube
        Radius of drawn connections, such as ropes, and of single particles that no `Contact` gives a thickness
        [m]. None: half of the thickness that a `Contact` gives; else a fraction of the rest length, of seams,
        which join surfaces, one of the spacing beside, and for single particles what fits between them.
    """

    color: str = "#d9603b"
    inside: str | None = None
    texture: Any = None
    smooth: bool = True
    gloss: float = 0.25
    finish: str = "matt"
    azimuth: float | None = None
    elevation: float | None = None
    target: tuple[float, ...] | None = None
    distance: float | None = None
    field_of_view: float = 30.0
    follow: str | None = None
    path: Sequence[Viewpoint] = ()
    background: str = "#eef1f4"
    ground: str = "#cfd6dc"
    floor: str = "chequered"
    obstacle: str = "#c9c3ba"
    obstacle_texture: Any = None
    obstacle_gloss: float = 0.1
    cut: Plane | None = None
    strain: bool = False
    full_strain: float | None = None
    particles: bool | None = None
    tube: float | None = None

    def __post_init__(self) -> None:
        for name in ("color", "background", "ground", "obstacle"):
            checks.color(name, getattr(self, name))
        checks.one_of("floor", self.floor, FLOORS)
        if self.inside is not None:
            checks.color("inside", self.inside)
        for name in ("texture", "obstacle_texture"):
            object.__setattr__(self, name, _image(name, getattr(self, name)))
        checks.one_of("smooth", self.smooth, (False, True))
        checks.between("gloss", self.gloss, 0, 1)
        checks.one_of("finish", self.finish, tuple(FINISHES))
        checks.between("obstacle_gloss", self.obstacle_gloss, 0, 1)
        if self.azimuth is not None:
            checks.between("azimuth", self.azimuth, -360, 360)
        if self.elevation is not None:
            checks.between("elevation", self.elevation, -90, 90)
        if self.target is not None:
            object.__setattr__(self, "target", checks.point("target", self.target))
            if len(self.target) != 3:
                raise ValueError(f"target is {self.target}; it must have 3 coordinates")
        if self.distance is not None:
            checks.positive("distance", self.distance)
        checks.between("field_of_view", self.field_of_view, 1, 120)
        if self.follow is not None:
            checks.instance("follow", self.follow, str, "'ball'")
            if self.target is not None:
                raise ValueError(
                    f"target is {self.target}; it must be None where the camera follows {self.follow!r}"
                )
        path = checks.sequence("path", self.path, Viewpoint, "Viewpoint(time=0.0, azimuth=-60.0)")
        object.__setattr__(self, "path", path)
        times = checks.finite("path", [one.time for one in self.path])
        if (np.diff(times) <= 0).any():
            raise ValueError(f"path has the times {times.tolist()}; each must be later than the one before")
        _ = self.views  # checks the path
        if self.cut is not None:
            checks.instance("cut", self.cut, Plane, "Plane((0, -1, 0))")
            if self.cut.motion is not None:
                raise ValueError("cut is a plane with a motion; it must be a fixed one")
        checks.one_of("strain", self.strain, (False, True))
        if self.full_strain is not None:
            checks.positive("full_strain", self.full_strain)
        checks.one_of("particles", self.particles, (None, False, True))
        if self.tube is not None:
            checks.positive("tube", self.tube)

    @property
    def views(self) -> "list[Look]":
        """The look at each point of the path; the look itself if there is no path."""
        given = [{name: value for name, value in vars(one).items() if name != "time"} for one in self.path]
        return [
            replace(self, path=(), **{name: value for name, value in one.items() if value is not None})
            for one in given
        ] or [self]

    @property
    def says_color(self) -> bool:
        """Whether its color, gloss or finish is not the default, so that connections are drawn with them."""
        return (self.color, self.gloss, self.finish) != (Look.color, Look.gloss, Look.finish)

    def angles(self, default: tuple[float, float] = OBLIQUE) -> tuple[float, float]:
        """Return azimuth and elevation of the camera [degrees], by default these."""
        azimuth, elevation = default
        return (
            azimuth if self.azimuth is None else self.azimuth,
            elevation if self.elevation is None else self.elevation,
        )

    def of_the_picture(self) -> list[str]:
        """Return the names of non-default fields that apply to the whole picture."""
        values = {one: getattr(self, one.name) for one in fields(self) if one.name not in OF_BODIES}
        return [
            one.name
            for one, value in values.items()
            if (value is not None if one.default is None else value != one.default)
        ]


def _image(name: str, image: Any) -> NDArray[np.uint8] | None:
    """Return an image, given as one or as the path of a file; raise ValueError or OSError if it is none."""
    if image is None:
        return None
    if isinstance(image, str | Path):
        from PIL import Image, UnidentifiedImageError

        if not Path(image).is_file():
            raise FileNotFoundError(f"{name} is {str(image)!r}, and there is no such file")
        try:
            with Image.open(image) as opened:
                return np.array(opened.convert("RGB"))
        except UnidentifiedImageError as error:
            raise ValueError(f"{name} is {str(image)!r}, which is no image that Pillow can read") from error
    given = np.asarray(image)
    if given.dtype != np.uint8 or given.ndim != 3 or given.shape[2] != 3 or not given.size:
        raise ValueError(
            f"{name} has shape {given.shape} and type {given.dtype}; it must be uint8 of shape (height, width, 3)"
        )
    return image
