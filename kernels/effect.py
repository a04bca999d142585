"""The terms that effects add to the kernels of a scene; without an effect its term is not compiled."""

import functools
from typing import Any, NamedTuple

import warp as wp

from .basis import vector
from .compensation import position_of, state_types
from .records import records


class Driving(NamedTuple):
    """Functions of drives that methods call; None without drives. They return free particles unchanged."""

    holds: Any = None
    """wp.func (scene, i) -> whether particle i is driven."""
    acceleration: Any = None
    """wp.func (scene, force, i) -> acceleration of a driven particle at a frame's end [m/s²], 0 for a pinned one.

    Also adds the work of the force on a driven particle to its drive's total.
    """
    way: Any = None
    """wp.func (scene, i, begin, end) -> displacement of a driven particle between two stages of a frame [m]."""
    holds_out: Any = None
    """wp.func (scene, force, i, begin, end): sum a driven particle's work against a steady force between stages.

    Methods that know the force only after a solve call it instead of `acceleration`.
    """
    at_stage: Any = None
    """wp.func (scene, compensation, x, v, i) -> (x, v) for the next stage of a substep."""
    at_end: Any = None
    """wp.func (scene, compensation, x, v, i) -> (x, v) at a substep's end; also writes their compensation."""


class ForceTerm(NamedTuple):
    """The device side of an effect. It is hashable, so that scenes with equal effects share kernels.

    Its functions take the effect's own `data`; one is None if there is nothing to do.
    """

    field: str
    """The name of the effect's data in a scene's struct."""
    Data: Any
    """Struct type of the data."""
    begin: Any = None
    """wp.func (data, compensation, x, c): change spring c when a substep begins."""
    force: Any = None
    """wp.func (data, instant, i) -> force on particle i [N], in addition to its springs; see `instant`.

    Particles are in the system's order.
    """
    at_velocity: Any = None
    """wp.func (x, u, t, i) -> `force` if particle i were at x with velocity u at time t; only if u matters.

    Kicks of methods whose velocities lag take it at the velocity of the positions' time (`mid_velocity`).
    """
    before_forces: Any = None
    """(count, evaluate): wp.func (data) -> number of elements, and wp.func (data, compensation, x, v, c) for each.

    A single launch of many stages evaluates all elements before the forces of a stage. Other launches need a
    kernel for them, which the effect launches in its own `before_forces`.
    """
    drive: Any = None
    """Function from the type of a scene's struct to `Driving`: the functions that place driven particles."""
    selective: bool = False
    """Whether the force acts only on the particles that its effect names; each other particle costs a byte."""
    timed: bool = False
    """Whether the force depends on time, `instant.time`."""
    works: bool = False
    """Whether the work of the force is summed; requires `selective`."""


@functools.cache
def instant(dim: int, scalar: type, compensated: bool) -> Any:
    """Compose the struct of what a force may read beside its effect's data: the state for which it is asked."""
    _, Vectors, Compensation = state_types(dim, scalar, compensated)

    @wp.struct
    class Instant:
        # Of all particles; `position_of` and `records` read them:
        x: Vectors  # [m]
        v: Vectors  # the method's velocities [m/s], half a substep old in leapfrog
        compensation: Compensation
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], 0 where pinned
        # Of the stage, 0 if no force of the scene depends on time:
        stage: int  # of the frame
        time: scalar  # [s]
        # By stage of the frame, see `loads.work`; not set if no work is summed:
        weight: wp.array(dtype=wp.float64)  # [s]
        weight_of_last: wp.array(dtype=wp.float64)  # [s]

    return Instant


class ElementForce(NamedTuple):
    """The force of a kind of element, such as a triangle under wind, written once.

    An element is a few points, with a row each in `x`, `v` and the like. Scenes call `evaluate` for the force, and
    Warp differentiates it for gradients (`adjoint.elements`).
    """

    evaluate: Any = None
    """wp.func (data, e, time, stage, x, v, own) -> force on each point of element e [N]."""
    numbers: Any = None
    """wp.func (data, e, stage) -> `own`, the numbers by which there are derivatives, such as a pressure."""
    width: int = 0
    """How many numbers an element has."""
    points: int = 1
    """How many points an element has."""
    of_particles: bool = False
    """Whether elements are particles, and e their index; else e counts the elements."""
    shared: bool = False
    """Whether `evaluate` returns the force on the whole element instead, which its points share equally."""
    projected: Any = None
    """wp.func (data, e, time, stage, x, v, φ) -> φ·F of element e, if the forces on its points differ."""


@functools.cache
def on_particles(dim: int, scalar: type, compensated: bool, Data: Any, law: ElementForce) -> Any:
    """Compose `ForceTerm.force` of elements that are particles."""
    V, Rows, Instant = vector(dim, scalar), wp.types.matrix((1, dim), scalar), instant(dim, scalar, compensated)
    load, position = records(dim, scalar).load, position_of(dim, scalar, compensated)
    evaluate, numbers = law.evaluate, law.numbers

    @wp.func
    def force_on_particle(data: Data, now: Instant, i: int) -> V:
        x = Rows()
        v = Rows()
        x[0] = position(now.compensation, now.x, i)
        v[0] = load(now.v, i)
        return evaluate(data, i, now.time, now.stage, x, v, numbers(data, i, now.stage))

    return force_on_particle
