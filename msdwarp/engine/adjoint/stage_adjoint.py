"""The adjoint of explicit methods with a tableau: goes back through the stages, from the last to the first."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint.stages import combination_adjoint
from ..device.vector_arrays import in_records, numbers_of
from ..stepping.dynamics import Dynamics
from .adjoint import Adjoint
from .tape import Tape


class StageAdjoint(Adjoint):
    """An `Adjoint` for substeps of several stages, given by a tableau.

    State n of a substep is Y_n = Y_0 + h Σ_m A_nm (v_m, a_m). With λ_n = ∂L/∂Y_n, the derivative by (v_m, a_m) is
    κ_m = h Σ_n A_nm λ_n, and λ_m = (∂(v, a)/∂Y)ᵀ κ_m at Y_m. The derivative by Y_0 is Σ_n λ_n. The stages of a
    substep are repeated from its start, and stored for this. Reference: Sanz-Serna, SIAM Review
    58 (2016) 3-33.

    Parameters
    ----------
    dynamics, wanted
        See `Adjoint`.
    tableau
        A, the coefficients of the method, shape [stages, stages]; see `Integrator.tableau`.
    h
        Length of a substep [s].
    """

    def __init__(self, dynamics: Dynamics, wanted: Iterable[str], tableau: NDArray, h: float) -> None:
        names = set(wanted)
        super().__init__(dynamics, names)
        model, stages = dynamics.model, len(tableau)
        kinds = model.dim, model.scalar
        self._combine = combination_adjoint(*kinds)
        inner = model.vectors_together(2 * (stages - 1)) if stages > 1 else ()
        self._inner = list(zip(inner[::2], inner[1::2], strict=True))
        self._kept = in_records(2 * (stages + 1) * self._count, *kinds, model.device)
        self._times = [0.0, *(h * tableau.sum(axis=1)).tolist()]
        weight = np.vstack([np.ones(stages + 1), np.insert(h * tableau.T, 0, 0.0, axis=1)])
        self._weight: Any = wp.array(weight, dtype=model.scalar, device=model.device)

    def frame(self, h: float, tape: Tape) -> None:
        """Propagate derivatives back through the substeps of a frame; see `Adjoint.frame`."""
        stages = len(self._inner) + 1
        for k in reversed(range(len(tape.states) - 1)):
            states = [tape.states[k], *self._inner, tape.states[k + 1]]
            tape.take(k, self._keep)
            for n in reversed(range(stages)):
                self._propagate_combination(n + 1, states, k * stages)
                x, v = states[n]
                self._propagate_forces(x, v, k * stages + n)
            self._propagate_combination(0, states, k * stages)

    def _keep(self, stage: int, x: wp.array, v: wp.array) -> None:
        """Store the state at which a stage evaluates forces; the tape already has the first."""
        if stage:
            for kept, now in zip(self._inner[stage - 1], (x, v), strict=True):
                self._launch_once(partial(wp.copy, numbers_of(kept), numbers_of(now)))

    def _propagate_combination(self, n: int, states: list[Any], begin: int) -> None:
        """Propagate derivatives by state n of a substep, whose first stage is `begin`, back by one stage."""
        self.forget_driven(begin + n)
        inputs = [self._data, self._weight, n, self._times[n], states[0][1], states[n][1], self._kept, self._phi]
        self._launch(self._combine, self._count, inputs)
