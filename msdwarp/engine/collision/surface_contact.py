"""SurfaceContact: what keeps obstacles from coming in between the particles of bodies that touch."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces, contact_surfaces
from ...kernels.colliders import KINDS
from ...kernels.collision import (
    HISTORY,
    QUADRATURE_POINTS,
    SurfaceContactData,
    add_energies,
    add_pushes,
    evaluate_surface,
    quadrature_weights,
    surface_contact_term,
)
from ...world import Box, Collider, Contact, Load, Plane
from ..model.effect import Effect
from ..model.model import Model
from .body_contact import OVERLAP, SEPARATION_TIME, UNITS, BodyContact
from .colliders import LARGEST, Colliders
from .contact_parameters import STORED, given_stiffness, rules_by_kind
from .penetration_depth import start_depths

HARDER = 8.0
"""All places around a vertex together, by a contact of the body with one alike but rigid: seldom are all in."""
SLACK = 1e-4
"""How deep is none yet, by the spacing: particles on an obstacle lie on its surface but for roundings."""
THIN = 0.25
"""What is deeper in an obstacle than by this share of `inradius` is led out of the side that it came in by."""
KEPT = ("tangential_displacement", "contact_body", "way", "level")
"""What facets keep from one substep to the next."""
LEAST_RESTITUTION = 0.3
"""What bounces less is damped as this: particles bear most of a blow, and harder dampers need shorter steps."""


def surface_contact_of(
    model: Model,
    contact: Colliders,
    touching: BodyContact,
    colliders: Sequence[Collider],
    loads: Sequence[Load],
) -> "SurfaceContact | None":
    """Return the effect of obstacles that come in between particles, where that is asked for and any could.

    The half-space below a plane cannot: what has its corners above it lies above it.
    """
    rules = [one for one in loads if isinstance(one, Contact)]
    if contact.planes_only or not any(one.surface_colliders for one in rules):
        return None
    surfaces = contact_surfaces(model.system)
    spread = np.flatnonzero((surfaces.corner != surfaces.corner[:, :1]).any(axis=1))
    return SurfaceContact(model, contact, touching, colliders, rules, surfaces, spread) if len(spread) else None


class SurfaceContact(Effect):
    """Keeps the facets of bodies off obstacles, as `Colliders` keeps their particles off.

    See `kernels.collision.surface_contact`.

    Parameters
    ----------
    model
        The system on a device.
    contact
        Its contact with obstacles, by which these are where they are.
    touching
        Contact between its bodies, which places the vertices of their surfaces.
    colliders
        The obstacles.
    rules
        How bodies touch; where several hold for a body, the last.
    surfaces, facets
        What can touch, and the numbers of its facets that are more than points.
    """

    def __init__(
        self,
        model: Model,
        contact: Colliders,
        touching: BodyContact,
        colliders: Sequence[Collider],
        rules: Sequence[Contact],
        surfaces: TouchingSurfaces,
        facets: NDArray[np.int64],
    ) -> None:
        self._model, self._contact, self._touching = model, contact, touching
        scalar, device = model.scalar, model.device
        self._kinds = tuple(
            sorted({type(one).__name__ for one in colliders if not isinstance(one, Plane)}, key=KINDS.index)
        )

        def array(values: Any, kind: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=kind, device=device)

        corner, data = surfaces.corner[facets], SurfaceContactData(scalar, contact.moves)()
        self._data, body = data, surfaces.body[corner[:, 0]]
        data.place = array(quadrature_weights(), model.vector)
        data.x, data.v = touching.vertices
        each = surfaces.weight != 0
        data.first = array(np.append(0, np.cumsum(each.sum(axis=1))), int)
        data.particle, data.weight = array(surfaces.particle[each], int), array(surfaces.weight[each], scalar)
        inverse = np.broadcast_to(1.0 / model.mass, model.particle_count)
        mobility = (surfaces.weight**2 * inverse[surfaces.particle]).sum(axis=1)
        data.mobility, data.corner = array(mobility, scalar), array(corner, wp.vec3i)
        whole = HARDER * _rigid_stiffness(model, surfaces, rules)
        stiffness = (whole / _places_to_a_vertex(surfaces, corner))[body]
        data.stiffness, data.whole = array(stiffness, scalar), array(whole[body], scalar)
        data.slack = array(SLACK * surfaces.spacing[body], scalar)
        count = len(corner)
        data.tangential_displacement = wp.zeros((HISTORY, count), dtype=model.vector, device=device)
        data.way = wp.zeros((HISTORY, count), dtype=model.vector, device=device)
        data.level = wp.zeros((HISTORY, count), dtype=scalar, device=device)
        data.contact_body = wp.full((HISTORY, count), -1, dtype=int, device=device)
        data.solid = array([k for k, one in enumerate(colliders) if not isinstance(one, Plane)], int)
        data.solids, data.friction = contact.data.solids, contact.data.surface.friction
        boxes = np.array([_box_around(one) for one in colliders])
        data.lower, data.upper = (array(boxes[:, k], model.vector) for k in (0, 1))
        damping = [Contact(restitution=max(LEAST_RESTITUTION, one.restitution)).damping_ratio for one in colliders]
        data.damping = array(damping, scalar)
        data.thin = array([THIN * min(one.inradius(), LARGEST) for one in colliders], scalar)

        self.members = np.zeros(model.particle_count, dtype=bool)
        self.members[surfaces.particle[corner][surfaces.weight[corner] != 0]] = True
        data.force = wp.zeros((model.particle_count, 3), dtype=wp.int64, device=device)
        self.piece = surface_contact_term(model.dim, scalar, model.compensated)
        self.data = self.piece.Data()
        self.data.force = data.force
        self._unit = float(whole.max(initial=0.0)) * max(float(surfaces.spacing.max()), 1e-30) * UNITS
        self.data.unit = self._unit
        self._nowhere = wp.zeros(0, dtype=wp.float64, device=device)
        self._blocks = _blocks(model, surfaces, corner, stiffness, whole[body], max(damping))

        depth = _start_depths(surfaces.weight, model.system.position[surfaces.particle], corner, colliders)
        deepest = float(depth.max(initial=0.0))
        self._overlapping_at_start = bool((depth > OVERLAP * surfaces.spacing[body]).any())
        data.initial_overlap = array(depth if self._overlapping_at_start else np.zeros(count), scalar)
        data.overlap_release_speed = deepest / SEPARATION_TIME if self._overlapping_at_start else 0.0
        self._deepest = (int(np.argmax(depth)), deepest)
        if self._overlapping_at_start or contact.moves:
            data.power = wp.zeros(count, dtype=wp.float64, device=device)
            self.done = wp.zeros(count, dtype=wp.float64, device=device)
        self._stage = 0
        self._substep = 0

    def go_on_from(self, other: Effect) -> None:
        """Let facets stick to what they stuck to in another model of the same bodies."""
        assert isinstance(other, SurfaceContact)
        if other._data.contact_body.shape == self._data.contact_body.shape:
            for name in KEPT:
                wp.copy(getattr(self._data, name), getattr(other._data, name))

    def begin(self, substeps: int, dt: float) -> None:
        """Take the length of substeps, and where obstacles will be."""
        self._last = substeps - 1
        if self._contact.moves:
            for name in ("turn", "shift", "turning", "speed"):
                setattr(self._data, name, getattr(self._contact.data, name))

    def hold(self, time: float) -> None:
        """Have all stages see obstacles where they are at `time` [s]: for what is launched between frames."""
        self._substep, self._stage = self._last, len(self.steps.stage_times)
        self._contact.hold_still(time)

    def begin_substep(self, substep: int) -> bool:
        """Have what is launched next find obstacles where they are in this substep."""
        self._substep = substep
        return False

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the forces of obstacles on facets, whose vertices contact between bodies has just placed."""
        times = self.steps.stage_times
        self._stage = 0 if begins else self._stage + 1
        # What is not a stage of the substep is looked at where it ends.
        share = times[self._stage] if self._stage < len(times) else 1.0
        row, share = (self._substep + 1, 0.0) if share == 1.0 else (self._substep, share)
        self._data.force.zero_()
        dt = self.steps.dt
        lag = dt if self.steps.lagging else 0.0
        self._launch(False, [row, share, dt if begins else 0.0, lag], [self._nowhere, self._nowhere])

    def _launch(self, measuring: bool, how: list, sums: list) -> None:
        """Launch the kernel over all facets: on a GPU a thread for each, on the CPU one for all."""
        device = self._model.device
        kernel = evaluate_surface(
            self._model.scalar, self._kinds, self._contact.moves, self._overlapping_at_start, measuring
        )
        threads = len(self._data.corner) if device.is_cuda else 1
        wp.launch(kernel, threads, [self._data, *how, self._unit, threads], sums, device=device)

    def add_up(self, seconds: float) -> None:
        """Launch the sums of what obstacles do, and of what they push particles with, where that is asked for."""
        model, contact = self._model, self._contact
        if self.done is not None:
            inputs = [self._data.power, seconds]
            wp.launch(add_energies, len(self.done), inputs, [self.done], device=model.device)
        if contact.contact_forces:
            inputs = [self._data.force, self._unit, model.inverse_mass, seconds]
            outputs = [contact.data.impulse]
            wp.launch(add_pushes(model.scalar), model.particle_count, inputs, outputs, device=model.device)

    def overlapping(self) -> str | None:
        """Return words about the facet that an obstacle is in deepest at the start; None where none is."""
        if not self._overlapping_at_start:
            return None
        facet, deep = self._deepest
        vertex = int(self._data.corner.numpy()[facet][0])
        particle = int(self._data.particle.numpy()[self._data.first.numpy()[vertex]])
        return (
            f"an obstacle reaches {deep:.3g} m into the surface at particle {particle} at the start: it is led "
            f"out within {SEPARATION_TIME} s; move the body or the obstacle apart"
        )

    @property
    def changing(self) -> list[wp.array]:
        """How facets stick."""
        return [*(getattr(self._data, name) for name in KEPT), self._data.initial_overlap]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return how facets stick."""
        names = (*KEPT, *(("initial_overlap",) if self._overlapping_at_start else ()))
        arrays = {f"straddle.{STORED[name]}": getattr(self._data, name).numpy().copy() for name in names}
        if self._overlapping_at_start:
            arrays["straddle.outwards"] = np.array([self._data.overlap_release_speed])
        return arrays

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Take back what `checkpoint` gave."""
        for name in KEPT:
            getattr(self._data, name).assign(arrays[f"straddle.{STORED[name]}"])
        self._overlapping_at_start = "straddle.allowed" in arrays
        self._model.generation += 1  # it launches other kernels
        if self._overlapping_at_start:
            self._data.initial_overlap.assign(arrays["straddle.allowed"])
            self._data.overlap_release_speed = float(arrays["straddle.outwards"][0])

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add what obstacles hold facets with, by what that is more than other bodies do: nothing is in both."""
        for blocks, each, others in zip((stiffness, damping), self._blocks, self._touching.blocks, strict=True):
            more = np.maximum(each - others[0], 0.0)
            blocks.assign(blocks.numpy() + more[:, None, None] * np.eye(self._model.dim))

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what is stored [J], and what turns to heat [W], where a frame ends; in the only world."""
        count, device = len(self._data.corner), self._model.device
        stored, heated = (wp.zeros(count, dtype=wp.float64, device=device) for _ in "sh")
        self._touching.place_vertices(x, v)
        self._launch(True, [self._last + 1, 0.0, 0.0, 0.0], [stored, heated])
        return stored.numpy().sum(keepdims=True), heated.numpy().sum(keepdims=True)


