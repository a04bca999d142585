"""Integrators, one file per method."""

from .base import Integrator
from .leapfrog import Leapfrog
from .rk4 import RK4
from .symplectic_euler import SymplecticEuler

__all__ = ["RK4", "Integrator", "Leapfrog", "SymplecticEuler"]
