"""Viscoelastic bodies: a fraction of each spring's force relaxes."""

from typing import Any

import numpy as np

from .. import checks
from ..bodies import System

MOST = 0.99
"""Largest relative change of a relaxing spring's rest length, which usual strains do not reach."""


def viscoelastic(system: System, fraction: float = 0.5, relaxation_time: float = 1.0) -> System:
    """Return a body that is a standard linear solid: at constant strain a fraction of its force relaxes.

    Parallel to each spring, of stiffness k (1 − g), is a Maxwell element: a spring of stiffness k g and a dashpot
    in series. The element is a connection that yields from the start: its rest length approaches its length with
    the time constant τ. A small constant strain ε has the force k l0 ε (1 − g + g exp(−t/τ)).

    Parameters
    ----------
    system
        The body; the dampers of its connections stay. The result has no lattice directions, so that forces are
        gathered from a table.
    fraction
        Fraction g of the stiffness that relaxes, between 0 and 1.
    relaxation_time
        τ [s].

    Raises
    ------
    ValueError
        If a number is out of range, or connections of the system yield or can break already.

    Reference: Christensen, Theory of Viscoelasticity, 2nd ed. (1982), 1.5.
    """
    checks.instance("system", system, System, "box((3, 3, 3))")
    fraction = checks.between("fraction", fraction, 0.0, 1.0)
    time = checks.positive("relaxation_time", relaxation_time)
    if system.yields or system.tears:
        raise ValueError("connections of the system yield or break; a viscoelastic body must have others")
    count = system.connection_count

    def both(elastic: Any, relaxing: Any) -> np.ndarray:
        return np.concatenate([np.broadcast_to(elastic, count), np.broadcast_to(relaxing, count)])

    return system.replace(
        connections=np.concatenate([system.connections] * 2),
        rest_length=both(system.rest_length, system.rest_length),
        stiffness=both((1 - fraction) * system.stiffness, fraction * system.stiffness),
        damping=both(system.damping, 0.0),
        yield_strain=both(np.inf, 0.0),
        relaxation_time=both(0.0, time),
        largest_plastic_strain=both(0.0, MOST),
        break_strain=np.inf,
        break_force=np.inf,
        broken_at=np.inf,
        directions=({},),
    )
