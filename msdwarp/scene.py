"""Scene: a system, its surroundings and its look; what a file in scenes/ builds."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks
from .colliders import Collider, Plane
from .schedule import Change
from .system import System


def rgb(name: str, colour: str) -> tuple[float, float, float]:
    """Return a colour "#rrggbb" as three numbers in 0 … 1; raise ValueError that names it if it is none."""
    if not isinstance(colour, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
        raise ValueError(f"{name} is {colour!r}; it must be a colour of the form '#rrggbb'")
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """How a scene is drawn.

    Parameters
    ----------
    colour
        Colour of the body, "#rrggbb"; without effect where there is a texture.
    texture
        An image laid over the surface by its texture coordinates, uint8 of shape [height, width, 3].
    smooth
        Shade across triangles of one face (True) or show each triangle flat (False).
    gloss
        Strength of highlights, 0 … 1.
    azimuth, elevation
        Direction from the body to the camera [degrees]: anticlockwise from x seen from above, and above
        the horizon.
    background, ground
        Colours of the backdrop and of the ground beneath the body, "#rrggbb".
    obstacle
        Colour of the solid colliders, "#rrggbb"; in strain colours even where they have a texture.
    obstacle_texture
        An image laid over them as over the body; see `msdwarp.obstacles.mesh_of` for where.
    strain
        Draw connections in the colours of their strain, unless a run asks for the look.
    full_strain
        The strain at which a connection is drawn red.
    particles
        Draw particles as balls between the connections; None: where there are not too many.

    Raises
    ------
    ValueError
        If a colour, a texture, an angle, the full strain or a choice is none.
    """

    colour: str = "#d9603b"
    texture: NDArray[np.uint8] | None = None
    smooth: bool = True
    gloss: float = 0.25
    azimuth: float = -60.0
    elevation: float = 16.0
    background: str = "#eef1f4"
    ground: str = "#cfd6dc"
    obstacle: str = "#c9c3ba"
    obstacle_texture: NDArray[np.uint8] | None = None
    strain: bool = False
    full_strain: float = 0.2
    particles: bool | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name in ("colour", "background", "ground", "obstacle"):
            rgb(name, getattr(self, name))
        for name in ("texture", "obstacle_texture"):
            _check_image(name, getattr(self, name))
        checks.between("azimuth", self.azimuth, -360, 360)
        checks.between("elevation", self.elevation, -90, 90)
        checks.one_of("strain", self.strain, (False, True))
        checks.positive("full_strain", self.full_strain)
        checks.one_of("particles", self.particles, (None, False, True))


def _check_image(name: str, image: object) -> None:
    """Raise ValueError unless `image` is None or a picture of some size, uint8 of shape [height, width, 3]."""
    if image is None:
        return
    given = np.asarray(image)
    if given.dtype != np.uint8 or given.ndim != 3 or given.shape[2] != 3 or not given.size:
        raise ValueError(
            f"{name} has shape {given.shape} and type {given.dtype}; it must be uint8 of shape (height, width, 3)"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A system in its surroundings, how long it is watched, and how it looks.

    Parameters
    ----------
    system
        What is simulated.
    colliders
        Obstacles; the fixed plane that faces most upwards is drawn as the ground.
    gravity
        Acceleration of free fall [m/s²]; see `Simulation`.
    duration
        Simulated time [s].
    look
        How it is drawn.
    schedule
        Changes of parameters at set times, made by `msdwarp.at`.
    """

    system: System
    colliders: Sequence[Collider] = ()
    gravity: ArrayLike = 9.82
    duration: float = 4.0
    look: Look = field(default_factory=Look)
    schedule: Sequence[Change] = ()

    def __post_init__(self) -> None:
        """Check the arguments."""
        checks.positive("duration", self.duration)
        for name, kind in (("colliders", Collider), ("schedule", Change)):
            for k, one in enumerate(getattr(self, name)):
                if not isinstance(one, kind):
                    raise ValueError(f"{name}[{k}] is {one!r}; it must be a {kind.__name__}")
        if self.system.surface is None and not self.system.connection_count:
            raise ValueError("system has neither a surface nor connections: nothing of it could be drawn")

    @property
    def ground(self) -> Plane | None:
        """The fixed plane that faces most upwards, if one does."""
        dim = self.system.dim
        planes = [one for one in self.colliders if isinstance(one, Plane) and one.motion is None]
        upwards = [plane for plane in planes if plane.unit_normal(dim)[-1] > 0]
        return max(upwards, key=lambda plane: plane.unit_normal(dim)[-1], default=None)
