"""Adjoints of the launches of a substep: derivatives of a loss, from its end to its start."""

from .elements import (
    add_elements as add_elements,
    elements_adjoint as elements_adjoint,
    sum_numbers as sum_numbers,
)
from .kick import (
    SUMMING as SUMMING,
    AdjointData as AdjointData,
    add_given as add_given,
    forget as forget,
    kick_adjoint as kick_adjoint,
    squares as squares,
    widen as widen,
)
from .mid_velocity import mid_velocity_adjoint as mid_velocity_adjoint
from .springs import (
    Neighbours as Neighbours,
    Wanted as Wanted,
    in_lattice as in_lattice,
    in_table as in_table,
    springs_adjoint as springs_adjoint,
)
from .stages import combination_adjoint as combination_adjoint
from .stencil import (
    BLOCK as BLOCK,
    stencil_adjoint as stencil_adjoint,
    stencil_table as stencil_table,
)
