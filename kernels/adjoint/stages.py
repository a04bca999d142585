"""The adjoint of the stages of an explicit method: linear combinations of earlier states and accelerations."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from .kick import AdjointData, kick_back


@functools.cache
def combination_adjoint(dim: int, scalar: type):
    """Compose the kernel, over particles, that propagates derivatives back from state n of a substep.

    Y_n = Y_0 + h Σ_m A_nm (v_m, a_m) over the stages m < n. The kernel stores the given ∂L/∂Y_n. From all that
    are stored it computes ∂L/∂v_m and ∂L/∂a_m for m = n − 1, and φ = ∂L/∂F of each particle. For n = 0 it sums the
    stored ones, which gives the derivative with respect to the start of the substep.
    """
    V, Data, (load, store, _) = vector(dim, scalar), AdjointData(dim, scalar), records(dim, scalar)
    propagate = kick_back(dim, scalar)

    @kernel
    def propagate_combination(
        data: Data,
        weight: wp.array2d(dtype=scalar),  # row n: h A_k(n−1) for each state k [s]; row 0: 1
        n: int,
        seconds: scalar,  # from the start to this state [s]
        # State:
        v_start: wp.array(dtype=V),  # velocities at the start of the substep; below, of this state
        v: wp.array(dtype=V),
        # Derivatives by positions, then by velocities, of each state; shape [2 states particle_count]:
        kept: wp.array(dtype=V),
        # Out:
        phi: wp.array(dtype=V),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        states = weight.shape[1]
        count = data.inverse_mass.shape[0]
        i = begin + wp.tid()
        while i < end:
            back = load(data.by_v, i)
            propagate(data, i, seconds, back, v_start, v)
            store(kept, n * count + i, load(data.by_x, i))
            store(kept, (states + n) * count + i, back)
            sum_x = V()
            sum_v = V()
            for k in range(n, states):
                sum_x += weight[n, k] * load(kept, k * count + i)
                sum_v += weight[n, k] * load(kept, (states + k) * count + i)
            if n == 0:
                store(data.by_x, i, sum_x)
                store(data.by_v, i, sum_v)
            else:
                store(data.by_x, i, V())
                store(data.by_v, i, sum_x)
                store(phi, i, data.inverse_mass[i] * sum_v)
            i += threads

    return propagate_combination
