"""Forces on particles: constant, tabulated by stages of a frame, or functions of position and time."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records
from .work import Nothing


@functools.cache
def steady_force(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of constant forces.

    Particles with equal combinations of forces read the same precomputed sum: the few sums fit into caches.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)

    @wp.struct
    class Steady:
        value: wp.array(dtype=V)  # sums of combined forces [N], the first one 0; shape [combination_count]
        combination: wp.array(dtype=int)  # index of the sum for each particle, shape [particle_count]

    def force(SceneData: Any):
        @wp.func
        def hold(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            return scene.steady.value[scene.steady.combination[i]]

        return hold

    return ForceTerm("steady", Steady, force=force, selective=True)


@functools.cache
def varying_force(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of forces that are functions of time."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)

    @wp.struct
    class Varying:
        value: wp.array2d(dtype=V)  # for each stage of a frame and its end [N], shape [any, combination_count]
        combination: wp.array(dtype=int)  # index of the sum for each particle, shape [particle_count]

    def force(SceneData: Any):
        @wp.func
        def vary(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            return scene.varying.value[scene.stage, scene.varying.combination[i]]

        return vary

    return ForceTerm("varying", Varying, force=force, selective=True, timed=True, works=True)


@functools.cache
def given_force_projection(dim: int, scalar: type, Data: Any, varies: bool):
    """Compose (projected, numbers): φ·F of a particle under the force F, and F, for `adjoint.elements`."""
    Rows: Any = wp.types.matrix((1, dim), scalar)
    V = vector(dim, scalar)

    @wp.func
    def numbers(data: Data, e: int, i: int, stage: int) -> V:
        if wp.static(varies):
            return data.value[stage, data.combination[i]]
        else:
            return data.value[data.combination[i]]

    @wp.func
    def projected(
        data: Data, e: int, i: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows, own: V
    ) -> scalar:
        return wp.dot(own, phi[0])

    return projected, numbers


@functools.cache
def weight_force(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the force term of time-dependent gravity: m g(t)."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)

    @wp.struct
    class Falling:
        gravity: wp.array2d(dtype=V)  # for each stage of a frame and its end [m/s²], shape [any, 1]

    def force(SceneData: Any):
        @wp.func
        def fall(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            return scene.falling.gravity[scene.stage, 0] / scene.inverse_mass[i]

        return fall

    return ForceTerm("falling", Falling, force=force, selective=True, timed=True, works=True)


@functools.cache
def function_force(dim: int, scalar: type, compensated: bool, function: Any, number: int) -> ForceTerm:
    """Return the term of a force that is a function of position, velocity and time.

    `function` is a wp.func (x, v, t, i) -> force [N] on particle i at position x with velocity v at time t.
    `number` distinguishes the functions of a scene.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load

    def force(SceneData: Any):
        @wp.func
        def function_of_place(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            x_i = load(x, i)
            if wp.static(compensated):
                x_i = x_i - load(compensation.x, i)
            return function(x_i, load(v, i), scene.time[scene.stage], i)

        return function_of_place

    return ForceTerm(f"function_force_{number}", Nothing, force=force, selective=True, timed=True, works=True)


@functools.cache
def function_projection(dim: int, scalar: type, function: Any):
    """Compose φ·F of a particle under a force F given by a function, for `adjoint.elements`."""
    Rows: Any = wp.types.matrix((1, dim), scalar)

    @wp.func
    def projected(data: Nothing, e: int, i: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows) -> scalar:
        return wp.dot(function(x[0], v[0], time, i), phi[0])

    return projected
