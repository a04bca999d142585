"""What a linearly implicit method needs beside forces: products with the linearised system."""

import functools

import warp as wp

from .basis import kernel, vector
from .compensation import compensation
from .integrate import finish, particle_acceleration
from .motion import Motion, Stage, world
from .records import records


@functools.cache
def add_linearised(dim: int, scalar: type):
    """Compose z += scale (spring·K + damper·B) p, over connections, K and B linearised at x; pinned rows stay 0.

    A connection's part of K is k (d dᵀ + max(0, 1 − l0/l)(1 − d dᵀ)), of B b d dᵀ, for its axis d: a compressed
    spring's push across its axis is left out, so that K is never indefinite.
    """
    V = vector(dim, scalar)

    @kernel
    def add_linearised_product(
        # Model:
        connections: wp.array(dtype=wp.vec2i),
        rest_length: wp.array(dtype=scalar),
        stiffness: wp.array(dtype=scalar),
        damping: wp.array(dtype=scalar),
        inverse_mass: wp.array(dtype=scalar),
        # State in:
        x: wp.array(dtype=V),
        p: wp.array(dtype=V),
        spring: scalar,
        damper: scalar,
        scale: scalar,
        # State out:
        z: wp.array(dtype=V),
    ):
        c = wp.tid()
        i = connections[c][0]
        j = connections[c][1]
        dx = x[i] - x[j]
        length = wp.length(dx)
        if length == scalar(0.0):
            return
        axis = dx / length
        dp = V()
        if inverse_mass[i] > scalar(0.0):
            dp += p[i]
        if inverse_mass[j] > scalar(0.0):
            dp -= p[j]
        across = wp.max(scalar(0.0), scalar(1.0) - rest_length[c] / length)
        k = scale * spring * stiffness[c]
        b = scale * damper * damping[c]
        part = (k * (scalar(1.0) - across) + b) * wp.dot(axis, dp) * axis + k * across * dp
        if inverse_mass[i] > scalar(0.0):
            wp.atomic_add(z, i, part)
        if inverse_mass[j] > scalar(0.0):
            wp.atomic_sub(z, j, part)

    return add_linearised_product


@functools.cache
def mass_product(dim: int, scalar: type):
    """Compose z = M p; a pinned particle counts as one of 1 kg."""
    V = vector(dim, scalar)

    @kernel
    def multiply_by_mass(inverse_mass: wp.array(dtype=scalar), p: wp.array(dtype=V), z: wp.array(dtype=V)):
        i = wp.tid()
        mass = scalar(1.0)
        if inverse_mass[i] > scalar(0.0):
            mass = scalar(1.0) / inverse_mass[i]
        z[i] = mass * p[i]

    return multiply_by_mass


@functools.cache
def block_inverses(dim: int, scalar: type):
    """Compose the inverses of the diagonal blocks m + h² A_i + h B_i: the preconditioner."""
    Block, Wide = wp.types.matrix((dim, dim), scalar), wp.types.matrix((dim, dim), wp.float64)

    @kernel
    def invert_blocks(
        inverse_mass: wp.array(dtype=scalar),
        stiffness_block: wp.array(dtype=Wide),
        damping_block: wp.array(dtype=Wide),
        h: wp.float64,
        inverses: wp.array(dtype=Block),
    ):
        i = wp.tid()
        w = wp.float64(inverse_mass[i])
        block = Wide()
        if w > wp.float64(0.0):
            block = h * h * stiffness_block[i] + h * damping_block[i]
            for k in range(wp.static(dim)):
                block[k, k] += wp.float64(1.0) / w
        else:
            for k in range(wp.static(dim)):
                block[k, k] = wp.float64(1.0)
        if wp.static(dim == 1):
            block[0, 0] = wp.float64(1.0) / block[0, 0]
        else:
            block = wp.inverse(block)
        inverses[i] = Block(block)

    return invert_blocks


RZ, NEXT_RZ, PQ = 0, 1, 2
"""The numbers of conjugate gradients: r·z of this iteration and of the next, and p·q with q = A p."""


