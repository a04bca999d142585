"""Sums and extremes over particles and connections."""

from .divergence import look_over
from .measure import fold, strain_each, sum_connections, sum_difference, sum_particles
from .stability import largest_rate

__all__ = [
    "fold",
    "largest_rate",
    "look_over",
    "strain_each",
    "sum_connections",
    "sum_difference",
    "sum_particles",
]
