"""Integrators, one file per method."""

from .base import Integrator, Rates
from .explicit_euler import ExplicitEuler
from .leapfrog import Leapfrog
from .linearly_implicit_euler import LinearlyImplicitEuler
from .rk4 import RK4
from .rkc2 import RKC2
from .symplectic_euler import SymplecticEuler

__all__ = [
    "RK4",
    "RKC2",
    "ExplicitEuler",
    "Integrator",
    "Leapfrog",
    "LinearlyImplicitEuler",
    "Rates",
    "SymplecticEuler",
]
