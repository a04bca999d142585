"""NeighborList: lists of the facets near each contact point, which are valid for some substeps.

The device decides when to search; `skin.py` chooses the margin of a search.
`simulation/stepping.py` repeats a frame whose lists became invalid or had no room.
"""

from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import places_along_curve
from ...kernels.collision.contact_data import (
    ACTIVE,
    FLAGS,
    FORCED,
    LONGEST_ROW,
    MOST_BODY_PAIRS,
    MOVED,
    NEAR_FACETS,
    NEAR_PATH,
    PAIRS,
    PATH,
    Pair,
)
from ...kernels.collision.facet_tree import begin_search, box_facets, box_neighbours, find_roots
from ...kernels.collision.neighbor_search import BLOCK, find_candidates, find_rows, range_of_speeds
from ...kernels.collision.segments_and_spheres import find_rows_of_grains
from ...kernels.collision.vertices import place_vertices
from ...kernels.compensation import compensated_sum
from ...kernels.lanes import WARP
from ..device.launcher import Launcher
from ..device.vector_arrays import in_records
from ..model.model import Model
from .contact_surfaces import ContactSurfaces
from .division_planes import DivisionPlanes
from .facet_tree import facet_tree, near_together
from .overruns import Overruns
from .room import ROOM_TO_SPARE, check_room, room_for
from .skin import ALLOWANCE, CHECK_EVERY, LEAST_ALLOWANCE, NARROWER, Skin
from .tables_by_world import Repeated
from .torn_facets import TornFacets

MOST_BODIES, MOST_BODIES_ON_GPU = 64, 4096
"""Bodies of a world, up to which all pairs of them are tested; more are searched by a tree."""
MOST_BY_WARPS, LANES_OF_MANY = 2**15, 8
"""Up to this number of points a warp of a GPU searches for each point, body or facet; else this many threads."""
MOST_SEARCHING = 2**20
"""Threads on a GPU that search for points: most points of large bodies are near nothing."""
MORTON_BITS = 16
"""Cells along each axis in which places are sorted, as a power of 2."""
ROOM = 32
"""Initial room for facets in a row, and for bodies near a body."""
LONGEST_PATH = 64.0
"""A body that moves this multiple of its spacing, or of the contact distance, in a substep has diverged, or is too
fast for contact."""
MOST_THREADS = 2**14
"""Threads on a GPU that examine the active points."""
MOST_SLACK = 4.0
"""Largest slack of a fast vertex, over the largest width of the skin: what diverges must not be near all. Vertices
that have moved further get more."""


