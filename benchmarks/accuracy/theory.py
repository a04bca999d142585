"""Linear theory: the fastest mode of a system, amplification matrices, and the steps at which they reach 1.

Where every connection has the same ratio b/k, a system at rest falls into modes x'' = −λx − (b/k)λx', and a
method with step h turns (hv, x) of a mode into M(h, λ)(hv, x). It is stable while no mode of the spectrum
0 < λ ≤ λ_max has a spectral radius above 1.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import eigsh

from msdwarp import RK4, RKC2, ExplicitEuler, Integrator, Leapfrog, SymplecticEuler, System
from msdwarp.integrators.rkc2 import coefficients


def at_rest(system: System) -> bool:
    """Tell whether every spring has its rest length."""
    return bool(np.allclose(system.strain, 0, atol=1e-12))


def top_mode(system: System) -> tuple[float, NDArray]:
    """Return (λ_max of M⁻¹K [1/s²], its mode of unit maximum), by Lanczos on the connections' axes d.

    K = Σ k d dᵀ in the particles' coordinates, and transversally k (1 − l0/l), 0 at rest.
    """
    i, j = system.connections.T
    dx = system.position[i] - system.position[j]
    axis = dx / np.linalg.norm(dx, axis=1)[:, None]
    c, dim, n = system.connection_count, system.dim, system.particle_count
    columns = np.concatenate([i[:, None] * dim + np.arange(dim), j[:, None] * dim + np.arange(dim)], axis=1)
    rows = np.repeat(np.arange(c), 2 * dim)
    root = np.sqrt(1 / system.mass)[:, None] * np.ones(dim)
    values = np.concatenate([axis, -axis], axis=1) * np.sqrt(system.stiffness)[:, None]
    half = coo_array((values.ravel(), (rows, columns.ravel())), shape=(c, n * dim)).tocsr()
    half = half.multiply(root.ravel()[None, :]).tocsr()
    start = np.random.default_rng(0).standard_normal(n * dim)
    value, mode = eigsh(half.T @ half, k=1, which="LA", v0=start, tol=1e-9)
    mode = (mode[:, 0] * root.ravel()).reshape(n, dim)
    return float(value[0]), mode / np.abs(mode).max()


def amplification(method: Integrator, h: float, stiffness: NDArray, ratio: float) -> NDArray:
    """Return the spectral radius of one substep for modes λ = `stiffness` with dampers of b/k = `ratio`.

    Derived in docs/stability.md. α = h²λ and β = h(b/k)λ.
    """
    alpha, beta = h * h * stiffness, h * ratio * stiffness
    one, zero = np.ones_like(alpha), np.zeros_like(alpha)
    if isinstance(method, RK4 | RKC2):
        z = -beta / 2 + np.sqrt(beta**2 / 4 - alpha + 0j)
        other = -beta / 2 - np.sqrt(beta**2 / 4 - alpha + 0j)
        return np.maximum(abs(_polynomial(method, z)), abs(_polynomial(method, other)))
    if isinstance(method, ExplicitEuler):
        rows = [[1 - beta, -alpha], [one, one]]
    elif isinstance(method, SymplecticEuler) or (isinstance(method, Leapfrog) and not method.damper_extrapolation):
        rows = [[1 - beta, -alpha], [1 - beta, 1 - alpha]]
    else:  # (hv, h times the velocity before, x)
        ahead, behind = 1.5 * beta, 0.5 * beta
        rows = [[1 - ahead, behind, -alpha], [one, zero, zero], [1 - ahead, behind, 1 - alpha]]
    matrices = np.moveaxis(np.array(rows), -1, 0)
    return np.abs(np.linalg.eigvals(matrices)).max(axis=1)


def _polynomial(method: Integrator, z: NDArray) -> NDArray:
    """Return the stability polynomial at z = hμ."""
    if isinstance(method, RK4):
        return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    c = coefficients(method.evaluations)
    return c.a + c.b * np.polynomial.Chebyshev.basis(method.evaluations)(c.w0 + c.w1 * z)


def stable_step(method: Integrator, largest: float, ratio: float) -> float:
    """Return the least h [s] past which some mode up to λ = `largest` grows; 0 if even small steps do."""
    modes = largest * np.linspace(0, 1, 401)[1:]

    def stable(h: float) -> bool:
        return bool(amplification(method, h, modes, ratio).max() <= 1 + 1e-10)

    if isinstance(method, RKC2) and method.stages is None:
        return max(stable_step(RKC2(s), largest, ratio) for s in range(2, 6))
    step = 1e-4 / np.sqrt(largest)
    if not stable(step):
        return 0.0
    while stable(1.02 * step):
        step *= 1.02
    low, high = step, 1.02 * step
    while high - low > 1e-7 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
