"""Interface of force algorithms, and their common code."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from ..compensation import state_types
from ..records import records


class ForceAlgorithm(NamedTuple):
    """The device side of a force algorithm."""

    Forces: Any
    """Type of the struct that the functions read."""
    force_at: Any
    """wp.func (forces, compensation, x, v, i) -> force on particle i [N]."""
    evaluate: Any = None
    """wp.func (forces, compensation, x, v, c) that adds spring c's force before `force_at`; None if not needed."""
    column_forces: Any = None
    """wp.func (forces, compensation, x, v, i) -> forces on particles i + d stride, as rows d of a matrix."""
    block: int = 256
    """Threads per block in launches over particles."""
    bounds: tuple[int, int] | None = None
    """Launch bounds, which limit registers: threads per block, blocks per multiprocessor (`wp.kernel`)."""
    column_bounds: tuple[int, int] | None = None
    """`bounds` for kernels over columns."""
    tears: bool = False
    """Whether springs break, so that `Forces` has the data of `breaking`."""
    grid_stride: bool | None = None
    """Whether a thread may take several particles (option of `wp.kernel`): False needs fewer registers."""
    lanes: int = 1
    """Threads per particle: each of them calls `force_at`, and receives the force."""


@functools.cache
def difference(dim: int, scalar: type, compensated: bool):
    """Compose x_i − x_j for the uncompensated position x_i of particle i, and particle j."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.func
    def separation(compensation: Compensation, x: Vectors, x_i: V, i: int, j: int) -> V:
        dx = x_i - load(x, j)
        if wp.static(compensated):
            dx = dx - (load(compensation.x, i) - load(compensation.x, j))
        return dx

    return separation


@functools.cache
def velocity_of(dim: int, scalar: type, damped: bool):
    """Compose the velocity of particle i; without dampers, which alone need it, it is 0 and is not read."""
    V = vector(dim, scalar)

    @wp.func
    def not_read(v: wp.array(dtype=V), i: int) -> V:
        return V()

    return records(dim, scalar).load if damped else not_read


PAIR = """
#if defined(__CUDA_ARCH__)
    const int2 ends = reinterpret_cast<const int2*>(connections.data)[c];
    return {ends.x, ends.y};
#else
    return connections.data[c];
#endif
"""


@wp.func_native(PAIR)
def ends_of(connections: wp.array(dtype=wp.vec2i), c: int) -> wp.vec2i:
    """Return the two particles of spring c."""
    ...
