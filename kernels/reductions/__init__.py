"""Sums and extremes over particles and connections."""

from . import columns
from .divergence import LOOKING_BLOCK, free_energies, look_over
from .measure import fold, put_in_order, strain_each, sum_up
from .probes import sum_of_group, sum_strain
from .stability import largest_rate
from .world_divergence import (
    ENERGY,
    NOT_FINITE,
    RUNNING,
    judge,
    look_over_worlds,
    next_frame,
    put_back,
    put_parts_back,
)
from .world_means import ENERGY_COLUMNS, Weighed, mean_over_group, moving, sum_energies, sum_lanes
from .world_rates import add_blocks_of_worlds, raise_bounds_of_worlds

__all__ = [
    "ENERGY",
    "ENERGY_COLUMNS",
    "LOOKING_BLOCK",
    "NOT_FINITE",
    "RUNNING",
    "Weighed",
    "add_blocks_of_worlds",
    "columns",
    "fold",
    "free_energies",
    "judge",
    "largest_rate",
    "look_over",
    "look_over_worlds",
    "mean_over_group",
    "moving",
    "next_frame",
    "put_back",
    "put_in_order",
    "put_parts_back",
    "raise_bounds_of_worlds",
    "strain_each",
    "sum_energies",
    "sum_lanes",
    "sum_of_group",
    "sum_strain",
    "sum_up",
]
