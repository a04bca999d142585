"""Tangent: the derivatives of all forces by positions and by velocities, as sparse matrices."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime import in_turn
from ..model.effect import Steps
from ..model.state import State
from ..stepping.assemble import Assembly
from ..stepping.dynamics import Dynamics
from ..stepping.velocities import kicked
from .adjoint import Adjoint, without_adjoint


class Tangent:
    """The forces F on all particles of a single world, pinned ones included, and their derivatives at a state.

    No effect may be `without_adjoint`. Functions of time have their values at `time` [s].
    """

    def __init__(self, assembly: Assembly, state: State, time: float) -> None:
        if missing := without_adjoint(assembly):
            raise ValueError(f"the scene has {' and '.join(missing)}, whose forces have no derivative here")
        self.model, self._assembly, self._state = assembly.model, assembly, state
        self._dynamics = Dynamics(assembly)
        self._dynamics.begin(Steps(1.0, 1, still=True))
        self._dynamics.hold(time)

    @in_turn
    def forces(self) -> NDArray[np.float64]:
        """Return forces on free particles, with weight, without rigid obstacles [N], shape [particle_count, d]."""
        gained = kicked(self._dynamics, self._state, 1.0, self.model.vectors()).numpy() - self._state.v.numpy()
        return np.where(np.isfinite(self.model.mass), self.model.mass, 0.0)[:, None] * gained

    @in_turn
    def matrices(self) -> tuple[Any, Any]:
        """Return K = −∂F/∂x [N/m] and B = −∂F/∂v [N s/m], sparse arrays of SciPy of d × d blocks.

        In float64 they are exact up to rounding. Differences of forces leave errors of 1e-9 of the largest entry;
        slow vibrations of slender bodies have squared frequencies as small as that.

        The adjoint of all forces turns φ into (∂F/∂x)ᵀ φ. If φ is 1 along an axis on particles of one color, no
        two of which act on the same particle, that is a row of ∂F/∂x of each of them, side by side. Reference:
        Curtis, Powell & Reid, On the estimation of sparse Jacobian matrices, IMA J. Appl. Math. 13 (1974).
        """
        from scipy.sparse import bsr_array

        model, state, adjoint = self.model, self._state, Adjoint(self._dynamics, ())
        model.kernels.compile()
        couples = _couples(self._assembly)
        color = _colors(couples @ couples)
        column, of_row = couples.indices, np.repeat(color, np.diff(couples.indptr))
        blocks = np.zeros((2, len(column), model.dim, model.dim))
        for k in range(int(color.max()) + 1):
            entries = np.flatnonzero(of_row == k)
            for axis in range(model.dim):
                phi = np.zeros((model.particle_count, model.dim))
                phi[color == k, axis] = 1.0
                for block, by in zip(blocks, adjoint.of_forces(phi, state.x, state.v), strict=True):
                    block[entries, axis] = -by[column[entries]]
        found: Any = [bsr_array((block, column, couples.indptr)) for block in blocks]
        return found[0], found[1]


def _couples(assembly: Assembly) -> Any:
    """Return which particles act on which, a symmetric sparse matrix of shape [particle_count, particle_count]."""
    from scipy.sparse import coo_array, eye_array

    count = assembly.model.particle_count
    groups: list[NDArray[np.integer]] = [assembly.model.system.connections]
    for effect in assembly.all:
        elements = effect.elements()
        if elements is None or not elements.of_motion:
            continue
        points = elements.points if elements.prepare is None else elements.points.reshape(1, -1)  # one gas: all
        if elements.vertices is not None:
            points = elements.vertices.particle[points].reshape(len(points), -1)
        groups.append(points)
    couples: Any = eye_array(count, format="csr")
    for points in groups:
        group, place = np.nonzero(points >= 0)
        ones = np.ones(len(group))
        within = coo_array((ones, (group, points[group, place])), shape=(len(points), count)).tocsr()
        couples = couples + within.T @ within
    couples.sort_indices()
    return couples.tocsr()


def _colors(near: Any) -> NDArray[np.int64]:
    """Return a color for each particle, such that no two that are `near` each other have the same."""
    color = np.full(near.shape[0], -1)
    for i in range(len(color)):
        taken = color[near.indices[near.indptr[i] : near.indptr[i + 1]]]
        free = np.ones(len(taken) + 1, dtype=bool)
        free[taken[(taken >= 0) & (taken < len(free))]] = False
        color[i] = np.argmax(free)
    return color
