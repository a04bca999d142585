"""Springs that deform permanently: the rest length follows strain beyond the yield strain."""

import functools

import warp as wp

from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records
from .force_algorithm import difference


@functools.cache
def plastic_flow(dim: int, scalar: type, compensated: bool):
    """Compose (Flow, flow): the rest lengths and their bounds, and flow(f, compensation, x, c) for spring c.

    An elastic spring and a slider in series (Bingham): with e = l − l0, original length L0, yield strain ε_y
    and relaxation time τ, while |e| > ε_y L0,

        l0' = sign(e) (|e| − ε_y L0) / τ,  |l0 − L0| ≤ ε_max L0

    A substep uses the exact solution for constant length, l0 += (1 − exp(−h/τ)) (|e| − ε_y L0) sign(e), so the
    flow does not depend on the step. |e| and with it the elastic energy can only decrease.
    Reference: Simo & Hughes, Computational Inelasticity (1998), 1.2 and 1.7.
    """
    _, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load
    separation = difference(dim, scalar, compensated)

    @wp.struct
    class Flow:
        h: scalar  # length of a substep [s]
        # By spring, shape [connection_count]:
        connections: wp.array(dtype=wp.vec2i)
        rest_length: wp.array(dtype=scalar)  # [m], changed by the flow
        original_length: wp.array(dtype=scalar)  # [m]
        yield_strain: wp.array(dtype=scalar)
        relaxation_time: wp.array(dtype=scalar)  # [s]
        largest_plastic_strain: wp.array(dtype=scalar)

    @wp.func
    def flow(f: Flow, compensation: Compensation, x: Vectors, c: int):
        i = f.connections[c][0]
        j = f.connections[c][1]
        rest = f.rest_length[c]
        original = f.original_length[c]
        stretch = wp.length(separation(compensation, x, load(x, i), i, j)) - rest
        excess = wp.abs(stretch) - f.yield_strain[c] * original
        if excess > scalar(0.0):
            fraction = scalar(1.0)
            if f.relaxation_time[c] > scalar(0.0):
                fraction = scalar(1.0) - wp.exp(-f.h / f.relaxation_time[c])
            most = f.largest_plastic_strain[c] * original
            flown = wp.clamp(rest + fraction * excess * wp.sign(stretch), original - most, original + most)
            if (flown - rest) * stretch > scalar(0.0):  # a change has moved it beyond the bound: keep it
                f.rest_length[c] = flown

    return Flow, flow


@functools.cache
def yielding(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of plasticity: each spring flows at a substep's start."""
    Flow, flow = plastic_flow(dim, scalar, compensated)
    return ForceTerm("flow", Flow, begin=flow)
