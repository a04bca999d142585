"""Sums and extremes over particles and connections, for each world."""

from . import columns
from .frozen_worlds import RUNNING, judge, put_back
from .measure import SUMMING_BLOCKS, fold, put_in_order, strain_each, sum_up
from .probes import Sum, mean_of_function, spring_sums, sum_cell_stress, sum_members, sum_of_group
from .rate_bounds import largest_eigenvalue, largest_rate
