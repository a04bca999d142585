"""What the kernels of a scene are composed from, and what a stage of a method is."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..contact import NO_CONTACT, Contact
from ..effect import Driving, Piece
from ..forces import Route, lane_of
from ..loads import measured
from ..records import records


class Composition(NamedTuple):
    """What a method's functions are composed from; hashable, so that equal scenes share kernels."""

    dim: int
    """Number of coordinates."""
    scalar: type
    """Warp's type of numbers."""
    route: Route
    """How a particle gets the force of its connections."""
    compensated: bool = False
    """Whether sums keep what rounding takes away."""
    pinned: bool = False
    """Whether any particle is pinned."""
    contact: Contact = NO_CONTACT
    """What keeps particles out of obstacles."""
    pieces: tuple[Piece, ...] = ()
    """The other effects that the scene has."""
    apart: bool = False
    """Whether particles that have marks are advanced in a launch of their own: where columns are, and few have."""

    @property
    def Lost(self) -> Any:
        """Struct type of what sums have lost by rounding."""
        return compensation(self.dim, self.scalar, self.compensated)[0]

    @property
    def selective(self) -> list[Piece]:
        """The effects whose forces act on some particles only; the k-th has bit k of a particle's marks."""
        return [piece for piece in self.pieces if piece.selective]

    @property
    def timed(self) -> bool:
        """Whether anything depends on time."""
        return any(piece.timed for piece in self.pieces)


class Stage(NamedTuple):
    """A method as seen from one particle."""

    Step: Any
    """Struct type of what a stage reads and writes. Forces are those at its `x`, `v` and `lost`."""
    advance: Any
    """wp.func (world, step, force, i): advance particle i, on which this force acts."""
    forced: bool = True
    """Whether it takes the force; else that is 0."""


@functools.cache
def world(composition: Composition):
    """Compose the struct of what acts on particles: the same in every stage of every method.

    forces: what the route reads. inverse_mass [1/kg], shape [particle_count], 0 where pinned. gravity [m/s²].
    colliders: the obstacles. Behind them the data of each other effect, by the name that its piece gives; then,
    where they are needed, marks: the selective effects that act on each particle, as bits, shape [particle_count];
    marked: the numbers of those that have any; handed: the forces of connections on these [N], as `Model.vectors`
    makes arrays; stage: which stage of a frame this is, counted from 0; time: that of each, and of the frame's
    end [s].
    """
    fields = {
        "forces": composition.route.Forces,
        "inverse_mass": wp.array(dtype=composition.scalar),
        "gravity": vector(composition.dim, composition.scalar),
        "colliders": composition.contact.Colliders,
    }
    fields |= {piece.field: piece.Data for piece in composition.pieces}
    if composition.selective:
        fields["marks"] = wp.array(dtype=wp.uint8)
    if composition.apart:
        fields["marked"] = wp.array(dtype=int)
        fields["handed"] = wp.array(dtype=vector(composition.dim, composition.scalar))
    if composition.timed:
        fields["stage"] = int
        fields["time"] = wp.array(dtype=composition.scalar)
    names = {"__module__": __name__, "__qualname__": "world.<locals>.World"}
    return wp.struct(type("World", (), {"__annotations__": fields} | names))


class Tools(NamedTuple):
    """The types and functions that every method is written with."""

    V: Any
    """Vector of the scene's coordinates."""
    World: Any
    """Struct type of what acts on particles."""
    Lost: Any
    """Struct type of what sums have lost by rounding."""
    load: Any
    """wp.func (x, i) -> x[i]."""
    store: Any
    """wp.func (x, i, value): x[i] = value."""
    add: Any
    """wp.func (total, change, lost, lost_out, i) -> the next sum (see `compensation`)."""


@functools.cache
def tools(composition: Composition) -> Tools:
    """Return the types and functions that the methods of a scene are written with."""
    dim, scalar = composition.dim, composition.scalar
    load, store, _ = records(dim, scalar)
    Lost, add = compensation(dim, scalar, composition.compensated)
    return Tools(vector(dim, scalar), world(composition), Lost, load, store, add)


@functools.cache
def beginning(composition: Composition) -> Any:
    """Compose what effects do to connection c when a substep begins, (world, lost, x, c); None if nothing."""
    World, Lost, V = world(composition), composition.Lost, vector(composition.dim, composition.scalar)

    def both(first: Any, second: Any) -> Any:
        @wp.func
        def begin(world: World, lost: Lost, x: wp.array(dtype=V), c: int):
            first(world, lost, x, c)
            second(world, lost, x, c)

        return begin

    return _joined(both, [piece.begin(World) for piece in composition.pieces if piece.begin is not None])


@functools.cache
def loads(composition: Composition) -> Any:
    """Compose the sum of effects' forces on a particle [N], (world, lost, x, v, i, mark); None if there are none.

    `mark` says which selective effects act on the particle, as `world.marks` does.
    """
    V, World, Lost, *_ = tools(composition)
    selective = composition.selective

    def both(first: Any, second: Any) -> Any:
        @wp.func
        def load(
            world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int, mark: wp.uint8
        ) -> V:
            return first(world, lost, x, v, i, mark) + second(world, lost, x, v, i, mark)

        return load

    def guarded(force: Any, bits: int) -> Any:
        @wp.func
        def load_where_marked(
            world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int, mark: wp.uint8
        ) -> V:
            total = V()
            if (mark & wp.uint8(wp.static(bits))) != wp.uint8(0):
                total = force(world, lost, x, v, i)
            return total

        return load_where_marked

    def unguarded(force: Any) -> Any:
        @wp.func
        def load_on_all(
            world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int, mark: wp.uint8
        ) -> V:
            return force(world, lost, x, v, i)

        return load_on_all

    silent, working, marks = [], [], 0
    for piece in composition.pieces:
        if piece.force is None:
            continue
        bits = 1 << selective.index(piece) if piece.selective else 0
        force = guarded(piece.force(World), bits) if bits else unguarded(piece.force(World))
        (working if piece.works else silent).append(force)
        marks |= bits if piece.works else 0
    if working:
        silent.append(measured(composition.dim, composition.scalar, World, _joined(both, working), Lost, marks))
    return _joined(both, silent)


@functools.cache
def by_first_lane(composition: Composition, method: Any) -> tuple[Any, Any]:
    """Return `advance` of a method, and `loads`, for kernels in which all lanes of a particle call them.

    Only the first of them does what they do. Where a particle has one thread they are the functions themselves.
    """
    V, World, Lost, *_ = tools(composition)
    (Step, advance, _), load = method(composition), loads(composition)
    if composition.route.lanes == 1:
        return advance, load
    lane = lane_of(composition.route.lanes)

    @wp.func
    def advance_once(world: World, step: Step, force: V, i: int):
        if lane() == 0:
            advance(world, step, force, i)

    @wp.func
    def load_once(
        world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int, mark: wp.uint8
    ) -> V:
        total = V()
        if lane() == 0:
            total = load(world, lost, x, v, i, mark)
        return total

    return advance_once, None if load is None else load_once


@functools.cache
def driving(composition: Composition) -> Driving:
    """Compose what moves driven particles."""
    World = world(composition)
    return next((piece.drive(World) for piece in composition.pieces if piece.drive is not None), Driving())


def _joined(both: Callable[[Any, Any], Any], functions: list[Any]) -> Any:
    """Return one function that does what several do, one after the other; None if there are none."""
    return functools.reduce(both, functions) if functions else None
