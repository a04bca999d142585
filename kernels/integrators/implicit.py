"""Stages and matrix products of the linearly implicit method."""

import functools

import warp as wp

from ..basis import kernel, vector
from .composition import Composition, Stage, driving, tools
from .mid_velocity import mid_velocity
from .stages import finish, particle_acceleration

LAUNCHES = 2
"""Number of stages of a substep: `impulse` and `implicit_finish`."""


@functools.cache
def mass_product(dim: int, scalar: type):
    """Compose z = M p, with mass 1 kg for a pinned particle."""
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
    """Compose the kernel that inverts the diagonal blocks m + h² A_i + h B_i as the preconditioner.

    For a pinned or driven particle the inverse is set to 0: conjugate gradients then leave its residual unchanged.
    """
    Block, Wide = wp.types.matrix((dim, dim), scalar), wp.types.matrix((dim, dim), wp.float64)
    Masses, Blocks, Inverses = wp.array(dtype=scalar), wp.array(dtype=Wide), wp.array(dtype=Block)

    @kernel
    def invert_blocks(
        inverse_mass: Masses, stiffness_block: Blocks, damping_block: Blocks, h: wp.float64, inverses: Inverses
    ):
        i = wp.tid()
        w = wp.float64(inverse_mass[i])
        block = Wide()
        if w > wp.float64(0.0):
            block = h * h * stiffness_block[i] + h * damping_block[i]
            for k in range(wp.static(dim)):
                block[k, k] += wp.float64(1.0) / w
            if wp.static(dim == 1):
                block[0, 0] = wp.float64(1.0) / block[0, 0]
            else:
                block = wp.inverse(block)
        inverses[i] = Block(block)

    return invert_blocks


@functools.cache
def impulse(composition: Composition) -> Stage:
    """Compose out = h (f + m g), the impulse of the current forces; 0 for a pinned particle.

    For a driven particle it is h f, and `given` is Δx / h minus its velocity; otherwise `given` is 0.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, _ = tools(composition)
    acceleration, (holds, _, way, *_) = particle_acceleration(composition), driving(composition)
    correction = mid_velocity(composition, alone=True)

    @wp.struct
    class Impulse:
        h: scalar
        compensation: Compensation
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        out: wp.array(dtype=V)
        given: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: Impulse, force: V, i: int):
        p = V()
        if wp.static(correction is not None):
            v = load(step.v, i)
            force += correction(scene, step.compensation, step.x, v, v, force, step.h, scalar(0.5), i)
        if scene.inverse_mass[i] > scalar(0.0):
            a = acceleration(scene, force, i)
            p = step.h * a / scene.inverse_mass[i]
        if wp.static(holds is not None):
            change = V()
            if holds(scene, i):
                p = step.h * force
                change = way(scene, i, scene.stage, scene.stage + LAUNCHES) / step.h - load(step.v, i)
            store(step.given, i, change)
        store(step.out, i, p)

    return Stage(Impulse, advance)


@functools.cache
def implicit_finish(composition: Composition) -> Stage:
    """Compose v += dv (0 for a pinned particle), x += h v, and contact.

    For a driven particle, `impulse` is that of all forces in the substep; its drive exerts the opposite impulse.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, add = tools(composition)
    finish_substep, (holds, _, _, holds_out, _, at_end) = finish(composition), driving(composition)

    @wp.struct
    class ImplicitFinish:
        h: scalar
        compensation: Compensation
        dv: wp.array(dtype=V)
        impulse: wp.array(dtype=V)
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: ImplicitFinish, force: V, i: int):
        v_old = load(step.v, i)
        v_new = add(v_old, load(step.dv, i), step.compensation.v, step.compensation.v, i)
        x_old = load(step.x, i)
        x_new, v_end = finish_substep(scene.colliders, step.compensation, x_old, v_old, step.h * v_new, v_new, i)
        if wp.static(at_end is not None):
            if holds(scene, i):
                pull = load(step.impulse, i) / step.h
                holds_out(scene, pull, i, scene.stage + 1 - LAUNCHES, scene.stage + 1)
            x_new, v_end = at_end(scene, step.compensation, x_new, v_end, i)
        store(step.x_out, i, x_new)
        store(step.v_out, i, v_end)

    return Stage(ImplicitFinish, advance, forced=False)
