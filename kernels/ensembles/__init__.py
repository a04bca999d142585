"""Ensembles: many worlds of one topology at once, each with numbers of its own.

A world's particles lie side by side, one world after the other. A thread shifts the arrays of its stage to its own
world, puts the world's numbers where those of a single scene stand, and goes on with the functions that a single
scene is composed of: so each world moves as it would alone, to the last bit.
"""

from .by_world import EACH, SHARED, UNIFORM, Differences, by_world
from .means import ENERGY_COLUMNS, Weighed, mean_over_group, moving, sum_energies, sum_lanes
from .rates import add_blocks_of_worlds, raise_bounds_of_worlds
from .shared_memory import MOST_BYTES, on_chip_worlds
from .stages import each_connection_of_worlds, each_particle_of_worlds, persistent_worlds
from .watch import ENERGY, NOT_FINITE, RUNNING, judge, look_over_worlds, next_frame, put_back

__all__ = [
    "EACH",
    "ENERGY",
    "ENERGY_COLUMNS",
    "MOST_BYTES",
    "NOT_FINITE",
    "RUNNING",
    "SHARED",
    "UNIFORM",
    "Differences",
    "Weighed",
    "add_blocks_of_worlds",
    "by_world",
    "each_connection_of_worlds",
    "each_particle_of_worlds",
    "judge",
    "look_over_worlds",
    "mean_over_group",
    "moving",
    "next_frame",
    "on_chip_worlds",
    "persistent_worlds",
    "put_back",
    "raise_bounds_of_worlds",
    "sum_energies",
    "sum_lanes",
]
