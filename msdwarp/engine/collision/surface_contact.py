"""SurfaceContact: keeps obstacles from entering between the particles of bodies."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces
from ...kernels.colliders.signed_distance import KINDS
from ...kernels.collision.force_sums import add_impulses
from ...kernels.collision.surface_contact import evaluate_surface
from ...kernels.collision.surface_contact_data import (
    QUADRATURE_POINTS,
    SurfaceContactData,
    add_energies,
    quadrature_weights,
)
from ...world import Box, Collider, Contact, Load, Plane
from ..model.model import Model
from .body_contact import OVERLAP, BodyContact
from .colliders import LARGEST, Colliders
from .contact_history import SEPARATION_TIME, WithHistory
from .contact_rules import spread_to_particles
from .contact_surfaces import bearing_vertices
from .penetration_depth import start_depths

HARDER, HARDER_SOLID = 8.0, 4.25
"""Ratio of the stiffness of all samples around a vertex to that of body contact: all are seldom inside.

The contact mesh of a solid body lies inside it. What is outside is not deformed: a layer 1/4 of the spacing s
thick, whose stiffness is 4 E s for each vertex. So contact is softer by that in series: 1/4.25 = 1/8 + 1/9. In a
lattice 4 E s is 8.4 to 9.7 times body contact with a rigid body, for Poisson's ratios from 0.25 to 0.45.
"""
SLACK = 1e-4
"""Smallest depth that counts, over the spacing: particles on an obstacle are on its surface up to rounding."""
THIN = 0.25
"""A sample deeper in an obstacle than this fraction of `inradius` is pushed out through its entry side."""
DAMPING = 1 / 20
"""Largest rate of the dampers of a particle's facets, times the substep. From 1/12 on a ball with a fine surface
trembles between planes; so dampers shorten no step."""
LEAST_RESTITUTION = 0.3
"""Lower restitutions are raised to this: particles take most of an impact; the limit would weaken such dampers."""


def surface_contact_of(
    model: Model,
    contact: Colliders,
    touching: BodyContact,
    colliders: Sequence[Collider],
    loads: Sequence[Load],
) -> "SurfaceContact | None":
    """Return the effect that keeps obstacles out of surfaces, if requested and possible.

    A plane cannot enter between particles: a facet whose corners are above a plane is above it. Planes count only
    if obstacles ignore some particles, such as those of a ball cut from a lattice that are outside its surface.
    """
    rules = [one for one in loads if isinstance(one, Contact)]
    if not any(one.surface_colliders for one in rules):
        return None
    corner = touching.surfaces.on_host.corner
    corner = corner[(corner != corner[:, :1]).any(axis=1)]
    met = [k for k, one in enumerate(colliders) if contact.spared.any() or not isinstance(one, Plane)]
    return SurfaceContact(model, contact, touching, colliders, met, corner) if len(corner) and met else None


class SurfaceContact(WithHistory):
    """Keeps the facets of bodies out of obstacles, as `Colliders` does for particles.

    Its forces are added to those of contact between bodies on the same vertices, after these are computed.

    See `kernels.collision.surface_contact`. `contact` has the poses of obstacles, `touching` the vertices; `met`
    has the indices of the obstacles that are tested; `corner` has the vertices of each facet, shape [facet_count,
    3], without facets that are single particles.
    """

    term = data = None

    def __init__(
        self,
        model: Model,
        contact: Colliders,
        touching: BodyContact,
        colliders: Sequence[Collider],
        met: Sequence[int],
        corner: NDArray[np.int32],
    ) -> None:
        self._model, self._contact, self._touching = model, contact, touching
        scalar, device = model.scalar, model.device
        self._kinds = tuple(sorted({type(colliders[k]).__name__ for k in met}, key=KINDS.index))

        def array(values: Any, kind: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=kind, device=device)

        surfaces, vertices = touching.surfaces.on_host, touching.surfaces.data
        data = self._data = SurfaceContactData(scalar, contact.moves)()
        body, count = surfaces.body[corner[:, 0]], len(corner)
        data.place = array(quadrature_weights(), model.vector)
        for name in ("x", "v", "mobility", "force"):
            setattr(data, name, getattr(vertices, name))
        data.corner = array(corner, wp.vec3i)
        # Contact with a rigid body is twice as stiff as with an equal one, unless its stiffness is given.
        given = touching.rules.given_stiffness(*[np.arange(len(surfaces.solid))] * 2)
        harder = np.where(surfaces.solid, HARDER_SOLID, HARDER)
        whole = harder * np.where(given < 0, 2.0 * surfaces.stiffness, given)
        facets = np.bincount(body, minlength=len(whole))
        points = QUADRATURE_POINTS * np.maximum(facets, 1) / np.maximum(bearing_vertices(surfaces), 1)
        stiffness = (whole / points)[body]
        data.stiffness, data.whole = array(stiffness, scalar), array(whole[body], scalar)
        radius = np.where(surfaces.solid, surfaces.radius, 0.0)[body]  # the facets of a solid body are inside it
        data.slack = array(SLACK * surfaces.spacing[body] - radius, scalar)
        self.set_up_history(model, data, count, "straddle", {"side": model.vector, "level": scalar})
        data.solid = array(met, int)
        data.solids, data.friction = contact.data.solids, contact.data.surface.friction
        boxes = np.array([_box_around(one) for one in colliders])
        data.lower, data.upper = (array(boxes[:, k], model.vector) for k in (0, 1))
        damping = [Contact(restitution=max(LEAST_RESTITUTION, one.restitution)).damping_ratio for one in colliders]
        data.damping = array(damping, scalar)
        data.thin = array([THIN * min(one.inradius(), LARGEST) for one in colliders], scalar)

        self._nowhere = wp.zeros(0, dtype=wp.float64, device=device)
        self._blocks = _blocks(model, surfaces, corner, stiffness)

        depth = _start_depths(surfaces, model.system.position, corner, radius, [colliders[k] for k in met])
        if (depth > OVERLAP * surfaces.spacing[body]).any():
            self.allow(depth)
        self._deepest = (int(np.argmax(depth)), float(depth.max(initial=0.0)))
        if self.overlapping_at_start or contact.moves:
            data.power = wp.zeros(count, dtype=wp.float64, device=device)
            self.done = wp.zeros(count, dtype=wp.float64, device=device)
        self._stage = 0
        self._substep = 0
        model.kernels.note(self._kernel(False), self._kernel(True))
        if self.done is not None:
            model.kernels.note(add_energies)
        if contact.contact_forces:
            self._before = wp.zeros_like(data.force)
            self._add_impulses = add_impulses(model.dim, scalar, model.compensated, True)
            model.kernels.note(self._add_impulses)

    def begin(self, substeps: int, dt: float) -> None:
        """Let kernels read the obstacles' poses in a frame from the arrays of `Colliders`."""
        self._last = substeps - 1
        if self._contact.moves:
            for name in ("turn", "shift", "turning", "speed"):
                setattr(self._data, name, getattr(self._contact.data, name))

    def hold(self, time: float) -> None:
        """Fix obstacles at their poses at `time` [s] in all stages, for launches between frames."""
        self._substep, self._stage = self._last, len(self.steps.stage_times)
        self._contact.hold_still(time)

    def begin_substep(self, substep: int) -> bool:
        """Select the poses of this substep for the next launches."""
        self._substep = substep
        return False

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the forces of obstacles on facets; contact between bodies has just updated the vertices."""
        times = self.steps.stage_times
        self._stage = 0 if begins else self._stage + 1
        # An evaluation after the last stage is at the substep's end.
        fraction = times[self._stage] if self._stage < len(times) else 1.0
        row, fraction = (self._substep + 1, 0.0) if fraction == 1.0 else (self._substep, fraction)
        if self._contact.contact_forces:
            wp.copy(self._before, self._data.force)
        dt = self.steps.dt
        self._launch(False, [row, fraction, dt if begins else 0.0, DAMPING / dt], [self._nowhere, self._nowhere])

    def _launch(self, measuring: bool, how: list, sums: list) -> None:
        """Launch the kernel over all facets: on a GPU a thread per facet, on the CPU a single thread."""
        device, kernel = self._model.device, self._kernel(measuring)
        threads = len(self._data.corner) if device.is_cuda else 1
        wp.launch(
            kernel, threads, [self._data, *how, 1.0 / self._touching.data.unit, threads], sums, device=device
        )

    def _kernel(self, measuring: bool) -> Any:
        kinds = self._kinds, self._contact.moves, self.overlapping_at_start
        return evaluate_surface(self._model.scalar, *kinds, measuring)

    def add_up(self, seconds: float) -> None:
        """Launch the sums of obstacles' work and, if requested, of impulses, for forces during `seconds` [s]."""
        model, contact = self._model, self._contact
        if self.done is not None:
            inputs = [self._data.power, seconds]
            wp.launch(add_energies, len(self.done), inputs, [self.done], device=model.device)
        if contact.contact_forces:
            inputs = [self._touching.data, self._before, model.inverse_mass, seconds]
            outputs = [contact.data.impulse]
            wp.launch(self._add_impulses, model.particle_count, inputs, outputs, device=model.device)

    def overlapping(self) -> str | None:
        """Return a warning about the facet that an obstacle penetrates deepest at the start, or None."""
        if not self.overlapping_at_start:
            return None
        facet, deep = self._deepest
        vertex, surfaces = int(self._data.corner.numpy()[facet][0]), self._touching.surfaces.on_host
        particle = int(surfaces.particle[vertex][surfaces.weight[vertex] != 0][0])
        return (
            f"an obstacle reaches {deep:.3g} m into the surface at particle {particle} at the start: it is moved "
            f"out within {SEPARATION_TIME} s; move the body or the obstacle apart"
        )

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Raise the stiffness of contact between bodies to that of contact with obstacles, if this is larger.

        Dampers add nothing: kernels limit each of them so that it does not shorten the stable step.
        """
        more = np.maximum(self._blocks - self._touching.blocks[0], 0.0)
        stiffness.assign(stiffness.numpy() + more[:, None, None] * np.eye(self._model.dim))

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return stored energy [J] and dissipated power [W] at a frame's end, shape [1] each, as for one world."""
        count, device = len(self._data.corner), self._model.device
        stored, heated = (wp.zeros(count, dtype=wp.float64, device=device) for _ in "sh")
        self._touching.place_vertices(x, v)
        self._launch(True, [self._last + 1, 0.0, 0.0, DAMPING / self.steps.dt], [stored, heated])
        return stored.numpy().sum(keepdims=True), heated.numpy().sum(keepdims=True)


