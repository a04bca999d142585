"""The parts from which the kernels of a scene are composed, and the stage of a method."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fast_kernel, fully_hashed, kernel, vector
from ..colliders.collide import NO_COLLIDERS, ColliderTerm
from ..compensation import compensated_sum
from ..effect import Driving, ForceTerm, instant
from ..records import records
from ..springs.force_algorithm import ForceAlgorithm
from .differences import Differences, world_data


class Composition(NamedTuple):
    """The parts from which the kernels of a scene are composed; hashable, so that equal scenes share kernels."""

    dim: int
    """Number of coordinates of a particle."""
    scalar: type
    """Warp's type of real numbers."""
    force_algorithm: ForceAlgorithm
    """The algorithm that sums the forces of connections."""
    compensated: bool = False
    """Whether rounding errors of sums are compensated."""
    pinned: bool = False
    """Whether any particle is pinned."""
    collider_term: ColliderTerm = NO_COLLIDERS
    """Contact with obstacles."""
    terms: tuple[ForceTerm, ...] = ()
    """The terms of the scene's other effects."""
    second_pass: bool = False
    """Whether a second launch advances masked particles: for lattices in columns, if few particles have masks."""
    differs: Differences | None = None
    """Differences between the worlds of an ensemble; None for a single world."""

    @property
    def selective(self) -> list[ForceTerm]:
        """The effects whose forces act on some particles only; effect k uses bit k of a particle's mask."""
        return [term for term in self.terms if term.selective]

    @property
    def kernel(self) -> Any:
        """How kernels of stages are declared: as those of contact, so that one launch of all does the same."""
        return fast_kernel if any(term.field == "body_contact" for term in self.terms) else kernel

    @property
    def timed(self) -> bool:
        """Whether the force of an effect depends on time."""
        return any(term.timed for term in self.terms)


class Stage(NamedTuple):
    """One stage of an integration method, as a function for one particle."""

    Step: Any
    """Type of the struct that a stage reads and writes. Forces are evaluated at its `x`, `v`, `compensation`."""
    advance: Any
    """wp.func (scene, step, force, i) that advances particle i under this force."""
    forced: bool = True
    """Whether `advance` needs the force; if not, `force` is 0."""


@functools.cache
def scene(composition: Composition):
    """Compose the struct of everything that acts on particles, the same in all stages of all methods.

    forces: the data of the force algorithm. inverse_mass [1/kg], shape [particle_count], 0 where pinned. gravity
    [m/s²]. colliders: the obstacles. Then the data of each other effect, named as in its force term. Then, if
    needed: effect_mask, bits of the selective effects on each particle, shape [particle_count]; masked_particles,
    the indices of particles with a bit set; spring_force, the forces of connections on these [N], from
    `Model.vectors`; stage, the stage of a frame, counted from 0; time, the times of all stages and of the frame's
    end [s]; worlds, the differences between worlds.
    """
    fields = {
        "forces": composition.force_algorithm.Forces,
        "inverse_mass": wp.array(dtype=composition.scalar),
        "gravity": vector(composition.dim, composition.scalar),
        "colliders": composition.collider_term.Colliders,
    }
    fields |= {term.field: term.Data for term in composition.terms}
    if composition.selective:
        fields["effect_mask"] = wp.array(dtype=wp.uint8)
    if composition.second_pass:
        fields["masked_particles"] = wp.array(dtype=int)
        fields["spring_force"] = wp.array(dtype=vector(composition.dim, composition.scalar))
    if composition.timed:
        fields["stage"] = int
        fields["time"] = wp.array(dtype=composition.scalar)
    if composition.differs is not None:
        kinds = (composition.dim, composition.scalar, composition.force_algorithm.Forces)
        fields["worlds"] = world_data(*kinds, composition.differs, "body_contact" in fields)
    names = {"__module__": __name__, "__qualname__": "world.<locals>.World"}
    return wp.struct(type("SceneData", (), {"__annotations__": fields} | names))


class Tools(NamedTuple):
    """The types and functions with which methods are composed."""

    V: Any
    """Vector type with the scene's number of coordinates."""
    SceneData: Any
    """Type of the struct of everything that acts on particles."""
    Compensation: Any
    """Type of the struct that compensates sums."""
    load: Any
    """wp.func (x, i) that returns x[i]."""
    store: Any
    """wp.func (x, i, value) that sets x[i] to value."""
    add: Any
    """wp.func (total, change, compensation, lost_out, i) that returns total + change (see `compensated_sum`)."""


@functools.cache
def tools(composition: Composition) -> Tools:
    """Return the types and functions with which the methods of a scene are composed."""
    dim, scalar = composition.dim, composition.scalar
    load, store, _ = records(dim, scalar)
    Compensation, add = compensated_sum(dim, scalar, composition.compensated)
    return Tools(vector(dim, scalar), scene(composition), Compensation, load, store, add)


