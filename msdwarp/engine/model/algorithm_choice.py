"""The choice of the force algorithm; `msdwarp.kernels.springs` describes the algorithms.

The choice affects only speed: results agree to rounding. Thresholds are from benchmarks/results/*/throughput.csv.
"""

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...bodies import System
from .lattice import Lattice, NotALattice, find_lattice

FORCE_ALGORITHMS = ("scatter", "gather", "stencil")
AUTO = "auto"
FEW_CONNECTIONS = 300
"""Up to this number scatter is faster: its threads, one per connection, have less work than one per particle."""
LEAST_PARTICLES = 32
"""Up to this number of particles a stencil is faster than scatter: it has several threads per particle."""
FEW_PARTICLES = 20_000
"""Up to this number of particles latency dominates; a stencil has the least."""
LEAST_USED = 0.4
"""Fraction of a lattice's neighbours that must exist for a stencil to be faster than a neighbour table."""
MOST_TIES = 0.05
"""Largest fraction of connections that may be ties, outside all lattice directions."""


def choose_force_algorithm(system: System, force_algorithm: str, *, on_gpu: bool) -> tuple[str, Lattice | None]:
    """Return the algorithm, for "auto" the fastest one, and the system's lattice if it is a stencil, else None.

    Raises ValueError if `force_algorithm` is unknown, or "stencil" for a system that is not cut from lattices.
    """
    checks.one_of("force_algorithm", force_algorithm, (AUTO, *FORCE_ALGORITHMS))
    if force_algorithm == AUTO:
        return automatic_force_algorithm(system, on_gpu=on_gpu)
    if force_algorithm != "stencil":
        return force_algorithm, None
    try:
        return force_algorithm, find_lattice(system)
    except NotALattice as error:
        raise ValueError(f"force_algorithm is 'stencil', which this system cannot take: {error}") from error


def automatic_force_algorithm(system: System, *, on_gpu: bool) -> tuple[str, Lattice | None]:
    """Return the fastest algorithm in benchmarks of similar systems, and the lattice if it is a stencil."""
    few = system.connection_count <= FEW_CONNECTIONS
    if not on_gpu or (few and system.particle_count > LEAST_PARTICLES):
        return "scatter", None
    try:
        lattice = find_lattice(system)
    except NotALattice:
        return "scatter" if few else "gather", None
    ties = len(lattice.ties)
    if few:
        return ("stencil", lattice) if lattice.uniform and not ties and not system.tears else ("scatter", None)
    if ties > MOST_TIES * system.connection_count:
        return "gather", None
    # A stencil also spends time on missing neighbours.
    used = (system.connection_count - ties) / (len(lattice.steps) * system.particle_count)
    small = system.particle_count <= FEW_PARTICLES
    return ("stencil", lattice) if small or used > LEAST_USED else ("gather", None)


def ensemble_force_algorithm(system: System, *, on_gpu: bool) -> str:
    """Return the algorithm for many worlds of a system; its sums are in a fixed order.

    Lattices with ties (springs in no lattice direction) use a table, because ties have their own constants.
    """
    if not on_gpu:
        return "scatter"
    try:
        return "gather" if len(find_lattice(system).ties) else "stencil"
    except NotALattice:
        return "gather"


def scatter_order(system: System) -> NDArray[np.int64] | None:
    """Return an order of connections in which scatter seldom waits; None if the current order is suitable.

    Forces of successive connections are added in parallel; two with a common particle wait for each other. So the
    order consists of rounds, each with at most one connection of every first particle.
    """
    first = system.connections[:, 0]
    if len(first) < 2 or np.count_nonzero(first[1:] == first[:-1]) < 0.2 * len(first):
        return None
    by_particle = np.argsort(first, kind="stable")
    ordered = first[by_particle]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    rank = np.arange(len(first)) - np.repeat(starts, np.diff(np.r_[starts, len(first)]))
    return by_particle[np.argsort(rank, kind="stable")]