def _box_around(collider: Collider) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest coordinates of an obstacle as it is given [m], both of shape [3]."""
    if isinstance(collider, Plane):
        return np.full(3, -np.inf), np.full(3, np.inf)
    geometry = collider.geometry(3)
    if isinstance(collider, Box):
        reach = np.abs(geometry["axes"]) @ geometry["b"]
        return geometry["a"] - reach, geometry["a"] + reach
    ends = np.array([geometry["a"], geometry.get("b", geometry["a"])])
    return ends.min(axis=0) - geometry["radius"], ends.max(axis=0) + geometry["radius"]


def _rigid_stiffness(model: Model, surfaces: TouchingSurfaces, rules: Sequence[Contact]) -> NDArray[np.float64]:
    """Return the stiffness of a contact of each body with one that is rigid [N/m]: twice that with one alike.

    What a scene gives for a body and others of its kind holds as it is.
    """
    kind, rule = rules_by_kind(model, surfaces, rules)
    given = given_stiffness(rules, rule[kind, kind])
    return np.where(given < 0, 2.0 * surfaces.stiffness, given)


def _places_to_a_vertex(surfaces: TouchingSurfaces, corner: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return how many places on facets there are of each body for each vertex that bears by itself."""
    bodies = len(surfaces.closed)
    vertices = np.bincount(surfaces.body, minlength=bodies)
    carriers = np.unique(surfaces.particle[surfaces.weight != 0])
    carrying = np.bincount(surfaces.body_of_particle[carriers], minlength=bodies)
    facets = np.bincount(surfaces.body[corner[:, 0]], minlength=bodies)
    return QUADRATURE_POINTS * np.maximum(facets, 1) / np.maximum(np.minimum(vertices, carrying), 1)


