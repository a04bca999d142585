"""Viscoelastic bodies: a share of each spring's force relaxes."""

from typing import Any

import numpy as np

from .. import checks
from ..bodies import System

MOST = 0.99
"""Largest change of a relaxing spring's rest length, as a share: it is never reached at usual strains."""


def viscoelastic(system: System, share: float = 0.5, relaxation_time: float = 1.0) -> System:
    """Return a body that is a standard linear solid: after a strain its force relaxes by a share.

    Beside each spring of stiffness k (1 − share) stands a Maxwell element: a spring of stiffness k share in series
    with a dashpot. It is a connection that yields from the start, so that its rest length follows its length with
    the relaxation time τ. A small held strain ε has the force k l0 ε (1 − share + share exp(−t/τ)).

    Parameters
    ----------
    system
        The body; the dampers of its connections stay. It loses its lattice directions, so that forces are gathered
        from a table.
    share
        Share of the stiffness that relaxes, between 0 and 1.
    relaxation_time
        τ [s].

    Raises
    ------
    ValueError
        If a number is out of range, or connections of the system yield or can break already.

    Reference: Christensen, Theory of Viscoelasticity, 2nd ed. (1982), 1.5.
    """
    checks.instance("system", system, System, "box((3, 3, 3))")
    share = checks.between("share", share, 0.0, 1.0)
    time = checks.positive("relaxation_time", relaxation_time)
    if system.yields or system.tears:
        raise ValueError("connections of the system yield or break; a viscoelastic body must have others")
    count = system.connection_count

    def both(elastic: Any, relaxing: Any) -> np.ndarray:
        return np.concatenate([np.broadcast_to(elastic, count), np.broadcast_to(relaxing, count)])

    return system.replace(
        connections=np.concatenate([system.connections] * 2),
        rest_length=both(system.rest_length, system.rest_length),
        stiffness=both((1 - share) * system.stiffness, share * system.stiffness),
        damping=both(system.damping, 0.0),
        yield_strain=both(np.inf, 0.0),
        relaxation_time=both(0.0, time),
        largest_plastic_strain=both(0.0, MOST),
        break_strain=np.inf,
        break_force=np.inf,
        broken_at=np.inf,
        directions=({},),
    )
