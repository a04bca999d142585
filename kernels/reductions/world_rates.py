"""How fast the particles of each world can move against their neighbours: see `msdwarp.integrators.stability`."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..springs.linearised import connection_blocks
from .stability import largest_eigenvalue


@functools.cache
def add_blocks_of_worlds(dim: int, scalar: type):
    """Compose the kernel, over worlds and connections, that adds each to the blocks of its two particles.

    They are those of `springs.add_blocks`, by the same arithmetic.
    """
    V, Block, blocks_of = (
        vector(dim, scalar),
        wp.types.matrix((dim, dim), wp.float64),
        connection_blocks(dim, scalar),
    )

    @kernel
    def add_blocks_of_each(
        # Model, row w mod (number of rows) for world w:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array2d(dtype=scalar),  # l0 [m], shape [rows, connection_count]
        stiffness: wp.array2d(dtype=scalar),  # k [N/m], shape [rows, connection_count]
        damping: wp.array2d(dtype=scalar),  # b, steepest slope of the law [N s/m], shape [rows, connection_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], of all worlds
        stride: int,  # from one world to the next, in particles
        # Out:
        stiffness_block: wp.array2d(dtype=Block),  # 0 before [N/m], shape [world_count, particle_count]
        damping_block: wp.array2d(dtype=Block),  # 0 before [N s/m], shape [world_count, particle_count]
    ):
        w, c = wp.tid()
        i = connections[c][0]
        j = connections[c][1]
        dx = x[w * stride + i] - x[w * stride + j]
        if wp.length(dx) == scalar(0.0):
            return
        spring, along = blocks_of(
            dx,
            rest_length[w % rest_length.shape[0], c],
            stiffness[w % stiffness.shape[0], c],
            damping[w % damping.shape[0], c],
        )
        wp.atomic_add(stiffness_block, w, i, spring)
        wp.atomic_add(stiffness_block, w, j, spring)
        wp.atomic_add(damping_block, w, i, along)
        wp.atomic_add(damping_block, w, j, along)

    return add_blocks_of_each


@functools.cache
def raise_bounds_of_worlds(dim: int, scalar: type):
    """Compose the kernel, over worlds and particles, that raises bounds to 2|A_i|/m_i and 2|B_i|/m_i."""
    Block, largest = wp.types.matrix((dim, dim), wp.float64), largest_eigenvalue(dim)

    @kernel
    def raise_bounds_of_each(
        # Model:
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], 0 where pinned, shape [rows, particle_count]
        # Linearised at a state:
        stiffness_block: wp.array2d(dtype=Block),  # A_i [N/m], shape [world_count, particle_count]
        damping_block: wp.array2d(dtype=Block),  # B_i [N s/m], shape [world_count, particle_count]
        # Out:
        bounds: wp.array2d(dtype=wp.float64),  # 0 before; [1/s²] and [1/s], shape [world_count, 2]
    ):
        w, i = wp.tid()
        twice = wp.float64(2.0) * wp.float64(inverse_mass[w % inverse_mass.shape[0], i])
        wp.atomic_max(bounds, w, 0, twice * largest(stiffness_block[w, i]))
        wp.atomic_max(bounds, w, 1, twice * largest(damping_block[w, i]))

    return raise_bounds_of_each