def _blocks(
    model: Model,
    surfaces: TouchingSurfaces,
    corner: NDArray[np.int32],
    stiffness: NDArray[np.float64],
    whole: NDArray[np.float64],
    damping_ratio: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what obstacles add to the blocks of K [N/m] and B [N s/m] of each particle, as numbers.

    A place with the weights w has the matrix k w wᵀ, of which by Gershgorin a particle's part is at most k w_i;
    blocks count half of it. With all places in, each corner of a facet has a third. Half of that is taken: a body
    presses on an obstacle with all places at once only where its particles move alike, and then its springs are at
    rest. Dampers are those of the middle of a facet, which stands for three times the mass of a corner.
    """
    mass = np.broadcast_to(np.where(np.isfinite(model.mass), model.mass, 0.0), model.particle_count)
    heavy = (surfaces.weight * mass[surfaces.particle]).sum(axis=1)[corner].max(axis=1)
    stiff = 0.25 * QUADRATURE_POINTS / 3 * stiffness
    damped = stiff * 2 * damping_ratio * np.sqrt(3 * heavy / np.maximum(whole, 1e-300))
    totals = []
    for values in (stiff, damped):
        on_vertices = np.zeros(len(surfaces.particle))
        np.add.at(on_vertices, corner, np.repeat(values[:, None], 3, axis=1))
        total = np.zeros(model.particle_count)
        np.add.at(total, surfaces.particle, np.abs(surfaces.weight) * on_vertices[:, None])
        totals.append(total)
    return totals[0], totals[1]


def _start_depths(
    weight: NDArray[np.float64],
    position: NDArray[np.float64],
    corner: NDArray[np.int32],
    colliders: Sequence[Collider],
) -> NDArray[np.float64]:
    """Return how deep an obstacle is in each facet at the start [m], 0 where none is, shape [facet_count].

    Parameters
    ----------
    weight, position
        Of the particles that each vertex is a mixture of, shapes [vertex_count, k] and [vertex_count, k, 3].
    corner
        The vertices of each facet.
    colliders
        The obstacles.
    """
    places = np.einsum("vk,vkd->vd", weight, position)[corner]
    depth, solids = np.zeros(len(corner)), [one for one in colliders if not isinstance(one, Plane)]
    middle = places.mean(axis=1)
    far = np.linalg.norm(places - middle[:, None], axis=2).max(axis=1)
    near = np.flatnonzero((start_depths(middle, solids) > -far).any(axis=0))
    if len(near):
        on_facets = np.einsum("sc,fcd->fsd", np.array(quadrature_weights()), places[near])
        found = start_depths(on_facets.reshape(-1, 3), solids).max(axis=0)
        depth[near] = np.maximum(found.reshape(len(near), -1).max(axis=1), 0.0)
    return depth
