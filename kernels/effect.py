"""The terms that effects add to the kernels of a scene; without an effect its term is not compiled."""

from collections.abc import Callable
from typing import Any, NamedTuple


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

    Its functions are composed for the struct `SceneData`, which holds the effect's data: each callable below takes
    the type `SceneData` and returns the `wp.func`; it is None if there is nothing to do.
    """

    field: str
    """The name of the effect's data in `SceneData`."""
    Data: Any
    """Struct type of the data."""
    begin: Callable[[Any], Any] | None = None
    """wp.func (scene, compensation, x, c): change spring c when a substep begins."""
    force: Callable[[Any], Any] | None = None
    """wp.func (scene, compensation, x, v, i) -> force on particle i [N], in addition to its springs.

    v is the method's velocity, half a substep old in leapfrog. Read x and v with `records(dim, scalar).load`; in
    compensated precision a position is x − compensation.x. Particles are in the system's order.
    """
    at_velocity: Callable[[Any], Any] | None = None
    """wp.func (scene, x, u, i) -> `force` if particle i were at x with velocity u; only if u matters.

    Kicks of methods whose velocities lag take it at the velocity of the positions' time (`mid_velocity`).
    """
    parts: Callable[[Any], Any] | None = None
    """(count, evaluate): wp.func (scene) -> number of parts, and wp.func (scene, compensation, x, v, c).

    A single launch of many stages evaluates all parts before the forces of a stage. Other launches need a kernel
    for the parts, which the effect launches in `before_forces`.
    """
    drive: Callable[[Any], Any] | None = None
    """`Driving`: the functions that place driven particles."""
    selective: bool = False
    """Whether the force acts only on the particles that its effect names; each other particle costs a byte."""
    timed: bool = False
    """Whether the force depends on time; the stage's time is `scene.time[scene.stage]`."""
    works: bool = False
    """Whether the work of the force is summed; requires `selective`."""
