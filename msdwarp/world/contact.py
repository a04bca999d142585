"""Contact: rules for contact between bodies."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System, without_surface
from .loads import Load


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Contact(Load):
    """Contact between bodies, and self-contact.

    A body is a set of particles joined by connections. Each is a shell around a mesh: solid bodies touch where
    they are drawn, with round edges; sheets have two sides; ropes touch with their connections, single particles
    as spheres. Meshes that do not cross at the start never cross. See docs/contact.md for the law.

    Parameters
    ----------
    on
        Loads act on particles, contact on whole bodies: give `groups` instead, and leave this None.
    friction
        Coulomb's coefficient μ between bodies.
    restitution
        Speed after a collision divided by the speed before, 0.05 to 1, for bodies that are stiffer than the
        contact. For others it also depends on their own springs and dampers.
    self_contact
        Whether bodies also touch themselves; not for solid ones, whose meshes are finer than their thickness.
    exclude
        Whether these bodies pass through each other; then all arguments but `groups` are ignored.
    groups
        Names of two groups of whole bodies to which this rule applies (see `System.named`); by default all bodies.
        If several rules apply to a pair, the last one is used.
    thickness
        Distance of two bodies' meshes at which they touch [m], above 0. By default solid bodies, whose meshes are
        1/4 of their spacing below the drawn surface, touch where they are drawn, sheets are 1/4 of their spacing
        thick, and ropes 1/2. Single particles that touch each other need a value. Half of a value also is the
        radius at which obstacles meet what has no surface, such as grains and ropes.
    stiffness
        Stiffness of a contact [N/m]. By default about that of one more layer of connections: the harmonic mean of
        both bodies' mean stiffness. Single particles have no springs, so they need a value.
    surface_colliders
        Whether obstacles collide with whole surfaces and ropes, not only with particles. If any entry of `contact`
        sets this, it applies to all bodies. It costs time and shortens the stable step. Use it if obstacles have
        edges, or are thinner than the spacing of the particles, or if a `ball` should roll: particles of bodies
        that are cut from a lattice then do not collide with obstacles.
    """

    argument: ClassVar[str] = "contact"
    friction: float = 0.5
    restitution: float = 0.3
    self_contact: bool = False
    exclude: bool = False
    groups: Any = None
    thickness: float | None = None
    stiffness: float | None = None
    surface_colliders: bool = False

    def __post_init__(self) -> None:
        if self.on is not None:
            raise ValueError(f"on is {checks.repr_short(self.on)}; the bodies are given by groups")
        checks.non_negative("friction", self.friction)
        checks.between("restitution", self.restitution, 0.05, 1)
        for name in ("self_contact", "exclude", "surface_colliders"):
            checks.one_of(name, getattr(self, name), (False, True))
        if self.thickness is not None:
            checks.positive("thickness", self.thickness)
        if self.stiffness is not None:
            checks.positive("stiffness", self.stiffness)
        if self.groups is not None:
            several = isinstance(self.groups, Iterable) and not isinstance(self.groups, str)
            names = tuple(self.groups) if several else ()
            if len(names) != 2 or not all(isinstance(name, str) for name in names):
                raise ValueError(f"groups is {checks.repr_short(self.groups)}; it must be two names of groups")
            object.__setattr__(self, "groups", names)

    @property
    def damping_ratio(self) -> float:
        """The damping ratio ζ that corresponds to this restitution: of friction, and of contact with obstacles.

        Two particles in contact are a damped oscillator. They separate when the repulsive force reaches 0: the
        restitution is |v| then over the impact speed. Reference: Schwager and Pöschel, Granular Matter 9 (2007)
        465.
        """
        low, high = 0.0, 10.0  # restitution falls from 1 as damping rises
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if restitution_of(middle) > self.restitution else (low, middle)
        return 0.5 * (low + high)

    @property
    def hysteresis(self) -> float:
        """The factor α of a contact's damper b = α f / v, with its spring's force f and its fastest approach v.

        A body of any mass then leaves with the restitution e times the speed of its impact:
        m x'' = −k x (1 + α x'/v) gives α (1 + e) = ln((1 + α)/(1 − α e)). References: Hunt and Crossley, J.
        Applied Mechanics 42 (1975) 440; Lankarani and Nikravesh, J. Mechanical Design 112 (1990) 369, with the
        exact relation in place of theirs.
        """
        e = self.restitution
        low, high = 0.0, (1.0 - 1e-12) / e
        for _ in range(80):  # the difference of both sides is negative below α
            middle = 0.5 * (low + high)
            less = math.log((1.0 + middle) / (1.0 - middle * e)) < middle * (1.0 + e)
            low, high = (middle, high) if less else (low, middle)
        return 0.5 * (low + high) if e < 1.0 else 0.0

    def check(self, system: System) -> None:
        """Raise ValueError if this rule cannot apply to bodies of this system."""
        if system.dim != 3:
            raise ValueError(f"contact is requested in {system.dim} dimensions; it exists in three only")
        for name in self.groups or ():
            checks.one_of("a name in contact.groups", name, system.groups)


def radii(rules: Sequence[Contact], system: System) -> NDArray[np.float64]:
    """Return the radius of each particle against obstacles [m], shape [particle_count].

    In bodies without a surface, such as grains and ropes, it is half of the thickness that a rule gives for
    contact among them; if several do, the last one counts. In all others it is 0.
    """
    radius = np.zeros(system.particle_count)
    for one in rules:
        if one.thickness is not None:
            among = [system.group(name) for name in one.groups or ()]
            radius[np.logical_and(*among) if among else slice(None)] = 0.5 * one.thickness
    return radius * without_surface(system) if radius.any() else radius


def restitution_of(damping_ratio: float) -> float:
    """Return the ratio of speeds after and before a collision of two particles with this damping ratio."""
    z = 1 + 1e-9 if abs(damping_ratio - 1) < 1e-9 else damping_ratio
    if z == 0:
        return 1.0
    # x'' + 2 z x' + x = 0 from x = 0, x' = 1; contact ends when x'' = 0.
    w = math.sqrt(abs(1 - z * z))
    if z < 1:
        t = math.atan2(2 * z * w, 2 * z * z - 1) / w
        return math.exp(-z * t) * abs(math.cos(w * t) - z / w * math.sin(w * t))
    t = math.log((2 * z * (z + w) - 1) / (2 * z * (z - w) - 1)) / (2 * w)
    return math.exp(-z * t) * abs(math.cosh(w * t) - z / w * math.sinh(w * t))