class NeighborList:
    """Lists the facets near each point.

    A list is valid until a vertex has moved by more than its slack: half of the skin, or more if it is fast or its
    body is near no other. The device rebuilds the lists when it places vertices and one is about to move that far.
    A frame must be repeated if lists had no room, or if a vertex was faster than expected. Listed facets without
    contact change nothing: results depend neither on the skin nor on how often lists are rebuilt.

    It replaces arrays that recorded launches write to, and then increases `Model.generation`.

    Its arrays are the `neighbors` of `contact`, the struct of contact on the device; `planes` lists near pairs;
    `thickest` is the largest distance at which a facet pushes a point [m].
    """

    def __init__(
        self,
        model: Model,
        surfaces: ContactSurfaces,
        contact: Any,
        each: Repeated,
        planes: DivisionPlanes,
        thickest: float,
    ) -> None:
        self._model, self._contact, self.data = model, contact, contact.neighbors
        on_host, data = surfaces.on_host, self.data
        scalar, device = model.scalar, model.device
        bodies, self._points = model.worlds * len(on_host.solid), model.worlds * len(on_host.ends)
        self.farthest = thickest
        """The largest distance of any contact [m]."""
        spacing = on_host.spacing[on_host.spacing > 0]
        self.skin = Skin(thickest, float(spacing.min()) if len(spacing) else 0.0, model)
        self.longest_path = LONGEST_PATH * max(thickest, float(spacing.max(initial=0.0)))
        """A body has diverged, or is too fast for contact, if it moves further in a substep [m]."""
        self.path = self.too_far = 0.0
        """The longest path of a vertex in a substep of the last frame [m]; `too_far`: if it is too long."""
        self.active = 0
        """Points that had facets near them in the last frame."""
        self.launcher = Launcher()
        self.torn: TornFacets | None = None
        """Leaves out torn facets where a frame begins; None if nothing can tear."""
        self.dt, self.substep = 0.0, 0
        """Length of a substep [s], and the number of the coming one."""
        self.flags: Any = wp.zeros(model.worlds * FLAGS, dtype=float, device=device)
        """Flags set by launches since they were last read, by world: see `kernels.collision.contact_data`."""
        owner, x_first = surfaces.data.owner.numpy(), surfaces.data.x.numpy()[: len(on_host.particle)]
        a, b = (x_first[end] for end in on_host.ends.T)
        on_curve = places_along_curve(a + on_host.fraction[:, None] * (b - a), MORTON_BITS)
        in_order = np.lexsort([on_curve, surfaces.body_of_point]).astype(np.int32)
        data.in_order = each.alike(in_order, int, len(on_host.ends))
        data.x_found = in_records(len(surfaces.data.x), model.dim, scalar, device)
        data.since = wp.zeros(1, dtype=float, device=device)
        data.due = wp.full(1, FORCED, dtype=int, device=device)
        self._warp = WARP if device.is_cuda else 1
        self._grains = surfaces.grains
        many = self._points > MOST_BY_WARPS or self._grains
        self.lanes = min(self._warp, LANES_OF_MANY) if many else self._warp
        corner = on_host.corner
        in_one = near_together(x_first[corner].mean(axis=1), surfaces.body_of_facet)
        order = (len(corner) * np.arange(model.worlds)[:, None] + in_one).reshape(-1)
        self.tree = facet_tree(order, owner, bodies, device)
        data.candidate_count, data.near_own, data.search_points, data.active_points = (
            wp.zeros(self._points, dtype=int, device=device) for _ in "lncb"
        )
        data.search_point_count, data.active_count = (wp.zeros(1, dtype=int, device=device) for _ in "cb")
        data.slowest, data.fastest = (wp.zeros(1, dtype=wp.vec3, device=device) for _ in "sf")
        data.body_pair_count = wp.zeros(bodies, dtype=int, device=device)
        data.moved, data.spare = (wp.zeros(bodies, dtype=float, device=device) for _ in "ms")
        data.slack = wp.zeros(len(data.x_found), dtype=float, device=device)
        slacks = MOST_SLACK * self.skin.widest, 0.5 * self.skin.least, self.longest_path
        self.overruns = Overruns(model, len(data.x_found), *slacks)
        data.overrun, data.started = self.overruns.least, self.overruns.started
        data.facet_slack = wp.zeros(len(owner), dtype=scalar, device=device)
        self._binary: wp.Bvh | None = None
        """Binary tree of the boxes around facets, if single threads search."""
        self._bodies: wp.Bvh | None = None
        """Tree of the boxes around bodies, if there are many."""
        self.planes = planes
        many_bodies = len(on_host.solid) > (MOST_BODIES_ON_GPU if device.is_cuda else MOST_BODIES)
        note = model.kernels.note
        self._begin_search, self._find_candidates = note(begin_search(scalar)), note(find_candidates(scalar))
        self._box_facets = note(box_facets(scalar, self._warp))
        self._box_neighbours = note(box_neighbours(scalar, 0 if many_bodies else self._warp, model.in_worlds))
        search = find_rows_of_grains if self._grains else find_rows
        self._find_in_rows = note(search(scalar, self.lanes, model.in_worlds), block=BLOCK)
        if not model.in_worlds:  # bodies of different worlds have no common drift
            self._find_speeds = note(range_of_speeds(scalar, self._warp))
        if self.lanes == 1 or (many_bodies and model.in_worlds):
            note(find_roots())
        note(*(place_vertices(model.dim, scalar, one, model.in_worlds) for one in {False, model.compensated}))
        planes.meet(self)
        model.kernels.compile()
        self._begin(0.0)
        if self.lanes == 1:
            groups = wp.array(owner[order], dtype=int, device=device)
            self._binary = wp.Bvh(self.tree.lower, self.tree.upper, groups=groups)
            self.tree.binary = self._binary.id
            wp.launch(find_roots(), bodies, [self._binary.id], [self.tree.root], device=device)
        if many_bodies:
            worlds = wp.array(np.arange(bodies) // len(on_host.solid), dtype=int, device=device)
            boxes = self.tree.body_lower, self.tree.body_upper
            self._bodies = wp.Bvh(*boxes, groups=worlds if model.in_worlds else None)
            if model.in_worlds:
                data.root_of_world = wp.zeros(model.worlds, dtype=int, device=device)
                wp.launch(find_roots(), model.worlds, [self._bodies.id], [data.root_of_world], device=device)
        self._give_room(ROOM, min(ROOM, bodies))
        self._find_rows_with_room()

    def begin(self, dt: float) -> None:
        """Set the length of substeps [s], in proportion to which vertices move."""
        if self.dt:
            self.overruns.scale(dt / self.dt)
        self.dt = dt

    def launch_parts(
        self, kernel: Any, many: int, inputs: list, outputs: list, most: int = 2**31, block: int = 256
    ) -> None:
        """Launch a kernel whose threads divide `many` items: on a GPU one thread per item, but at most `most`.

        On the CPU each part (`kernels.partition`) has one thread, since each thread would copy the arguments (2
        kB). `block` is the number of threads in a block on a GPU.
        """
        device = self._model.device
        threads = min(many, most) if device.is_cuda else 1

        def launch(part: int, parts: int) -> None:
            wp.launch(kernel, threads, [*inputs, threads, part, parts], outputs, device=device, block_dim=block)

        self.launcher.launch_parts(launch)

    def place(
        self,
        x: wp.array,
        v: wp.array,
        compensation: Any,
        after: float = 0.0,
        checks: bool = False,
        begins: bool = False,
    ) -> None:
        """Launch the update of vertices for particles at x, corrected by `compensation` if given.

        `after` is the time from the end of the last substep [s]; `checks` tells whether lists must stay valid for
        some more substeps, and `begins` whether a substep begins.
        """
        model, contact = self._model, self._contact
        compensated = model.compensated and compensation is not None
        if compensation is None:
            compensation = compensated_sum(model.dim, model.scalar, False)[0]()
        kernel = place_vertices(model.dim, model.scalar, compensated, model.in_worlds)
        ahead = (self.skin.check_every + LEAST_ALLOWANCE) * self.dt if checks else 0.0
        inputs = [
            contact,
            compensation,
            x,
            v,
            after,
            self.dt,
            ahead,
            self.skin.on_device,
            self.longest_path,
            int(begins),
        ]
        self.launch_parts(kernel, len(contact.surfaces.x), inputs, [self.flags])

    def search(
        self, x: wp.array, v: wp.array, compensation: Any, after: float, begins: bool, frame_begins: bool
    ) -> None:
        """Launch the update of vertices, and every few substeps, if due, the search for facets near points.

        Surfaces that have crossed since the start are detected only where a frame begins, so that results do not
        depend on when lists are made.
        """
        if frame_begins and self.torn is not None:
            self.torn.leave_out(self.launch_parts)
        checks = frame_begins or (begins and self.substep % self.skin.check_every == 0)
        self.place(x, v, compensation, after, checks, begins)
        if checks:
            self._find_if_due(after, frame_begins)

    def _find_if_due(self, after: float, frame_begins: bool) -> None:
        """Launch a search that the device skips if lists are still valid."""
        if frame_begins and self.planes.tangles:
            self._find(after, True)
        else:
            self.launcher.launch_if(self.data.due, partial(self._find, after, frame_begins))

    def invalidate(self) -> None:
        """Make the next evaluation of forces rebuild the lists, since positions have changed."""
        self.data.due.fill_(FORCED)

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """List the facets near each point, and enlarge the lists until all fit."""
        self.place(x, v, None)
        self._find_rows_with_room()

    def launch(self, kernel: Any, many: int, inputs: list, outputs: list) -> None:
        """Launch a kernel whose threads divide `many` items: on a GPU a thread per item, on the CPU one in all."""
        device = self._model.device
        threads = many if device.is_cuda else 1
        wp.launch(kernel, threads, [*inputs, threads], outputs, device=device)

    def _begin(self, after: float, frame_begins: bool = False) -> None:
        """Launch the start of a search: boxes around facets and all nodes of the tree."""
        tree, given = self.tree, [self._contact, self.tree]
        many = max(len(self.data.x_found), len(tree.group), len(tree.body_lower))
        # A few fast vertices would else cause a search in each substep; many would be near all.
        substeps = self.skin.check_every if self.overruns.any else CHECK_EVERY
        soon = (substeps + ALLOWANCE) * self.dt
        self.launch(
            self._begin_search,
            many,
            [*given, self.skin.on_device, soon, self.overruns.most, after, int(frame_begins)],
            [],
        )
        self.launch(self._box_facets, self._warp * len(tree.leaf), given, [])
        for one in (self._binary, self._bodies):
            if one is not None:
                one.refit()

    def _find(self, after: float, frame_begins: bool = False) -> None:
        """Launch a search for the current positions of vertices."""
        self._begin(after, frame_begins)
        self._find_rows(frame_begins)
        if not self._model.in_worlds:
            self.launch(self._find_speeds, min(self._points, MOST_THREADS), [self._contact], [])

    def _find_rows_with_room(self) -> None:
        """List the facets near each point, and repeat with more room until all fit."""
        while True:
            self.flags.zero_()
            self._begin(0.0)
            self._find_rows()
            found = self.flags.numpy().reshape(-1, FLAGS).max(axis=0)
            if not self._make_room(
                *found[[LONGEST_ROW, MOST_BODY_PAIRS, PAIRS, NEAR_FACETS]].astype(int).tolist()
            ):
                break
        self.flags.zero_()

    def _find_rows(self, frame_begins: bool = True) -> None:
        """Launch the search for near pairs and for the facets near each point; boxes must be up to date."""
        contact, tree, many = self._contact, self.tree, len(self.tree.body_lower)
        by_tree, tree_of_bodies = (0, 0) if self._bodies is None else (1, self._bodies.id)
        threads = many if by_tree else self._warp * many
        self.launch(self._box_neighbours, threads, [contact, tree, tree_of_bodies, self.farthest], [self.flags])
        self.planes.find(frame_begins)
        inputs, searching = [contact, tree, self.farthest], MOST_SEARCHING
        self.launch_parts(self._find_candidates, self._points, inputs, [])
        self.launch_parts(self._find_in_rows, self.lanes * self._points, inputs, [self.flags], searching, BLOCK)

    def hold(self, flags: NDArray[Any], counts: NDArray[np.bool_]) -> bool:
        """Return whether lists have been valid so far, by the flags of a frame that runs; see `judge`."""
        flags = flags[counts & (flags[:, PATH] < self.longest_path)]
        most = flags.max(axis=0, initial=0.0)
        full = most[PAIRS] > len(self.planes.pairs.vertices) or most[NEAR_FACETS] > 0.0
        return (
            self.skin.holds(most[MOVED])
            and not full
            and not self._overflows(*most[[LONGEST_ROW, MOST_BODY_PAIRS]])
        )

    def _overflows(self, longest: float, body_pairs: float) -> bool:
        """Return whether the lists have no room for rows that are so long."""
        return longest > self.data.candidates.shape[1] or body_pairs > self.data.body_pairs.shape[1]

    def judge(self, flags: NDArray[Any], counts: NDArray[np.bool_]) -> bool:
        """Choose the skin from the flags of a frame; return whether the frame must be repeated.

        Worlds with a False in `counts` are ignored, and worlds that diverge or are too fast (`too_far`).
        """
        flags = flags.reshape(-1, FLAGS).astype(np.float64)
        self.active, pairs, near_facets = (int(flags[0, one]) for one in (ACTIVE, PAIRS, NEAR_FACETS))
        fast = counts & (flags[:, PATH] >= self.longest_path)
        self.too_far = float(flags[fast, PATH].max(initial=0.0))
        self.path = float(flags[counts, PATH].max(initial=0.0))
        valid = counts & (flags[:, PATH] < self.longest_path)
        flags = flags[valid]
        if not len(flags):
            return False
        highest = flags.max(axis=0)[[MOVED, PATH, NEAR_PATH, LONGEST_ROW, MOST_BODY_PAIRS]]
        moved, path, near_path, longest, body_pairs = highest.tolist()
        held = self.skin.holds(moved)
        if self.skin.choose(path, near_path, moved, self.overruns.following):
            self.invalidate()
        overflown = self._overflows(longest, body_pairs)
        overflown |= self.planes.judge(pairs, held)
        overflown |= near_facets > 0
        self.overruns.learn(held, NARROWER if held and not overflown else 1.0, valid)
        self._make_room(int(longest), int(body_pairs), pairs, near_facets)
        return not held or overflown

    def _make_room(self, longest: int, body_pairs: int, near_pairs: int, near_facets: int) -> bool:
        """Reallocate lists that are too short for these numbers of entries; return whether any list was.

        They get some room to spare, since searches between frames cannot be repeated.
        """
        data, extended = self.data, self.planes.extend(near_pairs, near_facets)
        (points, room), (bodies, room_beside) = data.candidates.shape, data.body_pairs.shape
        if extended:
            self.invalidate()
        if longest <= ROOM_TO_SPARE * room and (
            body_pairs <= ROOM_TO_SPARE * room_beside or room_beside >= bodies
        ):
            return extended
        more = max(room, room_for(longest))
        beside = min(bodies, max(room_beside, room_for(body_pairs)))
        device, scalar = self._model.device, wp.types.type_size_in_bytes(self._model.scalar)
        check_room(f"{longest} facets are near one point, of {points}", more * points, 20 + scalar, device)
        kind: Any = Pair(self._model.scalar)
        pair = wp.types.type_size_in_bytes(kind)
        check_room(f"{body_pairs} bodies are near one body, of {bodies}", beside * bodies, 4 + pair, device)
        self._give_room(more, beside)
        return True

    def _give_room(self, room: int, body_pairs: int) -> None:
        """Allocate lists for up to `room` facets near each point, and `body_pairs` pairs of near bodies."""
        data, device = self.data, self._model.device
        points, bodies = len(data.candidate_count), len(data.body_pair_count)
        data.candidates = wp.zeros((points, room), dtype=wp.vec4i, device=device)
        data.candidate_pair = wp.zeros((points, room), dtype=int, device=device)
        data.candidate_distance = wp.zeros((points, room), dtype=self._model.scalar, device=device)
        data.body_pairs = wp.zeros((bodies, body_pairs), dtype=int, device=device)
        kind: Any = Pair(self._model.scalar)
        data.pairs = wp.zeros((bodies, body_pairs), dtype=kind, device=device)
        data.candidate_count.zero_()
        data.body_pair_count.zero_()
        self._model.generation += 1
        self.invalidate()
