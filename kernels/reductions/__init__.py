"""Sums and extremes over particles and connections, for each world."""

from . import columns as columns
from .frozen_worlds import RUNNING as RUNNING, judge as judge, put_back as put_back
from .measure import (
    SUMMING_BLOCKS as SUMMING_BLOCKS,
    fold as fold,
    put_in_order as put_in_order,
    strain_each as strain_each,
    sum_up as sum_up,
)
from .probes import (
    Sum as Sum,
    mean_of_function as mean_of_function,
    spring_sums as spring_sums,
    sum_cell_stress as sum_cell_stress,
    sum_members as sum_members,
    sum_of_group as sum_of_group,
)
from .rate_bounds import largest_eigenvalue as largest_eigenvalue, largest_rate as largest_rate
