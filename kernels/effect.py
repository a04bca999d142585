"""The terms that effects add to the kernels of a scene; a scene without one compiles none of it."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Driving(NamedTuple):
    """Functions of drives that methods call, each None where nothing is driven. Free particles are unchanged."""

    holds: Any = None
    """wp.func (scene, i) -> whether particle i is driven."""
    acceleration: Any = None
    """wp.func (scene, force, i) -> that of a driven particle where a frame ends [m/s²], 0 of one that is pinned.

    The work of the force on a driven particle is added to that of its drive.
    """
    way: Any = None
    """wp.func (scene, i, begin, end) -> how far a driven particle goes between two stages of a frame [m]."""
    holds_out: Any = None
    """wp.func (scene, force, i, begin, end): sum the work done against a steady force on a driven one on that way.

    It is for methods that know the force only when their equations are solved, in place of `acceleration`.
    """
    at_stage: Any = None
    """wp.func (scene, compensation, x, v, i) -> (x, v) as the next stage of a substep takes them."""
    at_end: Any = None
    """wp.func (scene, compensation, x, v, i) -> (x, v) where a substep ends; it writes their compensation."""


class ForceTerm(NamedTuple):
    """The device side of an effect. It is hashable, so that scenes with equal effects share kernels.

    Its functions are composed for the struct `SceneData`, in which the effect's data
    lie: each entry below is a function of that type which returns the `wp.func`, or None where there is nothing to
    do.
    """

    field: str
    """The name of the effect's data in `SceneData`."""
    Data: Any
    """Struct type of the data."""
    begin: Callable[[Any], Any] | None = None
    """wp.func (scene, compensation, x, c): change spring c when a substep begins."""
    force: Callable[[Any], Any] | None = None
    """wp.func (scene, compensation, x, v, i) -> force on particle i [N], beside those of its springs.

    v is as the method has it, in leapfrog half a substep ago. x and v are read by `records(dim, scalar).load`; in
    compensated precision a position is x − compensation.x. Particles are in the system's order.
    """
    drive: Callable[[Any], Any] | None = None
    """`Driving`: where driven particles are; it returns several functions."""
    selective: bool = False
    """Whether the force acts on some particles only, those that its effect names: on others it costs a byte."""
    timed: bool = False
    """Whether it depends on time: that of the stage is `scene.time[scene.stage]`."""
    works: bool = False
    """Whether the work of its force is summed; it is selective then."""
