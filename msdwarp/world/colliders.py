"""Colliders: obstacles, fixed or moved, as frozen dataclasses.

One contact rule applies to all, `msdwarp.kernels.colliders`; each shape only adds its signed distance and normal
(`msdwarp.kernels.colliders.signed_distance`). All are convex. If a particle moves further in a substep than
a shape is thick, the particle's path is swept (`msdwarp.kernels.colliders.sweep`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import rotation
from .described import Described
from .motion import Motion, pose


@dataclass(frozen=True, kw_only=True, repr=False)
class Collider(metaclass=Described):
    """An obstacle; the base class of all shapes.

    Parameters
    ----------
    restitution
        Normal speed of a particle after a bounce divided by the speed before, 0 … 1. It hardly changes how an
        elastic body rebounds, as its springs also push it away: choose the body's damping for that.
    friction
        Coulomb's coefficient of friction; inf is allowed.
    tangential_factor
        Fraction of the tangential velocity that remains after one contact, however strong friction is, 0 … 1; with
        0 only Coulomb friction acts.
    rest_speed
        Impacts below this speed do not bounce [m/s].
    motion
        A function of time [s] that returns the displacement [m], shape [d], or a pair (displacement, turn) with a
        rotation vector about the centre [rad], shape [3]; in two dimensions an angle. It must be smooth, and if a
        body touches the obstacle at the start, the displacement must be 0 at time 0. A function of arrays of
        times, as NumPy's are, is called a few times a frame, others for each substep. By default it is fixed.
    stiffness
        If given, the obstacle is soft: a particle that enters it is pushed out by a force whose derivative with
        respect to depth grows from 0 to this stiffness [N/m]. Soft obstacles can be differentiated
        (docs/gradients.md). They are fixed, without restitution or tangential factor; below `rest_speed` friction
        is proportional to the speed. None: no particle enters the obstacle.
    ramp
        Depth at which a soft obstacle has its full stiffness [m].
    dissipation
        c of a soft obstacle [s/m]: at outward speed v the force is max(0, 1 − c v) times the force at rest.
    """

    restitution: float = 0.5
    friction: float = 0.5
    tangential_factor: float = 0.0
    rest_speed: float = 0.01
    motion: Motion | None = None
    stiffness: float | None = None
    ramp: float = 0.01
    dissipation: float = 0.0

    places: ClassVar[tuple[str, ...]] = ()
    """Names of the points that define the obstacle [m]; `geometry` calls them a and b."""
    lengths: ClassVar[tuple[str, ...]] = ()
    """Names of the obstacle's lengths, which must be above 0 [m]."""

    def __post_init__(self) -> None:
        checks.between("restitution", self.restitution, 0, 1)
        checks.between("tangential_factor", self.tangential_factor, 0, 1)
        checks.non_negative("friction", self.friction, infinite=True)
        checks.non_negative("rest_speed", self.rest_speed)
        if self.motion is not None and not callable(self.motion):
            raise ValueError(f"motion is {checks.repr_short(self.motion)}; it must be a function of time")
        checks.positive("ramp", self.ramp)
        checks.non_negative("dissipation", self.dissipation)
        self._check_softness()
        for name in self.places:
            object.__setattr__(self, name, checks.point(name, getattr(self, name)))
        if len(self.places) == 2:
            first, second = self.places
            a, b = (getattr(self, name) for name in self.places)
            if len(a) != len(b) or a == b:
                raise ValueError(
                    f"{second} is {b}; it must be another point than {first}, with as many coordinates"
                )
        for name in self.lengths:
            checks.positive(name, getattr(self, name))

    def _check_softness(self) -> None:
        """Raise ValueError if fields are missing, or not allowed, for a soft obstacle."""
        if self.stiffness is None:
            if self.dissipation:
                raise ValueError(f"dissipation is {self.dissipation:g}; only an obstacle with a stiffness has it")
            return
        checks.positive("stiffness", self.stiffness)
        checks.non_negative("friction", self.friction)
        if self.motion is not None:
            raise ValueError("motion is given, and so is stiffness; a soft obstacle is fixed")
        if self.friction:
            checks.positive("rest_speed", self.rest_speed)

    def __repr__(self) -> str:
        # First position and size, then the fields of all colliders; defaults are left out.
        common = {one.name for one in fields(Collider)}
        texts = [
            f"{one.name}={_words(getattr(self, one.name))}"
            for one in sorted(fields(self), key=lambda one: one.name in common)
            if _words(getattr(self, one.name)) != _words(one.default)
        ]
        return f"{type(self).__name__}({', '.join(texts)})"

    def fits(self, dim: int) -> str | None:
        """Return why the obstacle cannot be in a space of `dim` coordinates; None if it can."""
        name = self.places[0]
        if dim == 1 and len(self.places) == 2:
            kind = type(self).__name__.lower()
            return f"{name} is {getattr(self, name)}; a {kind} needs at least 2 coordinates: in one use a Box"
        return _wrong_length(name, getattr(self, name), dim)

    def geometry(self, dim: int) -> dict[str, Any]:
        """Return arguments of `msdwarp.kernels.colliders.signed_distance`: a, b [dim], radius, axes [dim, dim]."""
        points = {letter: getattr(self, name) for letter, name in zip("ab", self.places, strict=False)}
        return points | {name: getattr(self, name) for name in self.lengths}

    def inradius(self) -> float:
        """Return the radius of the largest inscribed ball [m]; inf for a half-space, which cannot be crossed."""
        return min((getattr(self, name) for name in self.lengths), default=math.inf)

    def center(self, dim: int) -> NDArray[np.float64]:
        """Return the point about which `motion` rotates the obstacle [m], shape [dim]."""
        return np.asarray(self.geometry(dim)["a"], dtype=np.float64)

    def pose(self, time: float, dim: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (R, o): a point at y in the given pose of the obstacle is at R y + o at `time` [s].

        Raises ValueError if `motion` returns neither a displacement nor a pair, or the result is not finite.
        """
        if self.motion is None:
            return np.eye(dim), np.zeros(dim)
        return pose(self.motion, self.center(dim), time)


@dataclass(frozen=True, repr=False)
class Plane(Collider):
    """The half-space below a plane: points x with normal·x < offset.

    Parameters
    ----------
    normal
        Outward direction, of any length, with as many coordinates as the particles; by default upwards.
    offset
        Distance of the plane from the origin along the normal [m].
    restitution, friction, tangential_factor, rest_speed, motion, stiffness, ramp, dissipation
        See `Collider`.
    """

    normal: tuple[float, ...] | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the arguments; normalize the normal."""
        super().__post_init__()
        if self.normal is not None:
            object.__setattr__(self, "normal", checks.direction("normal", self.normal))
        checks.between("offset", self.offset, -checks.LARGEST, checks.LARGEST)

    def unit_normal(self, dim: int) -> NDArray[np.float64]:
        """Return the normal in a space of `dim` coordinates, shape [dim]."""
        return np.eye(dim)[-1] if self.normal is None else np.array(self.normal)

    def fits(self, dim: int) -> str | None:
        """Return why the plane cannot be in a space of `dim` coordinates; None if it can."""
        return _wrong_length("normal", self.normal, dim)

    def geometry(self, dim: int) -> dict[str, Any]:
        """Return the normal as a, and the offset as the radius."""
        return {"a": self.unit_normal(dim), "radius": self.offset}

    def center(self, dim: int) -> NDArray[np.float64]:
        """Return the point of the plane nearest to the origin [m], about which `motion` rotates it."""
        return self.offset * self.unit_normal(dim)


@dataclass(frozen=True, repr=False)
class Sphere(Collider):
    """A ball; in two dimensions a disc.

    Parameters
    ----------
    position
        Centre [m].
    radius
        Radius [m].
    restitution, friction, tangential_factor, rest_speed, motion, stiffness, ramp, dissipation
        See `Collider`.
    """

    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    radius: float = 0.5

    places = ("position",)
    lengths = ("radius",)


@dataclass(frozen=True, repr=False)
class Box(Collider):
    """A solid block. A body that slides on a fixed plane hits the side of a fixed block on this plane.

    A block that moves along a plane must extend below it; otherwise sliding particles could enter from below.

    Parameters
    ----------
    position
        Centre [m].
    size
        Edge lengths [m].
    turn
        Rotation vector about the centre [rad], shape [3]; in two dimensions an angle; in one dimension unused.
    restitution, friction, tangential_factor, rest_speed, motion, stiffness, ramp, dissipation
        See `Collider`.
    """

    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    size: tuple[float, ...] = (1.0, 1.0, 1.0)
    turn: Any = None

    places = ("position",)

    def __post_init__(self) -> None:
        super().__post_init__()
        size = checks.point("size", self.size)
        if len(size) != len(self.position) or min(size) < checks.SMALLEST:
            raise ValueError(f"size is {self.size!r}; it must be {len(self.position)} numbers above 0")
        object.__setattr__(self, "size", size)
        if self.turn is not None:
            rotation(self.turn, len(size), "turn")

    def geometry(self, dim: int) -> dict[str, Any]:
        """Return the centre as a, half the edge lengths as b, and the directions of the edges as axes."""
        axes = np.eye(dim) if self.turn is None else rotation(self.turn, dim, "turn")
        return {"a": self.position, "b": np.array(self.size) / 2, "axes": axes}

    def inradius(self) -> float:
        """Return the radius of the largest inscribed ball [m]."""
        return min(self.size) / 2


@dataclass(frozen=True, repr=False)
class Capsule(Collider):
    """All points within `radius` of a line segment: a rod with round ends.

    Parameters
    ----------
    start, end
        Ends of the segment [m].
    radius
        Radius [m].
    restitution, friction, tangential_factor, rest_speed, motion, stiffness, ramp, dissipation
        See `Collider`.
    """

    start: tuple[float, ...] = (-0.5, 0.0, 0.0)
    end: tuple[float, ...] = (0.5, 0.0, 0.0)
    radius: float = 0.25

    places = ("start", "end")
    lengths = ("radius",)

    def center(self, dim: int) -> NDArray[np.float64]:
        """Return the midpoint of the segment [m]."""
        return (np.array(self.start) + self.end) / 2


@dataclass(frozen=True, repr=False)
class Cone(Collider):
    """A solid cone with a flat base; in two dimensions a triangle. For a cone on a plane see `Box`.

    Parameters
    ----------
    apex
        Tip [m].
    base
        Centre of the base [m].
    radius
        Radius of the base [m].
    restitution, friction, tangential_factor, rest_speed, motion, stiffness, ramp, dissipation
        See `Collider`.
    """

    apex: tuple[float, ...] = (0.0, 0.0, 1.0)
    base: tuple[float, ...] = (0.0, 0.0, 0.0)
    radius: float = 0.5

    places = ("apex", "base")
    lengths = ("radius",)

    def inradius(self) -> float:
        """Return the radius of the largest inscribed ball [m]: the incircle of the triangular cross section."""
        height = math.dist(self.apex, self.base)
        return self.radius * (height / (self.radius + math.hypot(self.radius, height)))


def _wrong_length(name: str, value: tuple[float, ...] | None, dim: int) -> str | None:
    """Return a message if a collider's point has another number of coordinates; None if not."""
    return None if value is None or len(value) == dim else f"{name} is {value}; it must have {dim} coordinates"


def _words(value: Any) -> str:
    """Return a field of a collider, one or several numbers or a function, as text."""
    if isinstance(value, np.ndarray | np.generic | list):
        value = np.asarray(value).tolist()
    if callable(value):
        return getattr(value, "__name__", type(value).__name__)
    return repr(tuple(value) if isinstance(value, list) else value)


def check_colliders(colliders: Sequence[Collider], dim: int) -> None:
    """Raise ValueError, which names the obstacle, if one cannot be in a space of `dim` coordinates."""
    kinds = Plane, Sphere, Box, Capsule, Cone
    for k, one in enumerate(colliders):
        if type(one) not in kinds:
            names = ", ".join(kind.__name__ for kind in kinds)
            raise ValueError(f"colliders[{k}] is {checks.repr_short(one)}; it must be a {names}")
        if wrong := one.fits(dim):
            raise ValueError(f"colliders[{k}].{wrong}")
        try:
            one.pose(0.0, dim)
        except Exception as error:  # of its motion, before anything runs
            raise ValueError(f"colliders[{k}] has no place at 0 s: {checks.message(error)}") from error
