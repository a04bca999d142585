"""What the kernels of a scene are composed from, and what a stage of a method is."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..forces import Route, plastic_flow


class Composition(NamedTuple):
    """What a method's functions are composed from; hashable, so that equal scenes share kernels."""

    dim: int
    scalar: type
    route: Route
    """How a particle gets the force on it."""
    pinned: bool
    """Whether any particle is pinned."""
    Colliders: Any
    """Struct type of the colliders."""
    collide: Any
    """wp.func (colliders, x, v, x_old, v_old) -> (x, v) after contact; None where there are no colliders."""
    compensated: bool
    """Whether sums keep what rounding takes away."""
    moving: bool = False
    """Whether any collider moves."""
    yields: bool = False
    """Whether any connection gives way for good (see `plasticity`)."""

    @property
    def Lost(self) -> Any:
        """Struct type of what sums have lost by rounding."""
        return compensation(self.dim, self.scalar, self.compensated)[0]


class Stage(NamedTuple):
    """A method as seen from one particle."""

    Step: Any
    """Struct type of what a stage reads and writes. Forces are those at its `x`, `v` and `lost`."""
    advance: Any
    """wp.func (world, step, force, i): advance particle i, on which this force acts."""
    forced: bool = True
    """Whether it takes the force; else that is 0."""


@functools.cache
def world(motion: Composition):
    """Compose the struct of what acts on particles: the same in every stage of every method."""
    Forces, Colliders = motion.route.Forces, motion.Colliders
    if motion.yields:
        Flow, _ = plastic_flow(motion.dim, motion.scalar, motion.compensated)

        @wp.struct
        class YieldingWorld:
            forces: Forces
            inverse_mass: wp.array(dtype=motion.scalar)
            gravity: vector(motion.dim, motion.scalar)
            colliders: Colliders
            flow: Flow

        return YieldingWorld

    @wp.struct
    class World:
        forces: Forces
        inverse_mass: wp.array(dtype=motion.scalar)
        gravity: vector(motion.dim, motion.scalar)
        colliders: Colliders

    return World
