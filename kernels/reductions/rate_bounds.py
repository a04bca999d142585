"""Bounds on oscillation and relaxation rates of particles; see `msdwarp.integrators.stability`."""

import functools

import warp as wp

from ..basis import kernel


@functools.cache
def largest_eigenvalue(dim: int):
    """Compose the largest eigenvalue of a symmetric float64 matrix; in three dimensions by Smith (1961)."""
    Block = wp.types.matrix((dim, dim), wp.float64)

    @wp.func
    def largest(A: Block) -> wp.float64:
        if wp.static(dim == 1):
            return A[0, 0]
        if wp.static(dim == 2):
            middle = wp.float64(0.5) * (A[0, 0] + A[1, 1])
            half = wp.float64(0.5) * (A[0, 0] - A[1, 1])
            return middle + wp.sqrt(half * half + A[0, 1] * A[0, 1])
        if wp.static(dim == 3):
            mean = (A[0, 0] + A[1, 1] + A[2, 2]) / wp.float64(3.0)
            off = A[0, 1] * A[0, 1] + A[0, 2] * A[0, 2] + A[1, 2] * A[1, 2]
            a = A[0, 0] - mean
            b = A[1, 1] - mean
            c = A[2, 2] - mean
            spread = wp.sqrt((a * a + b * b + c * c + wp.float64(2.0) * off) / wp.float64(6.0))
            if spread == wp.float64(0.0):
                return mean
            det = a * (b * c - A[1, 2] * A[1, 2]) - A[0, 1] * (A[0, 1] * c - A[1, 2] * A[0, 2])
            det += A[0, 2] * (A[0, 1] * A[1, 2] - b * A[0, 2])
            r = det / (wp.float64(2.0) * spread * spread * spread)
            r = wp.clamp(r, wp.float64(-1.0), wp.float64(1.0))
            return mean + wp.float64(2.0) * spread * wp.cos(wp.acos(r) / wp.float64(3.0))

    return largest


@functools.cache
def largest_rate(dim: int, scalar: type):
    """Compose the kernel, over worlds and particles, that finds the largest 2 |A_i|/m_i and 2 |B_i|/m_i."""
    Block, largest = wp.types.matrix((dim, dim), wp.float64), largest_eigenvalue(dim)

    @kernel
    def raise_bounds(
        # Model, row w mod (number of rows) for world w:
        inverse_mass: wp.array2d(dtype=scalar),  # 1/m_i [1/kg], 0 where pinned, shape [rows, particle_count]
        # Linearised at a state:
        stiffness_block: wp.array2d(dtype=Block),  # A_i [N/m], shape [worlds, particle_count]
        damping_block: wp.array2d(dtype=Block),  # B_i [N s/m], shape [worlds, particle_count]
        # Out:
        bounds: wp.array2d(dtype=wp.float64),  # initially 0; [1/s²] and [1/s], shape [worlds, 2]
    ):
        w, i = wp.tid()
        twice = wp.float64(2.0) * wp.float64(inverse_mass[w % inverse_mass.shape[0], i])
        wp.atomic_max(bounds, w, 0, twice * largest(stiffness_block[w, i]))
        wp.atomic_max(bounds, w, 1, twice * largest(damping_block[w, i]))

    return raise_bounds