@functools.cache
def data_of(SceneData: Any, field: str) -> Any:
    """Compose wp.func (scene) -> the data of an effect. Code for Warp cannot name a field by a variable."""
    Data = SceneData.vars[field].type

    @wp.func_native(f"data = s.{field};")
    def take_data(s: wp.ref[SceneData], data: wp.ref[Data]): ...

    @wp.func
    def data_of_effect(scene: SceneData) -> Data:
        data = Data()
        take_data(scene, data)
        return data

    return data_of_effect


@functools.cache
def beginning(composition: Composition) -> Any:
    """Compose (scene, compensation, x, c), which changes connection c when a substep begins; None without need."""
    V, SceneData, Compensation, *_ = tools(composition)
    terms = [term for term in composition.terms if term.begin is not None]
    begins, data = [one.begin for one in terms], [data_of(SceneData, one.field) for one in terms]
    count = len(terms)

    @fully_hashed
    def begin_all(scene: SceneData, compensation: Compensation, x: wp.array(dtype=V), c: int):
        for k in range(wp.static(count)):
            wp.static(begins[k])(wp.static(data[k])(scene), compensation, x, c)

    return begin_all if terms else None


@functools.cache
def loads(composition: Composition) -> Any:
    """Compose the sum of effects' forces on a particle [N], (scene, compensation, x, v, i, mask).

    `mask` is the particle's entry of `scene.effect_mask`. None if no effect has a force. The forces whose work is
    summed (see `loads.work`) come last.
    """
    V, SceneData, Compensation, load, *_ = tools(composition)
    terms = sorted((one for one in composition.terms if one.force is not None), key=lambda one: one.works)
    if not terms:
        return None
    count, silent = len(terms), sum(not one.works for one in terms)
    forces, data = [one.force for one in terms], [data_of(SceneData, one.field) for one in terms]
    bits = [1 << composition.selective.index(one) if one.selective else 0 for one in terms]
    working, timed, worked = sum(bits[silent:]), composition.timed, "worked" in SceneData.vars
    Instant: Any = instant(composition.dim, composition.scalar, composition.compensated)
    Vectors = wp.array(dtype=V)

    @fully_hashed
    def sum_loads(
        scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int, mask: wp.uint8
    ) -> V:
        now = Instant()
        now.x = x
        now.v = v
        now.compensation = compensation
        now.inverse_mass = scene.inverse_mass
        if wp.static(timed):
            now.stage = scene.stage
            now.time = scene.time[scene.stage]
        if wp.static(worked):
            now.weight = scene.worked.weight
            now.weight_of_last = scene.worked.weight_of_last
        total = V()
        for k in range(wp.static(silent)):
            if wp.static(bits[k] == 0) or (mask & wp.uint8(wp.static(bits[k]))) != wp.uint8(0):
                total += wp.static(forces[k])(wp.static(data[k])(scene), now, i)
        if wp.static(working > 0):
            if (mask & wp.uint8(wp.static(working))) != wp.uint8(0):
                f = V()
                for k in range(wp.static(silent), wp.static(count)):
                    if (mask & wp.uint8(wp.static(bits[k]))) != wp.uint8(0):
                        f += wp.static(forces[k])(wp.static(data[k])(scene), now, i)
                v_i = load(v, i)
                done = now.weight[now.stage] * wp.float64(wp.dot(f, v_i))
                if now.weight_of_last[now.stage] > wp.float64(0.0):
                    done += now.weight_of_last[now.stage] * wp.float64(wp.dot(scene.worked.last[i], v_i))
                    scene.worked.last[i] = f
                scene.worked.done[i] = scene.worked.done[i] + done
                total += f
        return total

    return sum_loads


@functools.cache
def before_forces(composition: Composition) -> tuple[Any, Any]:
    """Compose (count, evaluate) of the effect that has `ForceTerm.before_forces`; (None, None) if none has."""
    found = [term for term in composition.terms if term.before_forces is not None]
    assert len(found) < 2, "only one effect may have elements to evaluate before forces"
    if not found:
        return None, None
    V, SceneData, Compensation, *_ = tools(composition)
    (count, evaluate), data, Vectors = (
        found[0].before_forces,
        data_of(SceneData, found[0].field),
        wp.array(dtype=V),
    )

    @wp.func
    def count_elements(scene: SceneData) -> int:
        return count(data(scene))

    @wp.func
    def evaluate_element(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, c: int):
        evaluate(data(scene), compensation, x, v, c)

    return count_elements, evaluate_element


@functools.cache
def driving(composition: Composition) -> Driving:
    """Compose the functions that set the state of driven particles from the poses of drives."""
    SceneData = scene(composition)
    return next((term.drive(SceneData) for term in composition.terms if term.drive is not None), Driving())
