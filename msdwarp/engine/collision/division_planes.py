"""DivisionPlanes: keeps near pairs apart if they are apart when a substep begins."""

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces
from ...kernels.collision.contact_data import Motion, NearPairs
from ...kernels.collision.division_planes import (
    CUTS,
    MOST_THREADS,
    ROUNDS,
    catch_up,
    end_round,
    hold_particles,
    keep_apart,
    mark_held,
    truncate_displacements,
)
from ...kernels.collision.near_pairs import clear_pairs
from ...kernels.collision.pair_gaps import find_alarm, measure_pairs
from ...kernels.collision.pair_impulses import find_violations, move_pushed, push_pairs
from ...kernels.collision.pair_search import find_near_facets, find_pairs, list_tests
from ...kernels.collision.pairs import FAR
from ...kernels.collision.tangles import find_tangles
from ...kernels.lanes import WARP
from ..model.effect import Effect
from ..model.model import Model
from ..model.state import Instant
from .contact_rules import ContactRules, unit_of_sums
from .contact_surfaces import ContactSurfaces, parts_of_facets
from .room import check_room, room_for_pairs
from .tables_by_world import Repeated

LEAST_GAP = 1e-3
"""The least gap, as a fraction of the thickness of contact; without it rounding would finally close gaps."""
FLOOR = 0.1
"""Fraction of its thickness below which a pair loses nothing more of its gap in a substep."""
ACTIVATION = 0.25
"""Pairs with larger gaps, as fractions of the thickness, are ignored: contact forces act long before."""
ROOM = 4
"""Initial room for near pairs, as a multiple of the number of vertices."""
LEAST_ROOM = 2**13
"""Initial room for pairs of solid bodies."""
SIZE_OF_FACETS, SIZE_OF_PAIR, SCALARS_OF_PAIR = 32, 32, 14
"""Bytes in the lists for two facets near each other, and for a near pair, which also has numbers."""
MOST_IN_CLUSTER = 2**15
"""With more pairs each kernel is a launch, since a cluster has too few threads."""
CLUSTER = 8
"""Blocks in the cluster that runs all of them in one launch."""
SURPRISED = 4
"""Frames for which all near pairs are measured after something has moved further than it was expected to."""
QUIET = 60
"""After this many frames in which no pair came too near, no launch keeps pairs apart until one does."""
NEAR_A_FACET = 8
"""Initial room for facets near each other, and for the tests that they need, as a multiple of the number of
facets."""
FEW_LEAVES, FEW_BY_WARPS = 2**10, 4
"""Up to this number of leaves of the tree a GPU searches by this many warps for each, else by one."""
MOST_TESTING = 2**18
"""Maximal number of threads that test near facets."""
PAIR_THREADS = 2**16
"""Maximal number of GPU threads that divide the pairs: with more, launches take longer if nothing is near."""

PUSHING, CUTTING = (find_violations, push_pairs, move_pushed), (truncate_displacements, mark_held, hold_particles)
"""The kernels of a round of impulses, and of one that truncates displacements and its end."""


