"""Statics of a lattice of a material, by sparse matrices of its springs at rest."""

import itertools

import numpy as np
from scipy.sparse import bmat, coo_matrix, csc_matrix, vstack
from scipy.sparse.linalg import spsolve

from msdwarp import Material, System

SOLID = Material(density=1000.0, youngs_modulus=3e6, damping_ratio=0.1)
AREA = 3e-4


def stiffness_matrix(system: System) -> csc_matrix:
    """Return the tangent stiffness of a system at rest [N/m], shape [particle_count d, particle_count d]."""
    n, dim = system.position.shape
    i, j = system.connections.T
    axis = (system.position[j] - system.position[i]) / system.rest_length[:, None]
    block = system.stiffness[:, None, None] * axis[:, :, None] * axis[:, None, :]
    rows, columns, values = [], [], []
    for p, q, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        rows.append(np.broadcast_to((dim * p[:, None] + np.arange(dim))[:, :, None], block.shape).ravel())
        columns.append(np.broadcast_to((dim * q[:, None] + np.arange(dim))[:, None, :], block.shape).ravel())
        values.append(sign * block.ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return coo_matrix(entries, (n * dim, n * dim)).tocsc()


def deflection_matrix(system: System) -> csc_matrix:
    """Return the stiffness of a flat sheet against deflections [N/m]: of a connection with force F, F over l."""
    i, j = system.connections.T
    across = system.stiffness * (1 - system.rest_length / system.length)
    entries = np.concatenate([across, across, -across, -across])
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    return csc_matrix((entries, (rows, columns)), (system.particle_count, system.particle_count))


def displacement(system: System, force: np.ndarray, conditions: list[np.ndarray]) -> np.ndarray:
    """Return the displacement under a static force such that the product with each condition is 0."""
    matrix = stiffness_matrix(system)
    held = vstack([csc_matrix(condition.reshape(1, -1)) for condition in conditions])
    whole = bmat([[matrix, held.T], [held, None]]).tocsc()
    known = np.concatenate([force.ravel(), np.zeros(held.shape[0])])
    return spsolve(whole, known)[: force.size].reshape(force.shape)


def rigid_motions(x: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
    """Return the conditions that a displacement has no mean and no mean turn, over weighted particles."""
    dim = x.shape[1]
    conditions = []
    for k in range(dim):
        shift = np.zeros(x.shape)
        shift[:, k] = weights
        conditions.append(shift)
    for k, m in itertools.combinations(range(dim), 2):
        turn = np.zeros(x.shape)
        turn[:, k], turn[:, m] = -weights * x[:, m], weights * x[:, k]
        conditions.append(turn)
    return conditions
