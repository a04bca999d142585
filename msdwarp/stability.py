"""Stability: how fast a system can oscillate and creep, and the substeps that follow from it.

For a linear system M x'' = −K x − B x' an explicit method is stable while the step stays below a limit set
by the largest eigenvalues of M⁻¹K and M⁻¹B; each integrator states that limit (`stable_step`). Both
eigenvalues are bounded from above in one pass over the connections. With the axis d of a connection,
xᵀKx = Σ k (d·(x_i − x_j))² ≤ 2 Σ k ((d·x_i)² + (d·x_j)²) = 2 Σ_i x_iᵀ A_i x_i, where A_i = Σ k d dᵀ over the
connections of particle i, and so

    max_i |A_i| / m_i  ≤  λ_max(M⁻¹K)  ≤  2 max_i |A_i| / m_i

A stretched spring is stiff across its axis too, by k (1 − l0/l); the damper is not.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .integrators import Integrator
from .system import System


def rate_bounds(system: System) -> tuple[float, float]:
    """Return upper bounds of the largest eigenvalues of M⁻¹K [1/s²] and M⁻¹B [1/s], as the system stands."""
    i, j = system.connections.T
    axis = system.position[i] - system.position[j]
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.divide(axis, length, out=np.zeros_like(axis), where=length > 0)
    slack = np.divide(
        system.rest_length, length[:, 0], out=np.full(len(length), math.inf), where=length[:, 0] > 0
    )
    across = np.maximum(0.0, 1.0 - slack)
    return (
        _block_bound(system, system.stiffness, axis, across),
        _block_bound(system, system.damping, axis, np.zeros_like(across)),
    )


def _block_bound(system: System, constant: NDArray, axis: NDArray, across: NDArray) -> float:
    """Return 2 max_i |A_i|/m_i with A_i = Σ c (d dᵀ + across (1 − d dᵀ)) over the connections of i."""
    d = system.dim
    i, j = system.connections.T
    blocks = np.empty((system.particle_count, d, d))
    for p in range(d):
        for q in range(p, d):
            entry = constant * ((1.0 - across) * axis[:, p] * axis[:, q] + across * (p == q))
            total = np.bincount(i, entry, system.particle_count)
            total += np.bincount(j, entry, system.particle_count)
            blocks[:, p, q] = blocks[:, q, p] = total
    largest = np.linalg.eigvalsh(blocks)[:, -1]
    return float(2.0 * np.max(largest / system.mass))


def stable_substeps(system: System, integrator: Integrator, fps: float, safety: float = 0.8) -> int:
    """Return the least number of substeps per frame for which a substep is within `safety` of the limit."""
    limit = integrator.stable_step(*rate_bounds(system))
    return max(1, math.ceil(1.0 / (fps * safety * limit)))
