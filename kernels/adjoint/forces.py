"""The adjoint of a force that is a function of one particle's position and velocity, and of time."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..records import records


@functools.cache
def force_adjoint(dim: int, scalar: type, function: Any):
    """Compose the kernel, over chosen particles, that adds (∂F/∂x)ᵀ φ and (∂F/∂v)ᵀ φ to derivatives.

    `function` is a wp.func (x, v, t, i) -> F; Warp differentiates it.
    """
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)

    @wp.func
    def projected(x: V, v: V, t: scalar, i: int, phi: V) -> scalar:
        return wp.dot(function(x, v, t, i), phi)

    @kernel
    def add_force_adjoint(
        member: wp.array(dtype=int),  # particles that the force acts on
        time: wp.array(dtype=scalar),  # of each stage of a frame [s]
        stage: int,
        # State, at which the force was evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # derivative by the force on each particle
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        begin: int,  # members of this launch
        end: int,
        threads: int,  # of the launch
    ):
        k = begin + wp.tid()
        while k < end:
            i = member[k]
            phi_i = load(phi, i)
            of_x, of_v, _t, _i, _phi = wp.grad(projected)(load(x, i), load(v, i), time[stage], i, phi_i)
            store(by_x, i, load(by_x, i) + of_x)
            store(by_v, i, load(by_v, i) + of_v)
            k += threads

    return add_force_adjoint
