"""The adjoint of a kick by forces that are functions of velocity (see `integrators.mid_velocity`)."""

import functools

import warp as wp

from ..basis import kernel
from ..integrators.composition import Composition, tools
from ..integrators.mid_velocity import inverse_of_kick, velocity_force
from .kick import AdjointData, kick_back


@functools.cache
def mid_velocity_adjoint(composition: Composition):
    """Compose the kernel, over particles, that corrects φ of `kick_adjoint`; None without such forces.

    v' = v + s F(x, u)/m with u = v + θ (v' − v) gives φ = s/m q with q = (1 − θ s/m ∂F/∂u)^−T ∂L/∂v'; F is
    differentiated at u, which is written as well.
    """
    if velocity_force(composition) is None:
        return None
    scalar, inverse = composition.scalar, inverse_of_kick(composition)
    V, SceneData, _, load, store, _ = tools(composition)
    Data, propagate = AdjointData(composition.dim, scalar), kick_back(composition.dim, scalar)

    @kernel
    def correct_kick(
        data: Data,
        scene: SceneData,
        stage: int,
        stride: int,  # particles from one world to the next
        kick: scalar,  # s [s]
        theta: scalar,
        # State:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),  # velocities before the kick; below, after it
        v_out: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # in and out, derivatives by the force
        # Out:
        u: wp.array(dtype=V),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        scene.stage = stage
        i = begin + wp.tid()
        while i < end:
            own = i % stride
            w = data.inverse_mass[i]
            change = load(v_out, i) - load(v, i)
            middle = load(v, i) + theta * change
            store(u, i, middle)
            scale = wp.length(middle) + wp.length(change)
            if own < scene.effect_mask.shape[0] and w * scale > scalar(0.0):
                solve = inverse(scene, load(x, i), middle, scale, theta * kick * w, own, scene.effect_mask[own])
                back = load(data.by_v, i)
                more = wp.transpose(solve) * back - back
                store(phi, i, load(phi, i) + propagate(data, i, kick, more, v, v_out))
            i += threads

    return correct_kick
