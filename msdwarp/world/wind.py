"""Wind: the force of air on surfaces and particles."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from .loads import VectorLoad


@dataclass(frozen=True, eq=False, repr=False)
class Wind(VectorLoad):
    """The force of air, moving or at rest, on bodies.

    A surface triangle with the area vector a (n = a/|a|) and the velocity u relative to the air has the force

        F = −½ ρ (C_d |u·a| u + C_l (u·a) (|u| n − (u·n) u/|u|))

    on both sides. On a closed surface only triangles facing the wind have it. So a convex body of frontal area A
    has the terminal speed ½ ρ C_d A v² = m g. Vertices may be particles or, in balls, cylinders, cones and meshes,
    weighted means of particles, among which forces are divided. See `msdwarp.kernels.loads.wind`. Air at rest,
    `Wind((0, 0, 0))`, slows falling bodies.

    Parameters
    ----------
    velocity
        Velocity of the air [m/s]: a vector of shape [d]; a function of time [s] that returns one; or a `wp.func`
        (x, t) -> velocity at the position x [m], which is compiled into the scene's kernels.
    on
        The particles acted on, by default all (see `Load`): wind acts on triangles with all corners among
        them.
    drag
        C_d: about 1.2 for a plate across the flow, 0.47 for a sphere.
    lift
        C_l.
    density
        ρ of the air [kg/m³].
    area
        Frontal area of each particle [m²], a number or shape [particle_count]. If given, a particle has the force
        −½ ρ C_d A |u| u, and surfaces are ignored: for ropes, grains and other bodies without a surface.
    """

    vector = "velocity"
    constant = ("on", "area")
    velocity: Any
    drag: float = 1.2
    lift: float = 0.6
    density: float = 1.225
    area: Any = None

    def __post_init__(self) -> None:
        for name in ("drag", "lift", "density"):
            checks.non_negative(name, getattr(self, name))
        super().__post_init__()

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        super().check(system)
        if self.area is not None:
            self.areas(system)
        elif not len(self.facets(system).corner):
            raise ValueError(
                "area is None; it must be the area of each particle [m²], because the particles have no surface "
                "in three dimensions"
            )

    def areas(self, system: System) -> NDArray[np.float64]:
        """Return the frontal area of each particle [m²], shape [particle_count]."""
        areas = checks.broadcast("area", self.area, (system.particle_count,))
        checks.within("area", areas, checks.FINITE, (lambda a: a >= 0, "not negative"))
        return areas
