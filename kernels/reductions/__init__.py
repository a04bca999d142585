"""Sums and extremes over particles and connections."""

from . import columns
from .divergence import LOOKING_BLOCK, free_energies, look_over
from .measure import fold, put_in_order, strain_each, sum_up
from .probes import sum_of_group, sum_strain
from .stability import largest_rate

__all__ = [
    "LOOKING_BLOCK",
    "columns",
    "fold",
    "free_energies",
    "largest_rate",
    "look_over",
    "put_in_order",
    "strain_each",
    "sum_of_group",
    "sum_strain",
    "sum_up",
]