class DivisionPlanes(Effect):
    """Near pairs of vertices and triangles or of edges, and planes between them.

    See `kernels.collision.division_planes`. `find` lists pairs when points' neighbours are listed. `contact` is
    the device's struct of contact; `impulse` sums the contact impulses on particles [N s], None if not requested.
    """

    term = data = None

    def __init__(
        self,
        model: Model,
        surfaces: ContactSurfaces,
        contact: Any,
        each: Repeated,
        rules: ContactRules,
        impulse: wp.array | None,
    ) -> None:
        self._model, self._contact, on_host = model, contact, surfaces.on_host
        self.neighbors: Any = None
        """The `NeighborList` that pairs are listed with."""
        self.tangles = False
        """Whether anything crossed at the start, or was inside another body."""
        self._grains, drawn = surfaces.grains, surfaces.data
        thick = np.concatenate([rules.thickness, *(2.0 * one.radius for one in surfaces.by_row)])
        thickness = float(thick[thick > 0].min(initial=thick.max()))  # the smallest thickness of any contact
        self.least_gap = LEAST_GAP * thickness
        self.activation = ACTIVATION * thickness
        scalar, device = model.scalar, model.device
        data = self.pairs = NearPairs(scalar)()
        edge, owned, points = edges(on_host)
        vertices, particles = len(on_host.particle), model.worlds * model.stride
        data.edge, data.owned = each.alike(edge, wp.vec2i, vertices), each.alike(owned, int)
        data.points = each.alike(np.where(points < 0, -(2**30), points), int, len(on_host.ends))  # below 0 in all
        data.rank = each.alike(ranks(surfaces, edge), int)
        data.first_particle, data.particle_of, data.weight = drawn.first, drawn.particle, drawn.weight
        data.mobility, data.body_of, data.tangled = drawn.mobility, drawn.body_of, drawn.tangled
        counts = np.diff(data.first_particle.numpy())
        of_vertex = np.repeat(np.arange(len(counts)), counts)
        data.most_weight = float(np.bincount(of_vertex, np.abs(data.weight.numpy())).max())
        data.test_counts = wp.zeros(2, dtype=int, device=device)
        numbers = (
            "count",
            "near_facet_count",
            "particle_count",
            "pushing_count",
            "tangles",
            "violated",
            "cutting",
            "exceeded",
        )
        for name in numbers:
            setattr(data, name, wp.zeros(1, dtype=int, device=device))
        signals = "may_meet", "alarm", "many", "watched_count", "round"
        self._signals = wp.zeros(len(signals), dtype=int, device=device)  # cleared together
        for k, name in enumerate(signals):
            setattr(data, name, self._signals[k : k + 1])
        data.unsettled = wp.zeros(model.worlds, dtype=int, device=device)
        data.in_pair, data.particle, data.pushes, data.held = (
            wp.zeros(particles, dtype=int, device=device) for _ in "ipph"
        )
        data.impulse = wp.zeros((particles, 3), dtype=wp.int64, device=device)
        data.truncation, data.shift = (wp.full(particles, one, dtype=float, device=device) for one in (1.0, 0.0))
        mass, data.inverse_mass = model.row_of("mass"), contact.surfaces.inverse_mass
        data.anchored = each.by_row(np.array([[int(np.isinf(one).any())] for one in mass]), int)
        data.driven = each.alike(np.flatnonzero(model.driven), int, model.stride)
        if model.driven.any():
            self.done = data.done = wp.zeros(particles, dtype=wp.float64, device=device)
        if impulse is not None:
            data.contact_impulse = impulse
        data.kind, data.rules = contact.rules.kind, contact.rules.table
        data.restitution = wp.array(rules.restitution, dtype=scalar, device=device)
        half = [np.where(one.radius > 0.0, one.radius, 0.5 * rules.thickness.max()) for one in surfaces.by_row]
        data.floor = each.by_row(FLOOR * np.array(half), scalar)
        heaviest = float(mass[np.isfinite(mass)].max(initial=0.0))
        self.per_unit = 1.0 / unit_of_sums(heaviest * thickness)
        # Solid bodies seldom come so near each other that pairs must be kept apart.
        self.may_sleep, self._quiet, self._surprised = bool(on_host.solid.all()), 0, 0
        self.awake = not self.may_sleep
        """Whether pairs are kept apart in the coming frame; if wrongly not, the frame is repeated."""
        self._measure: Any = measure_pairs(scalar, self.may_sleep)
        self._give_room(LEAST_ROOM if self.may_sleep else ROOM * model.worlds * (vertices + len(edge)))

    def begin(self, substeps: int, dt: float) -> None:
        """Note the kernels that keep pairs apart, which any frame may need, and load them on a CPU.

        They are noted here and not in the constructor, so that for a GPU they compile together with the kernels of
        substeps, and the search for neighbors before the first frame does not wait for them.
        """
        model, note, scalar = self._model, self._model.kernels.note, self._model.scalar
        note(self._keep, block=MOST_THREADS, first=True)
        note(self._measure)
        if self.may_sleep:
            note(find_alarm(scalar))
        if len(self.pairs.driven):
            note(catch_up(scalar))
        if not self._small:
            note(*(one(scalar) for one in (*PUSHING, *CUTTING)), block=MOST_THREADS)
            note(end_round(scalar))
        if self.may_sleep and not model.device.is_cuda:
            for kernel in (self._measure, self._keep):
                wp.load_module(kernel.module, model.device)

    def meet(self, neighbors: Any) -> None:
        """Set the `NeighborList` whose searches also list pairs."""
        self.neighbors = weakref.proxy(neighbors)  # which owns this: memory of a device is to be freed at once
        facets, leaves = len(neighbors.tree.facet), len(neighbors.tree.leaf)
        self._warps = FEW_BY_WARPS if leaves <= FEW_LEAVES else 1
        self._by_warps = self._model.device.is_cuda and not self._grains
        self._searching = self._warps * WARP * leaves if self._by_warps else facets
        """Threads that list near facets: some warps for each leaf of the tree, or one for each facet."""
        self._give_room_to_facets(NEAR_A_FACET * facets)
        scalar = self._model.scalar
        self._model.kernels.note(*self._searches(), clear_pairs(scalar), find_tangles(scalar, neighbors.lanes))

    def _searches(self) -> tuple[Any, Any, Any]:
        """Return the kernels that list near facets, their tests and near pairs."""
        scalar = self._model.scalar
        near = find_near_facets(scalar, self._by_warps, self._grains)
        return near, list_tests(scalar), find_pairs(scalar, self.tangles)

    def find(self, frame_begins: bool) -> None:
        """Launch the listing of near pairs with the tree of the `NeighborList`, before its search.

        Surfaces that have crossed since the start are detected only where a frame begins.
        """
        data, model, neighbors = self.pairs, self._model, self.neighbors
        neighbors.launch(clear_pairs(model.scalar), len(data.in_pair), [data], [])
        if self.tangles and frame_begins:
            self._find_tangles()
        near, tests, pairs = self._searches()
        flags = [neighbors.flags]
        neighbors.launch_parts(
            near, self._searching, [self._contact, neighbors.tree, data, self.activation, self._warps], flags
        )
        threads = WARP * -(-len(data.near_facets) // WARP)  # those of a warp work together
        for kernel in (tests, pairs):
            neighbors.launch_parts(kernel, threads, [self._contact, data, self.activation], flags, MOST_TESTING)

    def start(self) -> None:
        """Exclude surfaces that cross each other at the start, until they have separated."""
        self._find_tangles()
        self.tangles = bool(self.pairs.tangles.numpy()[0])
        self._model.kernels.note(*self._searches())

    def _find_tangles(self) -> None:
        pairs, neighbors = self.pairs, self.neighbors
        pairs.tangled.zero_()
        inputs, lanes = [self._contact, neighbors.tree, pairs], neighbors.lanes
        neighbors.launch_parts(find_tangles(self._model.scalar, lanes), lanes * len(pairs.edge), inputs, [])

    def watch(self) -> None:
        """Launch the test whether surfaces may come so near that their pairs must be kept apart."""
        if self.may_sleep:
            kernel, neighbors = find_alarm(self._model.scalar), self.neighbors
            # What gets its speed within a substep is foretold by no distance: then all pairs are measured.
            within = self.activation if self._surprised == 0 else FAR
            inputs = [self._contact, self.pairs, within, neighbors.dt]
            neighbors.launch_parts(kernel, len(self.pairs.vertices), inputs, [neighbors.flags], PAIR_THREADS)

    def end_substep(self, before: Instant, after: Instant, substep: int) -> None:
        """Launch the kernels that keep near pairs apart, at the end of a substep.

        At a frame's end it also launches the test of motion that shows whether lists were valid.
        """
        model, neighbors, steps = self._model, self.neighbors, self.steps
        if self.awake:
            if len(self.pairs.driven):
                outputs = [after.x, after.v]
                inputs = [self.pairs, before.x, steps.dt, self.least_gap]
                neighbors.launch(catch_up(model.scalar), len(self.pairs.driven), inputs, outputs)
            measured = [self.pairs, before.x, after.x, self.least_gap, self.activation]
            neighbors.launch_parts(self._measure, len(self.pairs.vertices), measured, [], PAIR_THREADS)
            self._keep_apart(before, after)
        if substep + 1 == steps.substeps:  # otherwise the next substep tests it
            neighbors.place(after.x, after.v, after.compensation)

    def _keep_apart(self, before: Instant, after: Instant) -> None:
        model, device, neighbors, pairs = self._model, self._model.device, self.neighbors, self.pairs
        motion: Any = Motion(model.scalar)()
        motion.x, motion.x_out, motion.v_out, motion.h = before.x, after.x, after.v, self.steps.dt
        motion.per_unit, motion.activation, motion.particles = self.per_unit, self.activation, model.stride

        def launch(kernel: Any, threads: int, *numbers: int, flags: Sequence[wp.array] = ()) -> None:
            given = [pairs, motion, *numbers, threads]
            wp.launch(kernel, threads, given, list(flags), device=device, block_dim=MOST_THREADS)

        def launch_all() -> None:
            threads = self._blocks * MOST_THREADS if device.is_cuda else 1
            most = 2**31 - 1 if self._small else MOST_IN_CLUSTER
            launch(self._keep, threads, most, ROUNDS, CUTS, flags=[neighbors.flags])

        def launch_each() -> None:
            wp.capture_while(pairs.many, launch_round)
            truncate, mark, hold = (one(model.scalar) for one in CUTTING)
            for number in range(CUTS):
                launch(truncate, PAIR_THREADS, number)
                if number < CUTS - 1:
                    launch(mark, PAIR_THREADS, number)
            launch(hold, PAIR_THREADS, flags=[neighbors.flags])

        def launch_round() -> None:
            for one in PUSHING:
                launch(one(model.scalar), PAIR_THREADS, -1)
            wp.launch(end_round(model.scalar), 1, [pairs], device=device)

        # A single CPU thread handles all pairs.
        neighbors.launcher.launch_parts(lambda part, _: launch_all() if part == 0 else None)
        if not self._small:
            wp.capture_if(pairs.many, launch_each)
            self._signals.zero_()

    @property
    def recorded_for(self) -> tuple[bool, bool]:
        """What recorded launches depend on: whether pairs are kept apart, and whether all of them are measured."""
        return self.awake, self._surprised > 0

    def judge(self, pairs: int, held: bool) -> bool:
        """Decide whether coming frames keep pairs apart; return whether the finished frame must be repeated.

        `pairs` is 0, or the number of near pairs if surfaces might meet in the frame or the list had no room for
        all pairs. Without room, the repeated frame decides. `held` tells whether neighbor lists held: whether
        nothing moved further than expected.
        """
        if self.may_sleep:
            self._surprised = max(0, self._surprised - 1) if held else SURPRISED
        if pairs > len(self.pairs.vertices):
            return True
        missed = pairs > 0 and not self.awake
        self._quiet = 0 if pairs else self._quiet + 1
        self.awake = pairs > 0 or not held or not self.may_sleep or (self.awake and self._quiet < QUIET)
        return missed

    def extend(self, pairs: int, near_facets: int) -> bool:
        """Make room for more near pairs and near facets; return False, and do nothing, if they fit."""
        fit = pairs <= len(self.pairs.vertices), near_facets <= len(self.pairs.near_facets)
        if not fit[0]:
            self._give_room(room_for_pairs(pairs))
        if not fit[1]:
            self._give_room_to_facets(room_for_pairs(near_facets))
        return not all(fit)

    def _give_room_to_facets(self, room: int) -> None:
        data, device = self.pairs, self._model.device
        check_room("too many facets are near each other", room, SIZE_OF_FACETS, device)
        data.near_facets = wp.zeros(room, dtype=wp.vec2i, device=device)
        data.point_tests, data.edge_tests = (wp.zeros(room, dtype=wp.vec3i, device=device) for _ in "pe")
        self._model.generation += 1

    def _give_room(self, room: int) -> None:
        data, device, scalar = self.pairs, self._model.device, self._model.scalar
        room = int(room)
        scalars = wp.types.type_size_in_bytes(scalar) * SCALARS_OF_PAIR
        check_room("too many vertices and edges are near others", room, SIZE_OF_PAIR + scalars, device)
        data.vertices = wp.zeros(room, dtype=wp.vec4i, device=device)
        data.watched, data.pushing = (wp.zeros(room, dtype=int, device=device) for _ in "wp")
        data.weights, data.pushed = (wp.zeros(room, dtype=wp.types.vector(4, scalar), device=device) for _ in "wp")
        data.normal = wp.zeros(room, dtype=self._model.vector, device=device)
        data.bodies = wp.zeros(room, dtype=wp.vec2i, device=device)
        for name in ("gap", "least", "change"):
            setattr(data, name, wp.zeros(room, dtype=scalar, device=device))
        self._small = not device.is_cuda or room <= MOST_IN_CLUSTER
        self._blocks = CLUSTER if device.is_cuda and device.arch >= 90 else 1
        self._keep: Any = keep_apart(scalar, self._blocks)
        data.count.zero_()
        self._model.generation += 1


def edges(surfaces: TouchingSurfaces) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    """Return the edges of surfaces, and the facet to which each vertex and each edge belongs.

    A vertex or an edge belongs to the first facet around it, so that each is tested once. A grain (a particle that
    is a facet) counts as an edge with two equal ends.

    Returns
    -------
    edge
        The vertices at the ends of each edge, shape [edge_count, 2].
    owned
        Bits for the corners (0 to 2) and the sides (3 to 5) that belong to each facet, shape [facet_count].
    points
        The contact point on each corner and side of each facet, below 0 without one, shape [6 facet_count].
    """
    corner, (part, points) = surfaces.corner, parts_of_facets(surfaces)
    number, first = np.unique(part, return_index=True)
    facet, k = np.divmod(first[number >= 0], 6)
    owned = np.zeros(part.shape, dtype=np.int64)
    owned[facet, k] = 1 << k
    facet, k = facet[k >= 3], k[k >= 3] - 3
    edge = np.sort(np.stack([corner[facet, k], corner[facet, (k + 1) % 3]], axis=1), axis=1)
    return edge, owned.sum(axis=1), points.reshape(-1)


def ranks(surfaces: ContactSurfaces, edge: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the rank of each body by the mean length of its edges at the start, 0 for the shortest."""
    on_host, x = surfaces.on_host, surfaces.data.x.numpy()
    length = np.linalg.norm(x[edge[:, 1]] - x[edge[:, 0]], axis=1)
    body, bodies = on_host.body[edge[:, 0]], len(on_host.solid)
    mean = np.bincount(body, length, bodies) / np.maximum(np.bincount(body, minlength=bodies), 1)
    return np.argsort(np.argsort(mean, kind="stable"), kind="stable").astype(np.int32)
