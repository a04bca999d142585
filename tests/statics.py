"""Static equilibrium of springs under dead loads, by SciPy: shares nothing with the package but the numbers."""

import numpy as np
from problems import forces
from scipy.sparse import bsr_array, coo_array, csc_array, eye_array, kron
from scipy.sparse.linalg import splu

from msdwarp import System


def equilibrium(system: System, load: np.ndarray, *, residual: float = 1e-6) -> np.ndarray:
    """Return where every particle rests under a load [N], shape [particle_count, 3]: no force is above `residual`.

    Newton's method on the potential energy from the positions of the system. In place of the tangent stiffness it
    has that without what compression takes away, which is positive: each step goes downhill, and is halved until
    it arrives lower.
    """
    count, links = system.particle_count, system.connection_count
    ends = system.connections.ravel()
    between = coo_array(
        (np.tile([-1.0, 1.0], links), (np.repeat(np.arange(links), 2), ends)), shape=(links, count)
    )
    free = np.repeat(~system.pinned, 3)
    apart = csc_array(kron(between, np.eye(3)))[
        :, free
    ]  # from moves of the free particles to those of the springs
    k, rest, still = system.stiffness, system.rest_length, np.zeros_like(load)

    def energy(x: np.ndarray) -> float:
        return float((0.5 * k * (np.linalg.norm(between @ x, axis=1) - rest) ** 2).sum() - (load * x).sum())

    x = np.array(system.position)
    for _ in range(100):
        out_of_balance = (forces(system, x, still) + load).ravel()[free]
        if np.abs(out_of_balance).max() < residual:
            return x
        d = between @ x
        length = np.linalg.norm(d, axis=1)
        along = np.einsum("ca,cb->cab", d, d) / length[:, None, None] ** 2
        pull = np.maximum(0.0, 1 - rest / length)
        blocks = k[:, None, None] * (along + pull[:, None, None] * (np.eye(3) - along))
        springs = bsr_array((blocks, np.arange(links), np.arange(links + 1)))  # a block for each, on the diagonal
        tangent = apart.T @ springs @ apart + 1e-3 * eye_array(free.sum())
        step = np.zeros(3 * count)
        step[free] = splu(csc_array(tangent)).solve(out_of_balance)
        share = min(1.0, 0.2 / np.abs(step).max())
        while energy(x + share * step.reshape(x.shape)) > energy(x) and share > 1e-9:
            share /= 2
        x = x + share * step.reshape(x.shape)
    raise AssertionError(f"no equilibrium: {np.abs(out_of_balance).max():g} N are left")
