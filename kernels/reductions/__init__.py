"""Sums and extremes over particles and connections."""

from . import columns as columns
from .divergence import LOOKING_BLOCK as LOOKING_BLOCK, free_energies as free_energies, look_over as look_over
from .measure import fold as fold, put_in_order as put_in_order, strain_each as strain_each, sum_up as sum_up
from .probes import sum_of_group as sum_of_group, sum_strain as sum_strain
from .stability import largest_rate as largest_rate
from .world_divergence import (
    ENERGY as ENERGY,
    NOT_FINITE as NOT_FINITE,
    RUNNING as RUNNING,
    judge as judge,
    look_over_worlds as look_over_worlds,
    next_frame as next_frame,
    put_back as put_back,
    put_parts_back as put_parts_back,
)
from .world_means import (
    ENERGY_COLUMNS as ENERGY_COLUMNS,
    Weighed as Weighed,
    mean_over_group as mean_over_group,
    moving as moving,
    sum_energies as sum_energies,
    sum_lanes as sum_lanes,
)
from .world_rates import (
    add_blocks_of_worlds as add_blocks_of_worlds,
    raise_bounds_of_worlds as raise_bounds_of_worlds,
)
