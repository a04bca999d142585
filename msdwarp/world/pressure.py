"""Pressure on a surface from one side: a given pressure, or an enclosed gas."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Facets, System, open_edges
from .loads import Load, values_at


@dataclass(frozen=True, eq=False, repr=False)
class Pressed(Load):
    """Base of loads on a surface from one side."""

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        super().check(system)
        if not len(self.facets(system).corner):
            raise ValueError(f"on is {checks.repr_short(self.on)}; it must hold the corners of a surface in space")


@dataclass(frozen=True, eq=False, repr=False)
class Pressure(Pressed):
    """A pressure that pushes a surface outwards.

    A triangle with the area vector a has the force p a, a third of it at each corner. If a corner is a weighted
    mean of particles, the force is divided in proportion to the weights, so that its work is also p dV.

    Parameters
    ----------
    pressure
        Overpressure [Pa]: a number, or a function of time [s].
    on
        The particles of the surface, by default all (see `Load`): triangles with all corners among them are
        under pressure.
    """

    pressure: Any

    def __post_init__(self) -> None:
        if not callable(self.pressure):
            object.__setattr__(self, "pressure", float(checks.vector("pressure", [self.pressure], 1)[0]))

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        super().check(system)
        self.at(np.zeros(1))

    def at(self, times: NDArray[np.float64], name: str = "pressure") -> NDArray[np.float64]:
        """Return the pressure at these times [Pa], shape [time_count]."""
        return values_at(name, self.pressure, times, 1)[:, 0]


@dataclass(frozen=True, eq=False, repr=False)
class EnclosedGas(Pressed):
    """A gas inside a closed surface: the pressure p obeys p V^γ = constant, with the volume V.

    The surface is that of a balloon, or the walls of a cavity in a solid body: the gas pushes out of itself.

    Parameters
    ----------
    pressure
        Overpressure at the start [Pa]; below 0 for a partial vacuum.
    on
        The particles of the surface, by default all (see `Load`); the surface must be closed.
    outside
        Pressure of the air outside [Pa].
    exponent
        γ: 1 for constant temperature (Boyle's law), 1.4 for adiabatic air.
    volume
        Volume at which the overpressure is `pressure` [m³]; by default the volume at the start.

    Raises
    ------
    ValueError
        If a number is out of range, or the surface is not closed, or encloses nothing.
    """

    of_start = True
    pressure: float
    outside: float = 101_325.0
    exponent: float = 1.0
    volume: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "outside", checks.non_negative("outside", self.outside))
        checks.positive("exponent", self.exponent)
        checks.between("pressure", self.pressure, -self.outside, checks.LARGEST)
        if self.volume is not None:
            checks.positive("volume", self.volume)

    def facets(self, system: System) -> Facets:
        """Return the surface triangles around the gas, turned to face out of it where they face into a cavity."""
        found = super().facets(system)
        turned = len(found.corner) and volume(found.corner, found.points(system.position)) < 0
        return found._replace(corner=found.corner[:, ::-1]) if turned else found

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        super().check(system)
        facets = self.facets(system)
        if count := len(open_edges(facets.corner)):
            raise ValueError(
                f"on is {checks.repr_short(self.on)}; the surface there must be closed, and {count} of its "
                "edges are not between two triangles"
            )
        if volume(facets.corner, facets.points(system.position)) == 0:
            raise ValueError("on encloses 0 m³; it must be above 0")

    def bound(self, system: System) -> Self:
        """Return the gas with its reference volume set: by default the volume in this system."""
        if self.volume is not None:
            return self
        self.check(system)
        facets = self.facets(system)
        return replace(self, volume=volume(facets.corner, facets.points(system.position)))


def volume(corner: NDArray[np.int32], position: NDArray) -> float:
    """Return the volume enclosed by triangles of these points [m³], by the divergence theorem."""
    a, b, c = (np.asarray(position[corner[:, k]], dtype=np.float64) - position[corner[0, 0]] for k in range(3))
    return float(np.einsum("td,td->", a, np.cross(b, c)) / 6)
