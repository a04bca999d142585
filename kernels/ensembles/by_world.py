"""What differs between the worlds of an ensemble, and how a thread finds that of its own."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from ..integrators import Composition, scene
from ..places import arrays_of, shifts

SHARED, UNIFORM, EACH = "shared", "uniform", "each"
"""How a constant of connections differs: not at all; a number for each world; or more numbers for each world."""


class Differences(NamedTuple):
    """What differs between worlds, which alone is compiled; hashable, so that equal ensembles share kernels."""

    gravity: bool = False
    mass: bool = False
    friction: bool = False
    """That of obstacles."""
    storage: str = ""
    """Where the algorithm has its constants: "one", "table", "own", "lattice" or "lattices"; see
    `place_constants`."""
    rest_length: str = SHARED
    stiffness: str = SHARED
    damping: str = SHARED

    @property
    def of_constants(self) -> tuple[str, str, str]:
        """How the constants of connections differ, in the order of CONSTANTS."""
        return self.rest_length, self.stiffness, self.damping


class Tools(NamedTuple):
    """How a thread comes to its own world."""

    ByWorld: Any
    """Struct type of what differs. Row w mod (number of rows) is that of world w, so that a row may serve many."""
    take: Any
    """wp.func (world, by, w) -> the same, as world w has it."""


@functools.cache
def by_world(composition: Composition, differs: Differences) -> Tools:
    """Compose what differs between worlds, and how a thread finds it."""
    SceneData, scalar = scene(composition), composition.scalar
    V, Three = vector(composition.dim, scalar), vector(3, scalar)
    numbers = {"stride": wp.int64, "frozen": wp.array(dtype=wp.int32)}
    if differs.gravity:
        numbers["gravity"] = wp.array(dtype=V)  # [m/s²]
    if differs.mass:
        numbers["inverse_mass"] = wp.array2d(dtype=scalar)  # [1/kg], shape [rows, particle_count]
    if differs.friction:
        numbers["friction"] = wp.array2d(dtype=scalar)  # shape [rows, obstacle_count]
    if differs.storage == "one":
        numbers["constants"] = wp.array(dtype=Three)  # in the order of CONSTANTS
    elif differs.storage == "table":
        numbers["constants"] = wp.array2d(dtype=Three)  # shape [rows, kind_count]
    elif differs.storage:
        for name in ("rest_length", "stiffness", "damping"):
            numbers |= _fields_of(composition, differs, name)
    body_contact = "body_contact" in SceneData.vars
    if body_contact:
        numbers["unit"] = wp.array(dtype=wp.float64)  # of the forces of contacts [N], shape [world_count]
        numbers["body_contact"] = wp.int64  # bytes from one world's forces on vertices to the next one's
    names = {"__module__": __name__, "__qualname__": "by_world.<locals>.ByWorld"}
    ByWorld = wp.struct(type("ByWorld", (), {"__annotations__": numbers} | names))

    place_constants = _constants(composition, differs, SceneData, ByWorld) if differs.storage else None
    scattered = "f" in composition.force_algorithm.Forces.vars
    gravity, mass, friction = differs.gravity, differs.mass, differs.friction
    sums = shifts(SceneData, ("forces.f",)) if scattered else None
    contacts = shifts(SceneData, ("body_contact.force",)) if body_contact else None

    @wp.func
    def take(surroundings: SceneData, by: ByWorld, w: int) -> SceneData:
        own = surroundings
        if wp.static(scattered):
            sums(own, wp.int64(w) * by.stride)
        if wp.static(body_contact):
            contacts(own, wp.int64(w) * by.body_contact)
            own.body_contact.unit = by.unit[w]
        if wp.static(gravity):
            own.gravity = by.gravity[w % by.gravity.shape[0]]
        if wp.static(mass):
            own.inverse_mass = by.inverse_mass[w % by.inverse_mass.shape[0]]
        if wp.static(friction):
            own.colliders.surface.friction = by.friction[w % by.friction.shape[0]]
        if wp.static(place_constants is not None):
            own = place_constants(own, by, w)
        return own

    return Tools(ByWorld, take)


def _fields_of(composition: Composition, differs: Differences, name: str) -> dict[str, Any]:
    """Return the field that holds a constant of connections, where it differs."""
    scalar, how = composition.scalar, getattr(differs, name)
    if how == SHARED:
        return {}
    if how == UNIFORM:
        return {name: wp.array(dtype=scalar)}  # shape [rows]
    if differs.storage == "own":
        return {name: wp.array2d(dtype=scalar)}  # shape [rows, connection_count or slot_count]
    if differs.storage == "lattice":
        return {
            name: wp.array(dtype=composition.force_algorithm.Forces.vars[name].type)
        }  # by direction, shape [rows]
    return {name: wp.array3d(dtype=scalar)}  # shape [rows, kind_count, direction_count]


def _constants(composition: Composition, differs: Differences, SceneData: Any, ByWorld: Any) -> Any:
    """Compose how the constants of connections of world w come to where the algorithm looks for them.

    Storage "one" and "table" are those of `forces.constants`, a table for each world; "own" has arrays for each
    world. In a "lattice" the constants by direction are in the struct of the algorithm itself; what is the same in
    all directions of a world is one number, which stays in a register. "lattices" have a table by kind and
    direction.
    """
    storage, (lengths, stiffnesses, dampings) = differs.storage, differs.of_constants
    if storage == "one":

        @wp.func
        def place_one(own: SceneData, by: ByWorld, w: int) -> SceneData:
            own.forces.constants.all = by.constants[w % by.constants.shape[0]]
            return own

        return place_one
    if storage == "table":

        @wp.func
        def place_table(own: SceneData, by: ByWorld, w: int) -> SceneData:
            own.forces.constants.table = by.constants[w % by.constants.shape[0]]
            return own

        return place_table
    if storage == "own":

        @wp.func
        def place_own(own: SceneData, by: ByWorld, w: int) -> SceneData:
            if wp.static(lengths != SHARED):
                own.forces.constants.rest_length = by.rest_length[w % by.rest_length.shape[0]]
            if wp.static(stiffnesses != SHARED):
                own.forces.constants.stiffness = by.stiffness[w % by.stiffness.shape[0]]
            if wp.static(dampings != SHARED):
                own.forces.constants.damping = by.damping[w % by.damping.shape[0]]
            return own

        return place_own
    Each = composition.force_algorithm.Forces.vars["stiffness"].type if storage == "lattice" else None

    @wp.func
    def place_by_direction(own: SceneData, by: ByWorld, w: int) -> SceneData:
        if wp.static(lengths == UNIFORM):
            own.forces.rest_length = Each(by.rest_length[w % by.rest_length.shape[0]])
        elif wp.static(lengths == EACH):
            own.forces.rest_length = by.rest_length[w % by.rest_length.shape[0]]
        if wp.static(stiffnesses == UNIFORM):
            own.forces.stiffness = Each(by.stiffness[w % by.stiffness.shape[0]])
        elif wp.static(stiffnesses == EACH):
            own.forces.stiffness = by.stiffness[w % by.stiffness.shape[0]]
        if wp.static(dampings == UNIFORM):
            own.forces.damping = Each(by.damping[w % by.damping.shape[0]])
        elif wp.static(dampings == EACH):
            own.forces.damping = by.damping[w % by.damping.shape[0]]
        return own

    return place_by_direction


@functools.cache
def to_world(Step: Any, compensated: bool) -> Any:
    """Compose wp.func (step, bytes) that shifts all arrays of a method's step to a world."""
    return shifts(Step, arrays_of(Step, compensated))
