"""Sums and extremes over particles and connections."""

from .divergence import LOOKING_BLOCK, free_energies, look_over, look_over_in_blocks
from .measure import fold, put_in_order, strain_each, sum_connections, sum_difference, sum_particles, take
from .probes import sum_of_group, sum_strain
from .stability import largest_rate

__all__ = [
    "LOOKING_BLOCK",
    "fold",
    "free_energies",
    "largest_rate",
    "look_over",
    "look_over_in_blocks",
    "put_in_order",
    "strain_each",
    "sum_connections",
    "sum_difference",
    "sum_of_group",
    "sum_particles",
    "sum_strain",
    "take",
]
