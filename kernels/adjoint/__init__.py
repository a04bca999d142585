"""Adjoints of the launches of a substep: derivatives of a loss, from its end to its start."""

from .elements import add_elements, elements_adjoint, sum_numbers
from .kick import SUMMING, AdjointData, add_given, forget, kick_adjoint, squares, widen
from .mid_velocity import mid_velocity_adjoint
from .springs import Neighbours, Wanted, in_lattice, in_table, springs_adjoint
from .stages import combination_adjoint
from .stencil import BLOCK, stencil_adjoint
