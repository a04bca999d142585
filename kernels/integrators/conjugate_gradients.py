"""The conjugate gradient method on a device."""

import functools

import warp as wp

from ..basis import kernel, vector

RZ, NEXT_RZ, PQ = 0, 1, 2
"""Indices of scalars of the method: r·z in this iteration and in the next; p·q with q = A p."""


@functools.cache
def conjugate_gradients(dim: int, scalar: type):
    """Compose the kernels of preconditioned conjugate gradients for A x = b; initially x = 0 and r = b.

    Each thread sums over several particles, so that few atomic additions compete for a scalar. Scalars stay on the
    device, so that a graph can contain any number of iterations. Reference: Golub & Van Loan,
    Matrix Computations, 4th ed. (2013), 11.5.
    """
    V = vector(dim, scalar)
    Vectors, Blocks = wp.array(dtype=V), wp.array(dtype=wp.types.matrix((dim, dim), scalar))
    Numbers = wp.array(dtype=wp.float64)

    @kernel
    def begin(inverses: Blocks, r: Vectors, x: Vectors, p: Vectors, threads: int, numbers: Numbers):
        i = wp.tid()
        total = wp.float64(0.0)
        while i < r.shape[0]:
            z = inverses[i] * r[i]
            x[i] = V()
            p[i] = z
            total += wp.float64(wp.dot(r[i], z))
            i += threads
        wp.atomic_add(numbers, RZ, total)

    @kernel
    def multiply(p: Vectors, q: Vectors, threads: int, numbers: Numbers):
        i = wp.tid()
        total = wp.float64(0.0)
        while i < p.shape[0]:
            total += wp.float64(wp.dot(p[i], q[i]))
            i += threads
        wp.atomic_add(numbers, PQ, total)

    @kernel
    def advance(
        inverses: Blocks,
        p: Vectors,
        q: Vectors,
        x: Vectors,
        r: Vectors,
        z: Vectors,
        threads: int,
        numbers: Numbers,
    ):
        i = wp.tid()
        alpha = scalar(0.0)
        if numbers[PQ] > wp.float64(0.0):
            alpha = scalar(numbers[RZ] / numbers[PQ])
        total = wp.float64(0.0)
        while i < p.shape[0]:
            x[i] = x[i] + alpha * p[i]
            r[i] = r[i] - alpha * q[i]
            z[i] = inverses[i] * r[i]
            total += wp.float64(wp.dot(r[i], z[i]))
            i += threads
        wp.atomic_add(numbers, NEXT_RZ, total)

    @kernel
    def turn(z: Vectors, p: Vectors, numbers: Numbers):
        i = wp.tid()
        beta = scalar(0.0)
        if numbers[RZ] > wp.float64(0.0):
            beta = scalar(numbers[NEXT_RZ] / numbers[RZ])
        p[i] = z[i] + beta * p[i]

    @kernel
    def shift(numbers: Numbers):
        numbers[RZ] = numbers[NEXT_RZ]
        numbers[NEXT_RZ] = wp.float64(0.0)
        numbers[PQ] = wp.float64(0.0)

    return begin, multiply, advance, turn, shift
