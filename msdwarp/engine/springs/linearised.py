"""The linearised system on a device: products with K and B, and their diagonal blocks."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions.rate_bounds import largest_rate
from ...kernels.springs import linearised as kernels
from ..model.model import Model


def add_linearised(
    model: Model,
    x: wp.array,
    p: wp.array,
    z: wp.array,
    *,
    spring: float,
    damper: float,
    scale: float,
    everyone: bool = False,
) -> None:
    """Add scale (spring·K + damper·B) p to z, with K and B linearised at x, by scatter for any force algorithm.

    Pinned and driven particles are excluded, unless `everyone` is set.
    """
    if model.connection_count:
        constants = [model.connections, model.rest_length, model.stiffness, model.steepest_damping]
        wp.launch(
            kernels.add_linearised(model.dim, model.scalar, everyone),
            dim=model.connection_count,
            inputs=[*constants, model.inverse_mass, x, p, spring, damper, scale],
            outputs=[z],
            device=model.device,
        )


def note_products(model: Model) -> None:
    """Note the kernels of `add_linearised`, which solves launch."""
    everyone = {False, bool(model.driven.any())}
    model.kernels.note(*(kernels.add_linearised(model.dim, model.scalar, one) for one in everyone))


def zero_blocks(model: Model) -> list[wp.array]:
    """Return zeros for the diagonal blocks of K and B, float64 matrices of shape [different, particle_count]."""
    Block: Any = wp.types.matrix((model.dim, model.dim), wp.float64)
    shape = (model.different, model.particle_count)
    return [wp.zeros(shape, dtype=Block, device=model.device) for _ in range(2)]


def note_rates(model: Model) -> None:
    """Note the kernels that bound the rates of a model."""
    blocks = [kernels.add_blocks(model.dim, model.scalar, model.laws._replace(damper=None))]
    model.kernels.note(largest_rate(model.dim, model.scalar), *(blocks if model.connection_count else []))


def largest_rates(model: Model, springs: wp.array, dampers: wp.array) -> NDArray[np.float64]:
    """Return twice the largest eigenvalue of block over mass, of K and of B, shape [different, 2]."""
    bounds = wp.zeros((model.different, 2), dtype=wp.float64, device=model.device)
    inputs = [model.table("inverse_mass"), springs, dampers]
    wp.launch(largest_rate(model.dim, model.scalar), springs.shape, inputs, [bounds], device=model.device)
    return bounds.numpy().astype(np.float64)


def write_diagonal_blocks(model: Model, x: wp.array, springs: wp.array, dampers: wp.array) -> None:
    """Write the diagonal blocks of K and B at x, float64 matrices of shape [particle_count] in each world."""
    springs.zero_()
    dampers.zero_()
    laws = model.laws._replace(damper=None)
    if model.connection_count:
        wp.launch(
            kernels.add_blocks(model.dim, model.scalar, laws),
            dim=(springs.size // model.particle_count, model.connection_count),
            inputs=[model.connection_table(laws, "steepest_damping"), x, model.stride],
            outputs=[one.reshape((-1, model.particle_count)) for one in (springs, dampers)],
            device=model.device,
        )
