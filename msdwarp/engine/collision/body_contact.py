"""BodyContact: contact between the bodies of a system on a device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import contact_surfaces
from ...kernels.collision import (
    BLOCK,
    BLOCKS,
    DEEPEST,
    FEW_ON_GPU,
    HISTORY,
    NOTED,
    ON_GPU,
    Surfaces,
    add_impulses,
    body_contact_term,
    contact_energy,
    evaluate_contact,
    evaluate_segments_and_spheres,
)
from ...world import Contact
from ..device.csr import rows
from ..device.launcher import Launcher
from ..device.vector_arrays import in_records
from ..model.effect import Effect
from ..model.model import Model
from .contact_parameters import (
    STORED,
    check_stiffness,
    contact_blocks,
    hops_apart,
    led_apart,
    neighbourhoods,
    rules_by_kind,
    stiffness_of_pairs,
)
from .initial_overlap import initial_containment
from .neighbor_list import NeighborList
from .tables_by_world import Repeated, blocks_by_row, surfaces_by_row
from .tunnelling import Tunnelling

OVERLAP = 0.01
"""By so much of their spacing bodies may overlap at the start before something is said."""
SEPARATION_TIME = 0.5
"""What overlaps at the start is led apart within this time [s]."""
UNITS = 2.0**-40
"""The unit in which forces are summed, by the largest force that a contact is meant to bear."""


class BodyContact(Effect):
    """Keeps bodies out of each other: points of their surfaces against facets.

    Facets near a point are listed. A list holds until something has moved by half of its skin: lists are made anew
    before every few substeps, and a frame in which that was not often enough is repeated with a larger skin. What
    is listed and not touched changes nothing, so that results do not depend on the skin.

    Parameters
    ----------
    model
        The system on a device.
    rules
        Which bodies touch, and how; where several hold for a pair, the last.
    felt
        Whether what bodies push each other's particles with is summed, in `impulse`.
    """

    def __init__(self, model: Model, rules: Sequence[Contact], contact_forces: bool = False) -> None:
        self._model, self._rules, self._dt = model, rules, 0.0
        surfaces = self._surfaces = contact_surfaces(model.system)
        by_row, each = surfaces_by_row(model, surfaces), Repeated(model)
        scalar, device, dtype = model.scalar, model.device, model.dtype
        kind, rule = rules_by_kind(model, surfaces, rules)
        for one in by_row:
            check_stiffness(one, rules, kind, rule)
        worlds, bodies = model.worlds, len(surfaces.closed)
        vertices, points = len(surfaces.particle), len(surfaces.share)
        data = self._data = Surfaces(scalar, model.in_worlds)()
        present = surfaces.weight != 0
        data.first = each.starts(present.sum(axis=1))
        data.particle = each.alike(surfaces.particle[present], int, model.stride)
        data.weight = each.alike(surfaces.weight[present], scalar)
        inverse = np.broadcast_to(1.0 / model.row_of("mass"), (len(model.row_of("mass")), model.particle_count))
        mobility = (surfaces.weight**2 * inverse[:, surfaces.particle]).sum(axis=2)
        data.mobility = each.by_row(mobility, scalar)
        first, near = neighbourhoods(surfaces, hops_apart(surfaces, rules, kind, rule))
        data.first_near, data.near = each.starts(np.diff(first)), each.alike(near, int, vertices)
        data.body_of = each.alike(surfaces.body, int, bodies)
        start = np.einsum("vk,rvkd->rvd", surfaces.weight, model.row_of("position")[:, surfaces.particle])
        for name in ("x", "v", "x_found"):
            setattr(data, name, in_records(worlds * vertices, model.dim, scalar, device))
        wp.copy(data.x, each.by_row(start.astype(dtype), model.vector))
        data.force = wp.zeros((worlds * vertices, 3), dtype=wp.int64, device=device)
        data.ends, data.share = each.alike(surfaces.ends, wp.vec2i, vertices), each.alike(surfaces.share, scalar)
        data.body = each.alike(surfaces.body[surfaces.ends[:, 0]], int, bodies)
        data.tangential_displacement = wp.zeros((HISTORY, worlds * points), dtype=model.vector, device=device)
        data.initial_overlap = wp.zeros(worlds * points, dtype=scalar, device=device)
        data.contact_body = wp.full((HISTORY, worlds * points), -1, dtype=int, device=device)
        data.contact_side = wp.zeros((HISTORY, worlds * points), dtype=int, device=device)
        # Of itself a sheet is on both sides.
        sided = surfaces.sided & (bodies > 1)
        self._sided = bool(sided.any())
        data.sided = each.alike(sided.astype(np.int32), int)
        data.overrun = wp.zeros(NOTED, dtype=wp.float64, device=device)
        self._triangles = bool((surfaces.corner[:, 1] != surfaces.corner[:, 2]).any())
        self._noted = wp.empty_like(data.overrun, device="cpu", pinned=True) if device.is_cuda else data.overrun
        data.corner = each.alike(surfaces.corner, wp.vec3i, vertices)
        data.owner = each.alike(surfaces.body[surfaces.corner[:, 0]], int, bodies)
        data.kind, data.closed = each.alike(kind, int), each.alike(surfaces.closed.astype(np.int32), int)
        # A lattice is one spacing thick at least: what is past its middle has come from the other side.
        depth = [np.where(one.closed | sided, 0.5 * one.spacing, 0.0) for one in by_row]
        on_vertices = np.bincount(surfaces.body, minlength=bodies)
        carriers = np.unique(surfaces.particle[surfaces.weight != 0])
        carrying = np.bincount(surfaces.body_of_particle[carriers], minlength=bodies)
        on_points = np.bincount(surfaces.body[surfaces.ends[:, 0]], minlength=bodies)
        density = np.minimum(carrying, on_vertices) / np.maximum(on_points, 1)
        for name, values in (
            ("depth", depth),
            ("stiffness", [one.stiffness for one in by_row]),
            ("density", [density]),
            ("radius", [one.radius for one in by_row]),
        ):
            setattr(data, name, each.by_row(np.array(values), scalar))
        data.rule = wp.array(rule, dtype=int, device=device)
        data.among = wp.array([int(one.self_contact) for one in rules], dtype=int, device=device)
        for name, values in (
            ("friction", [one.friction for one in rules]),
            ("damping", [one.damping_ratio for one in rules]),
            ("thickness", [-1.0 if one.thickness is None else one.thickness for one in rules]),
            ("given", [-1.0 if one.stiffness is None else one.stiffness for one in rules]),
        ):
            setattr(data, name, wp.array(values, dtype=scalar, device=device))
        given = [one.thickness for one in rules if one.thickness is not None]
        own = [2.0 * float(one.radius.max(initial=0.0)) if len(given) < len(rules) else 0.0 for one in by_row]
        thickest = max(*own, *given, 0.0)
        reach = [max(wide, float(one.max(initial=0.0)), *given, 0.0) for wide, one in zip(own, depth, strict=True)]
        self._farthest = max(thickest, *(float(one[surfaces.closed].max(initial=0.0)) for one in depth))
        self.blocks = blocks_by_row(
            model, by_row, lambda mass, one: contact_blocks(mass, one, rules, kind, rule, density)
        )
        """What it adds to the blocks of K [N/m] and B [N s/m] of each particle, as numbers, of each world."""

        self.piece = body_contact_term(model.dim, scalar, model.compensated)
        self.data = self.piece.Data()
        order, first = rows(surfaces.particle[present], model.particle_count)
        self.members = np.diff(first) > 0
        self.data.first = wp.array(first, dtype=int, device=device)
        vertex = np.repeat(np.arange(vertices), present.sum(axis=1))
        self.data.vertex = wp.array(vertex[order], dtype=int, device=device)
        self.data.weight = wp.array(surfaces.weight[present][order], dtype=scalar, device=device)
        self.data.force = data.force
        self.impulse = wp.zeros(model.particle_count, dtype=wp.vec3d, device=device) if contact_forces else None
        """What other bodies have pushed each particle with since it was zeroed [N s]; None where nobody asks."""
        given = [one.stiffness or 0.0 for one in rules]
        stiffest = [max(float(one.stiffness.max(initial=0.0)), *given) for one in by_row]
        # Powers of 2: what is divided by them keeps all of its digits.
        least = [max(k * far * UNITS, 1e-99) for k, far in zip(stiffest, reach, strict=True)]
        units = [2.0 ** np.floor(np.log2(one)) for one in least]
        self.data.unit = units[0]
        if model.in_worlds:
            data.bodies_each, data.unit = bodies, each.by_row(np.array(units)[:, None], wp.float64)
        self._neighbors = NeighborList(model, surfaces, data, self._farthest, thickest, self._sided)
        self._neighbors.rebuild_interval = self.rebuild_interval
        self._flags, self._nowhere = self._neighbors.flags, wp.zeros(0, dtype=wp.float64, device=device)
        self._found = wp.empty_like(self._flags, device="cpu", pinned=True) if device.is_cuda else self._flags
        self._overrun = np.zeros(NOTED)
        self.deepest = 0.0
        """The deepest overlap in the frame looked at last [m]."""
        self.shared_points = points
        self._sink()

    def _sink(self) -> None:
        """Find out which points start inside other bodies, and let them stay there for a moment."""
        model, data = self._model, self._data
        self._overlapping_at_start, self._overlapping = False, None
        found = self._sunken()
        if found is None:
            return
        bodies, deepest, points, deep = found
        allowed = np.zeros(len(data.share))
        allowed[points] = deep
        data.initial_overlap.assign(allowed.astype(model.dtype))
        self._overlapping_at_start, data.overlap_release_speed = True, deepest / SEPARATION_TIME
        self.done = data.done = wp.zeros(len(allowed), dtype=wp.float64, device=model.device)
        self._overlapping = led_apart(self._surfaces, bodies, deepest, len(points), SEPARATION_TIME)

    def _sunken(self) -> tuple[tuple[int, int], float, NDArray, NDArray] | None:
        """Return the bodies that overlap most at the start, by how much, all points that do, and theirs [m].

        None where none do but by touching.
        """
        model, data, surfaces = self._model, self._data, self._surfaces
        x = model.vectors()
        x.assign(model.system.position.astype(model.dtype))
        stored = self._stored_and_heated(x, model.vectors())[0].numpy()
        points = np.flatnonzero(stored)
        if not len(points):
            return None
        a, b = data.body.numpy()[points], data.candidate_body.numpy()[points, 0]
        kind = data.kind.numpy()
        k = stiffness_of_pairs(surfaces, self._rules, data.rule.numpy()[kind[a], kind[b]], a, b)
        deep = np.sqrt(2 * stored[points] / (k * data.density.numpy()[a]))
        p = int(np.argmax(deep))
        if not deep[p] > OVERLAP * max(surfaces.spacing[a[p]], surfaces.spacing[b[p]], self._farthest):
            return None
        return (int(a[p]), int(b[p])), float(deep[p]), points, deep

    def overlapping(self) -> str | None:
        """Return words about the bodies that overlap most at the start; None where none do but by touching."""
        kind, rule = self._data.kind.numpy(), self._data.rule.numpy()
        return initial_containment(self._model.system, self._surfaces, kind, rule) or self._overlapping

    def go_on_from(self, other: Effect) -> None:
        """Let points stick to what they stuck to in another model of the same bodies."""
        assert isinstance(other, BodyContact)
        if other._data.contact_body.shape == self._data.contact_body.shape:
            wp.copy(self._data.tangential_displacement, other._data.tangential_displacement)
            wp.copy(self._data.contact_body, other._data.contact_body)
            wp.copy(self._data.contact_side, other._data.contact_side)

    def use_partition(self, partition: Launcher | None) -> None:
        """Have threads of the CPU share the search and the contacts, where there are several."""
        self._neighbors.partition = partition

    def begin(self, substeps: int, dt: float) -> None:
        """Take the length of substeps."""
        self._dt = dt

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """Make room for the facets near each point: what is searched between frames is not searched again."""
        self._neighbors.make_room(x, v)

    def search(self, x: wp.array, v: wp.array, compensation: Any, within: bool) -> None:
        """Launch what lists the facets near each point."""
        self._neighbors.search(x, v, compensation, within)

    @property
    def vertices(self) -> tuple[wp.array, wp.array]:
        """Where vertices were placed last [m], and how fast they moved [m/s], both of shape [vertex_count]."""
        return self._data.x, self._data.v

    def place_vertices(self, x: wp.array, v: wp.array) -> None:
        """Launch what puts vertices where particles at x are, which move at v, between frames."""
        self._neighbors.place(x, v, None, self._neighbors.unread)

    def begin_substep(self, substep: int) -> bool:
        """Take the time of what is launched in a substep."""
        self._neighbors.now = substep * self._dt
        return False

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the contacts of particles at x that move at v."""
        self._neighbors.place(x, v, compensation)
        lag = self._dt if self.steps.lagging else 0.0
        self._evaluate(False, [self._dt if begins else 0.0, lag], [self._nowhere, self._nowhere])

    def _evaluate(self, measuring: bool, times: list[float], sums: list[wp.array]) -> None:
        """Launch a kernel over the points that are near anything, which adds up their forces or measures."""
        model, data = self._model, self._data
        lanes = 1
        if model.device.is_cuda:
            lanes = ON_GPU if self._triangles or measuring else FEW_ON_GPU
        inputs = [data, *times, 1.0 / self.data.unit, self._neighbors.buffer]
        many = lanes * len(data.share)
        at_a_time = model.device.sm_count * BLOCKS * BLOCK  # on a GPU: more threads would only begin and end
        if self._triangles or measuring:
            kernel = contact_energy if measuring else evaluate_contact
            composed = kernel(model.scalar, self._overlapping_at_start, self._sided, lanes, model.in_worlds)
        else:
            composed, sums = (
                evaluate_segments_and_spheres(model.scalar, self._overlapping_at_start, lanes, model.in_worlds),
                [],
            )
        self._neighbors.share(composed, many, inputs, [self._flags, *sums], at_a_time, BLOCK)

    def add_up(self, seconds: float) -> None:
        """Launch the sum of what bodies push each other's particles with, where that is asked for."""
        model = self._model
        if self.impulse is not None:
            kernel = add_impulses(model.dim, model.scalar, model.compensated)
            wp.launch(kernel, model.particle_count, [self.data, seconds], [self.impulse], device=model.device)

    def look(self) -> None:
        """Launch what tells whether lists held."""
        if self._found is not self._flags:
            wp.copy(self._found, self._flags)
            wp.copy(self._noted, self._data.overrun)
            self._flags.zero_()
            self._data.overrun.zero_()

    def is_void(self) -> bool:
        """Tell whether lists held in the frame that was waited for; if not, make room for it to be repeated."""
        flags = self._found.numpy().copy()
        self.deepest, self._overrun = float(flags[DEEPEST]), np.array(self._noted.numpy(), dtype=np.float64)
        if self._found is self._flags:
            self._flags.zero_()
            self._data.overrun.zero_()
        void = self._neighbors.judge(flags, self.steps.substeps)
        self.rebuild_interval = self._neighbors.rebuild_interval
        return void

    def warnings(self) -> str | None:
        """Return words about the first contact that was overrun in the frame that was waited for."""
        found = Tunnelling.of(self._overrun, self._data, self._surfaces, self._rules)
        return found and found.described(self._model.system, self._surfaces, self.steps.substeps, self._dt)

    @property
    def changing(self) -> list[wp.array]:
        """How points stick, and on which sides of sheets they are."""
        return [
            self._data.tangential_displacement,
            self._data.contact_body,
            self._data.contact_side,
            self._data.initial_overlap,
        ]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return how points stick, and on which sides of sheets they are."""
        names = ["tangential_displacement", "contact_body"]
        names += ["contact_side"] if self._sided else []
        names += ["initial_overlap"] if self._overlapping_at_start else []
        arrays = {f"touch.{STORED[name]}": getattr(self._data, name).numpy().copy() for name in names}
        if self._overlapping_at_start:
            arrays["touch.outwards"] = np.array([self._data.overlap_release_speed])
        return arrays

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Take back what `checkpoint` gave."""
        self._data.tangential_displacement.assign(arrays["touch.slip"])
        self._data.contact_body.assign(arrays["touch.partner"])
        if "touch.seen" in arrays:  # files of earlier versions have none
            self._data.contact_side.assign(arrays["touch.seen"])
        else:
            self._data.contact_side.zero_()
        self._overlapping_at_start = "touch.allowed" in arrays
        self._model.generation += 1  # it launches other kernels
        if self._overlapping_at_start:
            self._data.initial_overlap.assign(arrays["touch.allowed"])
            self._data.overlap_release_speed = float(arrays["touch.outwards"][0])

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add what contacts hold particles with: all points of a surface may be in contact at a time."""
        for blocks, each in zip((stiffness, damping), self.blocks, strict=True):
            blocks.assign(blocks.numpy() + each[0, :, None, None] * np.eye(self._model.dim))

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what contacts store [J], and what they turn to heat [W], by world."""
        each = (one.numpy().reshape(self._model.worlds, -1) for one in self._stored_and_heated(x, v))
        energies, powers = (one.sum(axis=1) for one in each)
        return energies, powers

    def _stored_and_heated(self, x: wp.array, v: wp.array) -> list[wp.array]:
        """Return what the contacts of each point store [J], and turn to heat [W]."""
        self.search(x, v, None, False)
        count, device = len(self._data.share), self._model.device
        sums = [wp.zeros(count, dtype=wp.float64, device=device) for _ in range(2)]
        self._evaluate(True, [0.0, 0.0], sums)
        return sums
