"""Sums and extremes over particles and connections, for each world."""

from . import columns
from .divergence import ENERGY, NOT_FINITE, RUNNING, judge, put_back
from .measure import SUMMING_BLOCKS, fold, put_in_order, strain_each, sum_up
from .probes import mean_of_function, sum_of_group, sum_strain
from .stability import largest_rate

__all__ = [
    "ENERGY",
    "NOT_FINITE",
    "RUNNING",
    "SUMMING_BLOCKS",
    "columns",
    "fold",
    "judge",
    "largest_rate",
    "mean_of_function",
    "put_back",
    "put_in_order",
    "strain_each",
    "sum_of_group",
    "sum_strain",
    "sum_up",
]