def _box_around(collider: Collider) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest coordinates of an obstacle in its given pose [m], both of shape [3]."""
    geometry = collider.geometry(3)
    if isinstance(collider, Plane):
        # A plane normal to an axis is bounded along this axis.
        along = geometry["a"] > 1.0 - 1e-12
        return np.full(3, -np.inf), np.where(along, geometry["radius"], np.inf)
    if isinstance(collider, Box):
        reach = np.abs(geometry["axes"]) @ geometry["b"]
        return geometry["a"] - reach, geometry["a"] + reach
    ends = np.array([geometry["a"], geometry.get("b", geometry["a"])])
    return ends.min(axis=0) - geometry["radius"], ends.max(axis=0) + geometry["radius"]


def _blocks(
    model: Model, surfaces: TouchingSurfaces, corner: NDArray[np.int32], stiffness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the contributions of obstacles to diagonal blocks of K [N/m], scalars of each particle.

    A sample with weights w has the stiffness matrix k w wᵀ. Its row i sums to k w_i, which bounds it (Gershgorin);
    half of that is returned, since the stability bound doubles blocks. With all samples inside, each corner of a
    facet gets a third of their stiffness. Again half of that is returned: all samples of a body are inside only if
    its particles move together, and then its springs do not oscillate.
    """
    on_vertices = np.zeros(len(surfaces.particle))
    np.add.at(on_vertices, corner, np.repeat(0.25 * QUADRATURE_POINTS / 3 * stiffness[:, None], 3, axis=1))
    return spread_to_particles(surfaces, on_vertices, model.particle_count)


def _start_depths(
    surfaces: TouchingSurfaces,
    position: NDArray[np.float64],
    corner: NDArray[np.int32],
    radius: NDArray[np.float64],
    colliders: Sequence[Collider],
) -> NDArray[np.float64]:
    """Return the depth of obstacles in each facet's shell at the start [m], 0 if none, shape [facet_count]."""
    places = np.einsum("vk,vkd->vd", surfaces.weight, position[surfaces.particle])[corner]
    depth = np.zeros(len(corner))
    middle = places.mean(axis=1)
    far = radius + np.linalg.norm(places - middle[:, None], axis=2).max(axis=1)
    near = np.flatnonzero((start_depths(middle, colliders) > -far).any(axis=0))
    if len(near):
        on_facets = np.einsum("sc,fcd->fsd", np.array(quadrature_weights()), places[near])
        found = start_depths(on_facets.reshape(-1, 3), colliders).max(axis=0)
        depth[near] = np.maximum(radius[near] + found.reshape(len(near), -1).max(axis=1), 0.0)
    return depth
