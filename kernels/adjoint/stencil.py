"""The adjoint of spring forces in a uniform lattice, with its loop over neighbours unrolled."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..springs.force_algorithm import velocity_of
from ..springs.stencil import stencil_rows
from .kick import AdjointData, kick_back
from .springs import Wanted, keeping, linear_adjoint

BLOCK = 256
BOUNDS = (BLOCK, 4)
"""Threads in a block, and launch bounds, which limit registers: fastest on an H200, of 1 to 5 blocks."""


@functools.cache
def stencil_adjoint(dim: int, scalar: type, damped: bool, wanted: Wanted, steps: tuple, Lattice: Any):
    """Compose the kernel of `springs_adjoint` for a uniform `Lattice` (see `springs.stencil`) with linear laws.

    Derivatives by constants have an entry for each direction from each particle, as in `in_lattice`.
    """
    V, Data, (load, store, _) = vector(dim, scalar), AdjointData(dim, scalar), records(dim, scalar)
    Three, own = vector(3, scalar), any(wanted)
    derive, keep = linear_adjoint(dim, scalar, damped), keeping(dim, scalar, wanted)
    propagate, velocity = kick_back(dim, scalar), velocity_of(dim, scalar, damped)
    rows, neighbours = stencil_rows(steps)
    most = max(map(len, neighbours))

    def field(r: int, n: int, name: str) -> int:
        return getattr(neighbours[r][n], name) if n < len(neighbours[r]) else 0

    def owns(r: int, n: int) -> bool:
        """Tell whether the particle writes the derivatives by the constants of this spring."""
        return own and field(r, n, "bit") < 1 << len(steps)

    def add_stencil_adjoint(
        data: Data,
        table: Lattice,
        stage: int,
        # State, at which the forces were evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # ∂L/∂F of each particle
        # The substep before, for `kick_back`; 0 for none:
        drift: scalar,
        kick: scalar,
        v_before: wp.array(dtype=V),
        phi_before: wp.array(dtype=V),
    ):
        i = wp.tid()
        mask = table.mask[i]
        x_i = load(x, i)
        phi_i = load(phi, i)
        v_i = velocity(v, i)
        sum_x = V()
        sum_v = V()
        for r in range(wp.static(len(rows))):
            row = i + table.shift[r]
            for n in range(wp.static(most)):
                if wp.static(n < len(neighbours[r])):
                    j = row + wp.static(field(r, n, "along"))
                    d = wp.static(field(r, n, "direction"))
                    dv = v_i - velocity(v, j)
                    spring = Three(table.rest_length[d], table.stiffness[d], table.damping[d])
                    by_dx, by_dv, by_own, by_s = derive(
                        x_i - load(x, j), dv, phi_i - load(phi, j), spring, scalar(0.0)
                    )
                    # Data read for a missing neighbour are discarded.
                    if (mask & wp.uint32(wp.static(field(r, n, "bit")))) != wp.uint32(0):
                        sum_x += by_dx
                        sum_v += by_dv
                        if wp.static(owns(r, n)):
                            keep(data, d * table.mask.shape[0] + i, by_own, by_s)
        back_x = load(data.by_x, i) + sum_x
        store(data.by_x, i, back_x)
        back = load(data.by_v, i) + sum_v + drift * back_x
        store(data.by_v, i, back)
        store(phi_before, i, propagate(data, i, kick, back, v_before, v))

    bounds = BOUNDS if scalar is wp.float32 else None  # float64 needs more registers
    return kernel(add_stencil_adjoint, launch_bounds=bounds, grid_stride=False)
