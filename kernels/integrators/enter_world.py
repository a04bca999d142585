"""Give each thread the data of its world of an ensemble.

Arrays concatenate the particles of all worlds. A thread shifts the arrays of its stage to its world, and replaces
the scene's parameters by the world's parameters. Then it calls functions of a single scene. So each world moves
as in a single run, to the last bit.
"""

import functools
from typing import Any

import warp as wp

from ..places import Place, arrays_of, shifts
from .composition import Composition, scene
from .differences import EACH, SHARED, UNIFORM

PART = """
    const int {1}_count = s.{0}.shape[0] / count;
    s.{0}.data = reinterpret_cast<decltype(s.{0}.data)>(
        reinterpret_cast<char*>(s.{0}.data) + static_cast<wp::int64>(w) * {1}_count * s.{0}.strides[0]);
    s.{0}.shape.dims[0] = {1}_count;
#if defined(__CUDA_ARCH__)
    __builtin_assume({2}(s.{0}.data));
#endif
"""


@functools.cache
def parts(Struct: Any, fields: tuple[str, ...]) -> Any:
    """Compose wp.func (s, w, count) that reduces arrays of a struct to part w of `count` equal parts."""
    code = "".join(PART.format(one, one.replace(".", "_"), Place.DEVICE.value) for one in fields)

    @wp.func_native(code)
    def take_part(s: wp.ref[Struct], w: int, count: int): ...

    return take_part


@functools.cache
def enter_world(composition: Composition) -> Any:
    """Compose wp.func (scene, w) that returns the scene with the data of world w."""
    SceneData, differs = scene(composition), composition.differs
    place_constants = _constants(composition, SceneData) if differs.storage else None
    scattered = "f" in composition.force_algorithm.Forces.vars
    gravity, mass, friction = differs.gravity, differs.mass, differs.friction
    colliders_know_mass = mass and composition.collider_term.collide is not None
    body_contact = "body_contact" in SceneData.vars
    sums = shifts(SceneData, ("forces.f",)) if scattered else None
    take_part = parts(SceneData, differs.arrays) if differs.arrays else None

    @wp.func
    def take(surroundings: SceneData, w: int) -> SceneData:
        own = surroundings
        if wp.static(scattered):
            sums(own, wp.int64(w) * own.worlds.stride)
        if wp.static(take_part is not None):
            take_part(own, w, own.worlds.frozen.shape[0])
        if wp.static(body_contact):
            own.body_contact.unit = own.worlds.unit[w]
        if wp.static(gravity):
            own.gravity = own.worlds.gravity[w % own.worlds.gravity.shape[0]]
        if wp.static(mass):
            own.inverse_mass = own.worlds.inverse_mass[w % own.worlds.inverse_mass.shape[0]]
        if wp.static(colliders_know_mass):
            own.colliders.inverse_mass = own.worlds.inverse_mass[w % own.worlds.inverse_mass.shape[0]]
        if wp.static(friction):
            own.colliders.surface.friction = own.worlds.friction[w % own.worlds.friction.shape[0]]
        if wp.static(place_constants is not None):
            own = place_constants(own, w)
        return own

    return take


def _constants(composition: Composition, SceneData: Any) -> Any:
    """Compose wp.func (scene, w) that writes the connection constants of world w where the algorithm reads them.

    Storage "one" and "table" are as in `springs.constants`, with one table per world; "own" has an array of each
    constant per world. With "lattice" constants by direction are in the algorithm's struct; if a constant is equal
    in all directions, it is one number in a register. With "lattices" there is a table by kind and direction.
    """
    *_, storage, lengths, stiffnesses, dampings, _ = composition.differs
    if storage == "own":

        @wp.func
        def place_own(own: SceneData, w: int) -> SceneData:
            if wp.static(lengths != SHARED):
                own.forces.constants.rest_length = own.worlds.rest_length[w % own.worlds.rest_length.shape[0]]
            if wp.static(stiffnesses != SHARED):
                own.forces.constants.stiffness = own.worlds.stiffness[w % own.worlds.stiffness.shape[0]]
            if wp.static(dampings != SHARED):
                own.forces.constants.damping = own.worlds.damping[w % own.worlds.damping.shape[0]]
            return own

        return place_own
    Each = composition.force_algorithm.Forces.vars["stiffness"].type if storage == "lattice" else None

    @wp.func
    def place_constants(own: SceneData, w: int) -> SceneData:
        if wp.static(storage == "one"):
            own.forces.constants.all = own.worlds.constants[w % own.worlds.constants.shape[0]]
        elif wp.static(storage == "table"):
            own.forces.constants.table = own.worlds.constants[w % own.worlds.constants.shape[0]]
        if wp.static(lengths == UNIFORM):
            own.forces.rest_length = Each(own.worlds.rest_length[w % own.worlds.rest_length.shape[0]])
        elif wp.static(lengths == EACH):
            own.forces.rest_length = own.worlds.rest_length[w % own.worlds.rest_length.shape[0]]
        if wp.static(stiffnesses == UNIFORM):
            own.forces.stiffness = Each(own.worlds.stiffness[w % own.worlds.stiffness.shape[0]])
        elif wp.static(stiffnesses == EACH):
            own.forces.stiffness = own.worlds.stiffness[w % own.worlds.stiffness.shape[0]]
        if wp.static(dampings == UNIFORM):
            own.forces.damping = Each(own.worlds.damping[w % own.worlds.damping.shape[0]])
        elif wp.static(dampings == EACH):
            own.forces.damping = own.worlds.damping[w % own.worlds.damping.shape[0]]
        return own

    return place_constants


@functools.cache
def to_world(Step: Any, compensated: bool) -> Any:
    """Compose wp.func (step, bytes) that shifts all arrays of a method's step to another world."""
    return shifts(Step, arrays_of(Step, compensated))