@functools.cache
def conjugate_gradients(dim: int, scalar: type):
    """Compose the kernels of preconditioned conjugate gradients for A x = b with x = 0, r = b at the start.

    Each thread takes its share of the particles, strided, so that few atomics meet at one number. The numbers
    stay on the device, so that a graph can hold any number of iterations.
    Reference: Golub & Van Loan, Matrix Computations, 4th ed. (2013), 11.5.
    """
    V, Block = vector(dim, scalar), wp.types.matrix((dim, dim), scalar)

    @kernel
    def begin(
        inverses: wp.array(dtype=Block),
        r: wp.array(dtype=V),
        x: wp.array(dtype=V),
        p: wp.array(dtype=V),
        threads: int,
        numbers: wp.array(dtype=wp.float64),
    ):
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
    def multiply(p: wp.array(dtype=V), q: wp.array(dtype=V), threads: int, numbers: wp.array(dtype=wp.float64)):
        i = wp.tid()
        total = wp.float64(0.0)
        while i < p.shape[0]:
            total += wp.float64(wp.dot(p[i], q[i]))
            i += threads
        wp.atomic_add(numbers, PQ, total)

    @kernel
    def advance(
        inverses: wp.array(dtype=Block),
        p: wp.array(dtype=V),
        q: wp.array(dtype=V),
        x: wp.array(dtype=V),
        r: wp.array(dtype=V),
        z: wp.array(dtype=V),
        threads: int,
        numbers: wp.array(dtype=wp.float64),
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
    def turn(z: wp.array(dtype=V), p: wp.array(dtype=V), numbers: wp.array(dtype=wp.float64)):
        i = wp.tid()
        beta = scalar(0.0)
        if numbers[RZ] > wp.float64(0.0):
            beta = scalar(numbers[NEXT_RZ] / numbers[RZ])
        p[i] = z[i] + beta * p[i]

    @kernel
    def shift(numbers: wp.array(dtype=wp.float64)):
        numbers[RZ] = numbers[NEXT_RZ]
        numbers[NEXT_RZ] = wp.float64(0.0)
        numbers[PQ] = wp.float64(0.0)

    return begin, multiply, advance, turn, shift


@functools.cache
def impulse(motion: Motion) -> Stage:
    """Compose out = h (f + m g), the impulse of the present forces; nothing for a pinned particle."""
    scalar, World, Lost = motion.scalar, world(motion), motion.Lost
    acceleration = particle_acceleration(motion)
    V = vector(motion.dim, scalar)
    _, store, _ = records(motion.dim, scalar)

    @wp.struct
    class Impulse:
        h: scalar
        lost: Lost
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        out: wp.array(dtype=V)

    @wp.func
    def advance(world: World, step: Impulse, force: V, i: int):
        a = acceleration(world, force, i)
        p = V()
        if world.inverse_mass[i] > scalar(0.0):
            p = step.h * a / world.inverse_mass[i]
        store(step.out, i, p)

    return Stage(Impulse, advance)


@functools.cache
def implicit_finish(motion: Motion) -> Stage:
    """Compose v += dv (0 for a pinned particle), then x += h v, then contact."""
    scalar, World, Lost = motion.scalar, world(motion), motion.Lost
    _, add = compensation(motion.dim, scalar, motion.compensated)
    finish_substep = finish(motion)
    V = vector(motion.dim, scalar)
    load, store, _ = records(motion.dim, scalar)

    @wp.struct
    class ImplicitFinish:
        h: scalar
        lost: Lost
        dv: wp.array(dtype=V)
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(world: World, step: ImplicitFinish, force: V, i: int):
        v_old = load(step.v, i)
        v_new = add(v_old, load(step.dv, i), step.lost.v, step.lost.v, i)
        x_old = load(step.x, i)
        x_new, v_end = finish_substep(world.colliders, step.lost, x_old, v_old, step.h * v_new, v_new, i)
        store(step.x_out, i, x_new)
        store(step.v_out, i, v_end)

    return Stage(ImplicitFinish, advance, forced=False)
