"""Sums and extremes over particles and connections."""

from .divergence import look_over
from .measure import fold, put_in_order, strain_each, sum_connections, sum_difference, sum_particles
from .probes import sum_of_group, sum_strain
from .stability import largest_rate

__all__ = [
    "fold",
    "largest_rate",
    "look_over",
    "put_in_order",
    "strain_each",
    "sum_connections",
    "sum_difference",
    "sum_of_group",
    "sum_particles",
    "sum_strain",
]
