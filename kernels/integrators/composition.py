"""The parts from which the kernels of a scene are composed, and the stage of a method."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from ..colliders.collide import NO_COLLIDERS, ColliderTerm
from ..compensation import compensated_sum
from ..effect import Driving, ForceTerm
from ..loads.work import measured
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
    pieces: tuple[ForceTerm, ...] = ()
    """The terms of the scene's other effects."""
    second_pass: bool = False
    """Whether a second launch advances masked particles: for lattices in columns, if few particles have masks."""
    differs: Differences | None = None
    """Differences between the worlds of an ensemble; None for a single world."""

    @property
    def selective(self) -> list[ForceTerm]:
        """The effects whose forces act on some particles only; effect k uses bit k of a particle's mask."""
        return [piece for piece in self.pieces if piece.selective]

    @property
    def timed(self) -> bool:
        """Whether the force of an effect depends on time."""
        return any(piece.timed for piece in self.pieces)


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
    fields |= {piece.field: piece.Data for piece in composition.pieces}
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
def beginning(composition: Composition) -> Any:
    """Compose (scene, compensation, x, c), which changes connection c when a substep begins; None without need."""
    _, SceneData, Compensation, *_ = tools(composition)
    Vectors = wp.array(dtype=vector(composition.dim, composition.scalar))

    def both(first: Any, second: Any) -> Any:
        @wp.func
        def begin(scene: SceneData, compensation: Compensation, x: Vectors, c: int):
            first(scene, compensation, x, c)
            second(scene, compensation, x, c)

        return begin

    return _joined(both, [piece.begin(SceneData) for piece in composition.pieces if piece.begin is not None])


@functools.cache
def loads(composition: Composition) -> Any:
    """Compose the sum of effects' forces on a particle [N], (scene, compensation, x, v, i, mask).

    `mask` is the particle's entry of `scene.effect_mask`. None if no effect has a force.
    """
    V, SceneData, Compensation, *_ = tools(composition)
    selective, Vectors = composition.selective, wp.array(dtype=V)

    def both(first: Any, second: Any) -> Any:
        @wp.func
        def load(
            scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int, mask: wp.uint8
        ) -> V:
            return first(scene, compensation, x, v, i, mask) + second(scene, compensation, x, v, i, mask)

        return load

    def masked(force: Any, bits: int) -> Any:
        @wp.func
        def load_where_masked(
            scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int, mask: wp.uint8
        ) -> V:
            if wp.static(bits == 0):
                return force(scene, compensation, x, v, i)
            else:
                total = V()
                if (mask & wp.uint8(wp.static(bits))) != wp.uint8(0):
                    total = force(scene, compensation, x, v, i)
                return total

        return load_where_masked

    silent, working, effect_mask = [], [], 0
    for piece in composition.pieces:
        if piece.force is None:
            continue
        bits = 1 << selective.index(piece) if piece.selective else 0
        force = masked(piece.force(SceneData), bits)
        (working if piece.works else silent).append(force)
        effect_mask |= bits if piece.works else 0
    if working:
        kinds = (composition.dim, composition.scalar, SceneData)
        silent.append(measured(*kinds, _joined(both, working), Compensation, effect_mask))
    return _joined(both, silent)


@functools.cache
def parts(composition: Composition) -> tuple[Any, Any]:
    """Return (count, evaluate) of the effect that has `ForceTerm.parts`; (None, None) if none has."""
    found = [piece.parts for piece in composition.pieces if piece.parts is not None]
    assert len(found) < 2, "only one effect may have parts"
    return found[0](scene(composition)) if found else (None, None)


@functools.cache
def driving(composition: Composition) -> Driving:
    """Compose the functions that set the state of driven particles from the poses of drives."""
    SceneData = scene(composition)
    return next((piece.drive(SceneData) for piece in composition.pieces if piece.drive is not None), Driving())


def _joined(both: Callable[[Any, Any], Any], functions: list[Any]) -> Any:
    """Join functions into one by calling `both` on two at a time; return None if `functions` is empty."""
    return functools.reduce(both, functions) if functions else None
