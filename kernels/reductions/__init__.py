"""Sums and extremes over particles and connections."""

from .divergence import look_over
from .measure import MOST_FOLDED, fold, strain_each, sum_connections, sum_difference, sum_particles
from .stability import largest_rate

__all__ = [
    "MOST_FOLDED",
    "fold",
    "largest_rate",
    "look_over",
    "strain_each",
    "sum_connections",
    "sum_difference",
    "sum_particles",
]
