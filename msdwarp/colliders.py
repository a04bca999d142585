"""Colliders: fixed obstacles, as frozen dataclasses."""

import sys
from dataclasses import dataclass

import numpy as np

from . import checks


@dataclass(frozen=True)
class Plane:
    """The half-space below a plane, which particles are kept out of: points x with normal·x < offset.

    Parameters
    ----------
    normal
        Direction out of the obstacle, any length; as many coordinates as the particles have.
    offset
        Distance of the plane from the origin along the normal [m].
    restitution
        Normal speed after a bounce over that before it, 0 … 1.
    friction
        Coulomb's coefficient: tangential over normal force while sliding; inf is allowed.
    tangential_factor
        The share of the tangential velocity that one contact leaves however hard it presses, 0 … 1;
        0 leaves all to Coulomb's friction.
    rest_speed
        Slower approaches than this do not bounce [m/s].

    Raises
    ------
    ValueError
        If a coefficient is out of its range or the normal is zero.
    """

    normal: tuple[float, ...] = (0.0, 0.0, 1.0)
    offset: float = 0.0
    restitution: float = 0.5
    friction: float = 0.5
    tangential_factor: float = 0.0
    rest_speed: float = 0.01

    def __post_init__(self) -> None:
        """Check the arguments and give the normal unit length."""
        normal = checks.array("normal", self.normal)
        if normal.ndim != 1 or not np.isfinite(normal).all() or not normal.any():
            raise ValueError(f"normal is {self.normal!r}; it must be a finite direction other than zero")
        unit = normal / np.linalg.norm(normal)
        object.__setattr__(self, "normal", tuple(float(c) for c in unit))
        checks.between("offset", self.offset, -sys.float_info.max, sys.float_info.max)
        checks.between("restitution", self.restitution, 0, 1)
        checks.between("tangential_factor", self.tangential_factor, 0, 1)
        checks.non_negative("friction", self.friction, infinite=True)
        checks.non_negative("rest_speed", self.rest_speed)
