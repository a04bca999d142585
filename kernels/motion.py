"""The equation of motion of one particle, composed from a route to its force and the scene's effects."""

import functools
from typing import Any, NamedTuple

import warp as wp

from .basis import vector


class Motion(NamedTuple):
    """What an integrator kernel is composed from; hashable, so that equal scenes share kernels."""

    dim: int
    scalar: type
    Forces: Any
    """Struct type of what `acceleration` needs to know the forces."""
    acceleration: Any
    """wp.func (forces, inverse_mass, gravity, x, v, i) -> acceleration of particle i [m/s²]."""
    Colliders: Any
    """Struct type of the colliders."""
    collide: Any
    """wp.func (colliders, x, v, x_old, v_old) -> (x, v) after contact; None where there are no colliders."""
    Lost: Any
    """Struct type of what sums have lost by rounding."""
    add: Any
    """wp.func (total, change, lost, i) -> total + change."""
    compensated: bool
    """Whether `add` keeps what rounding takes away."""


@functools.cache
def particle_acceleration(dim: int, scalar: type, Forces: Any, force_at: Any, pinned: bool):
    """Compose a_i = f_i / m_i + g; a pinned particle (inverse mass 0) has none.

    A pinned particle stands still, so no collider ever finds it approaching: this is the only test for it,
    and it is compiled only where a particle is pinned.
    """
    V = vector(dim, scalar)

    @wp.func
    def acceleration(
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        i: int,
    ) -> V:
        force = force_at(forces, x, v, i)
        w = inverse_mass[i]
        if wp.static(pinned):
            if w == scalar(0.0):
                return V()
        return w * force + gravity

    return acceleration
