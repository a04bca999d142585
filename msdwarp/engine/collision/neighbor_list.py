"""NeighborList: the facets near each point of bodies that touch, in lists that are valid for some substeps.

`judge` chooses how many substeps lie between two searches. `simulation/stepping.py` repeats a frame whose lists
were not valid or had no room.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import places_along_curve
from ...kernels.collision import (
    BLOCK,
    FLAGS,
    LONGEST_ROW,
    MOST_BODY_PAIRS,
    MOVED,
    PAIRS,
    WAY,
    box_facets,
    box_neighbours,
    clear_boxes,
    find_candidates,
    find_roots,
    find_rows,
    place_vertices,
    range_of_speeds,
)
from ...kernels.compensation import compensated_sum
from ..device.launcher import Launcher
from ..device.vector_arrays import in_records
from ..model.model import Model
from .contact_surfaces import ContactSurfaces
from .division_planes import DivisionPlanes
from .tables_by_world import Repeated

PIECE = 32
"""Facets that are boxed together, on a GPU by a warp."""
MORTON_BITS = 16
"""Cells along each axis in which places are sorted, as a power of 2."""
ROOM = 32
"""Facets that a row has room for at first, and bodies near one."""
ROOM_TO_SPARE = 0.8
"""Share of it that may be taken."""
MOST_ROOM = 2**30
"""Numbers in all rows, at most."""
LEAST_SKIN = 0.25
"""The skin at first, and at least, by how far off bodies touch."""
SKIN_BY_WAY = 2.5
"""The skin by the furthest way of a vertex between two searches: lists hold as long as it is more than 2."""
WIDEST_SKIN = 0.5
"""The skin at most, by how far off bodies touch, unless the next is more."""
SPACINGS_OF_SKIN, SPACINGS_OF_SKIN_ON_GPU = 0.4, 0.9
"""The skin at most, by the least spacing. A wider one means longer rows and fewer searches."""
FARTHEST_WAY = 64.0
"""A body that moves further in a substep, by its spacing or by how far off bodies touch, is flying apart."""
PATIENCE = 1
"""Frames in which little moves after which searches are made less often."""
MOST_PATIENCE = 32
"""That doubles, up to this, when it was too early: when searches were needed again within as many frames."""
MOST_THREADS = 2**14
"""Threads on a GPU that look through the points that are near anything."""
BETWEEN = (1, 2, 4, 8, 16, 32)
"""Substeps from one search to the next: a frame is recorded for each. With more of them piles take longer."""


class NeighborList:
    """Lists the facets near each point.

    A list is valid until a vertex has moved by half of its skin. Lists are made again before every few substeps,
    as often as the fastest motion needs; a frame in which that was too seldom must be repeated. Facets that are
    listed and not touched change nothing: results depend neither on the skin nor on how often lists are made.

    It alone replaces arrays that recorded launches write to, and counts that in `Model.generation`.

    Its arrays are the `neighbors` of `contact`, the struct of contact on the device; `planes` lists near pairs;
    `thickest` is the distance from which a facet may push a point outside its body [m].
    """

    def __init__(
        self,
        model: Model,
        surfaces: ContactSurfaces,
        contact: Any,
        each: Repeated,
        planes: DivisionPlanes | None,
        thickest: float,
    ) -> None:
        self._model, self._contact, self.data = model, contact, contact.neighbors
        on_host, data = surfaces.on_host, self.data
        scalar, device, closed = model.scalar, model.device, on_host.closed
        bodies, self._points = model.worlds * len(closed), model.worlds * len(on_host.share)
        self.farthest = farthest = max(thickest, *(one[closed].max(initial=0.0) for one in surfaces.depth))
        """From how far a facet may push a point [m]."""
        self._around = max(farthest, float(surfaces.data.depth.numpy().max()))
        spacing = on_host.spacing[on_host.spacing > 0]
        spacings = SPACINGS_OF_SKIN_ON_GPU if device.is_cuda else SPACINGS_OF_SKIN
        least_spacing = float(spacing.min()) if len(spacing) else 0.0
        self._widest = max(WIDEST_SKIN * farthest, spacings * least_spacing)
        self._least_skin = LEAST_SKIN * farthest
        self._farthest_way = FARTHEST_WAY * max(farthest, float(spacing.max(initial=0.0)))
        self.rebuild_interval = 8
        """Substeps from one search to the next."""
        self._skin_now, self._calm, self._patience = self._least_skin, 0, PATIENCE
        self._since_rarer = MOST_PATIENCE
        self.partition: Launcher | None = None
        """Has threads of the CPU share the launches of a frame; None where one thread does it all."""
        self.now = self._found_at = 0.0
        """The time in the frame of the next launches [s]."""
        self.buffer = wp.full(1, self._skin_now, dtype=scalar, device=device)
        """How much farther than it touches a point searches [m], shape [1]."""
        self.flags: Any = wp.zeros(model.worlds * FLAGS, dtype=float, device=device)
        """What launches have found since they were read, in each world: see `kernels.collision.contact_data`."""
        self.unread = wp.zeros_like(self.flags)
        owner, x_first = surfaces.data.owner.numpy(), surfaces.data.x.numpy()[: len(on_host.particle)]
        a, b = (x_first[end] for end in on_host.ends.T)
        on_curve = places_along_curve(a + on_host.share[:, None] * (b - a), MORTON_BITS)
        in_order = np.lexsort([on_curve, surfaces.body_of_point]).astype(np.int32)
        data.in_order = each.alike(in_order, int, len(on_host.share))
        data.x_found = in_records(len(surfaces.data.x), model.dim, scalar, device)
        self._lower, self._upper = (wp.zeros(len(owner), dtype=wp.vec3, device=device) for _ in "lu")
        boxes = [wp.zeros(bodies, dtype=wp.vec3, device=device) for _ in range(4)]
        self.boxes, self.limits = boxes[:2], boxes[2:]
        self._widest_facet = wp.zeros(bodies, dtype=float, device=device)
        # A distant facet may come nearer by this much than the search looks, without touching.
        self._more = max(0.0, self._around - thickest)
        self._piece = wp.array(pieces(owner), dtype=wp.vec3i, device=device)
        self._box()
        worlds = wp.array(np.arange(bodies) // len(closed), dtype=int, device=device)
        self._bodies = wp.Bvh(boxes[0], boxes[1], groups=worlds if model.in_worlds else None)
        if model.in_worlds:
            data.root_of_world = wp.zeros(model.worlds, dtype=int, device=device)
            wp.launch(find_roots(), model.worlds, [self._bodies.id], [data.root_of_world], device=device)
        # Each point is searched for in the facets of one body after the other.
        self.tree = wp.Bvh(self._lower, self._upper, groups=surfaces.data.owner)
        data.root = wp.zeros(bodies, dtype=int, device=device)
        wp.launch(find_roots(), bodies, [self.tree.id], [data.root], device=device)
        data.candidate_count, data.search_points, data.active_points = (
            wp.zeros(self._points, dtype=int, device=device) for _ in "lcb"
        )
        data.search_point_count, data.active_count = (wp.zeros(1, dtype=int, device=device) for _ in "cb")
        data.speeds = wp.zeros(2, dtype=wp.vec3, device=device)
        data.body_pair_count = wp.zeros(bodies, dtype=int, device=device)
        self._give_room(ROOM, min(ROOM, bodies))
        self.planes = planes
        if planes is not None:
            planes.neighbors = self
        self._find_rows_with_room()

    def share(
        self, kernel: Any, many: int, inputs: list, outputs: list, most: int = 2**31, block: int = 256
    ) -> None:
        """Launch a kernel whose threads share `many` items: on a GPU a thread for each, but at most `most`.

        On the CPU a part has a single thread, since each thread would copy the arguments, 2 kB. `block` is the
        number of threads of a GPU's block.
        """
        device = self._model.device
        threads = min(many, most) if device.is_cuda else 1

        def launch(part: int, parts: int) -> None:
            wp.launch(kernel, threads, [*inputs, threads, part, parts], outputs, device=device, block_dim=block)

        self.launch_parts(launch)

    def launch_parts(self, launch: Callable[[int, int], None]) -> None:
        """Call `launch(part, parts)` for each CPU thread that shares a recorded frame, or once `launch(0, 1)`."""
        if self.partition is not None and self.partition.is_recording:
            self.partition.launch_parts(launch)
        else:
            launch(0, 1)

    def place(
        self, x: wp.array, v: wp.array, compensation: Any, moved: wp.array | None = None, listing: bool = False
    ) -> None:
        """Launch the placing of vertices where particles are at x, corrected by `compensation` if given.

        If lists are made for these positions (`listing`), later motion is measured from them. `moved` takes the
        furthest motion of a vertex since the last search [m].
        """
        model, contact = self._model, self._contact
        compensated = model.compensated and compensation is not None
        if compensation is None:
            compensation = compensated_sum(model.dim, model.scalar, False)[0]()
        kernel = place_vertices(model.dim, model.scalar, compensated, model.in_worlds)
        inputs = [contact, compensation, x, v, self.now - self._found_at, self.buffer, self._more]
        inputs += [self._widest_facet, *self.limits, listing]
        self.share(kernel, len(contact.surfaces.x), inputs, [self.flags[MOVED:] if moved is None else moved])

    def search(self, x: wp.array, v: wp.array, compensation: Any, within: bool) -> None:
        """Launch the search of the facets near each point.

        Within a frame, the furthest motion since the last search decides how often to search.
        """
        self._place_and_box(x, v, compensation, self.flags[WAY:] if within else self.unread)
        self._find_rows(within)
        if not self._model.in_worlds:  # bodies of different worlds have no common drift
            device = self._model.device
            lanes, threads = (PIECE, min(self._points, MOST_THREADS)) if device.is_cuda else (1, 1)
            wp.launch(range_of_speeds(self._model.scalar, lanes), threads, [self._contact, threads], device=device)
        self._found_at = self.now

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """List the facets near each point, and make room for all."""
        self._place_and_box(x, v, None, self.unread)
        self._find_rows_with_room()

    def _place_and_box(self, x: wp.array, v: wp.array, compensation: Any, moved: wp.array) -> None:
        """Launch the placing of vertices, and of the boxes around facets and bodies, where particles are at x."""
        self.place(x, v, compensation, moved, listing=True)
        self._box()
        self.tree.refit()
        self._bodies.refit()

    def _find_rows_with_room(self) -> None:
        """List the facets near each point, and repeat with more room until all fit."""
        while True:
            self.flags.zero_()
            self._find_rows()
            found = self.flags.numpy().reshape(-1, FLAGS).max(axis=0)
            longest, body_pairs, pairs = found[[LONGEST_ROW, MOST_BODY_PAIRS, PAIRS]].astype(int)
            if not self._make_room(longest, body_pairs, pairs):
                break
        self.flags.zero_()

    def _find_rows(self, within: bool = False) -> None:
        """Launch the search of the facets near each point, by the current bounding boxes, and of near pairs."""
        contact, device, kinds = self._contact, self._model.device, (self._model.scalar, self._model.in_worlds)
        around = [self._around, self.buffer]
        inputs = [contact, self._bodies.id, *self.boxes, *around, self.flags, self.data.active_count]
        wp.launch(box_neighbours(*kinds), len(self.boxes[0]), inputs, self.limits, device=device)
        self.share(find_candidates(*kinds), self._points, [contact, *self.limits], [])
        inputs = [contact, self.tree.id, *self.boxes, *around]
        self.share(find_rows(*kinds), self._points, inputs, [self.flags], block=BLOCK)
        if self.planes is not None:
            self.planes.find(within)

    def _box(self) -> None:
        """Launch the boxes around facets and bodies."""
        device, boxes = self._model.device, [*self.boxes, self._widest_facet]
        wp.launch(clear_boxes(), len(boxes[0]), outputs=boxes, device=device)
        lanes, outputs = PIECE if device.is_cuda else 1, [self._lower, self._upper, *boxes]
        kernel = box_facets(self._model.scalar, lanes, self._model.in_worlds)
        threads = lanes * len(self._piece)
        wp.launch(kernel, threads, [self._contact, self._piece], outputs, device=device)

    def judge(self, flags: NDArray[Any], substeps: int) -> bool:
        """Choose how often to search, by the flags of a frame; return whether the frame must be repeated.

        Worlds that fly apart do not count: divergence is found elsewhere.
        """
        flags = flags.reshape(-1, FLAGS).astype(np.float64)
        flags = flags[flags[:, MOVED] < self._farthest_way * self.rebuild_interval]
        if not len(flags):
            return False
        chosen = [MOVED, WAY, LONGEST_ROW, MOST_BODY_PAIRS, PAIRS]
        moved, way, longest, body_pairs, pairs = flags.max(axis=0)[chosen].tolist()
        # `way` is that of all substeps between two searches; `moved` lacks the last one, but for a frame's end.
        lacking = int(self.planes is None)
        # Contact forces act before the last substep of a list, near pairs after it.
        held = max(moved, 0.0 if lacking else way) <= 0.5 * self._skin_now
        per_substep = max(
            way / self.rebuild_interval, moved / max(min(self.rebuild_interval, substeps) - lacking, 1), 1e-30
        )
        best = max(1.0, lacking + self._widest / (SKIN_BY_WAY * per_substep))
        best = max(every for every in BETWEEN if every <= best)
        self._calm = self._calm + 1 if best > self.rebuild_interval else 0
        self._since_rarer += 1
        if best < self.rebuild_interval:
            if self._since_rarer <= self._patience:
                self._patience = min(2 * self._patience, MOST_PATIENCE)
            self.rebuild_interval, self._since_rarer = best, MOST_PATIENCE
        elif self._calm >= self._patience:
            self.rebuild_interval, self._calm, self._since_rarer = best, 0, 0
        wanted = max(self._least_skin, SKIN_BY_WAY * per_substep * max(self.rebuild_interval - lacking, 1))
        if wanted > self._skin_now or wanted < 0.5 * self._skin_now:
            self._skin_now = wanted
            self.buffer.fill_(wanted)
        overflown = longest > self.data.candidates.shape[1] or body_pairs > self.data.body_pairs.shape[1]
        overflown |= self.planes is not None and pairs > len(self.planes.pairs.vertices)
        self._make_room(int(longest), int(body_pairs), int(pairs))
        return not held or overflown

    def _make_room(self, longest: int, body_pairs: int, near_pairs: int) -> bool:
        """Make room for rows, bodies near one body, and near pairs as found; return whether any room grew.

        Some room is kept to spare: searches between frames cannot be repeated.
        """
        data, extended = self.data, self.planes is not None and self.planes.extend(near_pairs)
        (points, room), (bodies, room_beside) = data.candidates.shape, data.body_pairs.shape
        if longest <= ROOM_TO_SPARE * room and (
            body_pairs <= ROOM_TO_SPARE * room_beside or room_beside >= bodies
        ):
            return extended
        more = max(room, room_for(longest))
        if more * points > MOST_ROOM:
            raise MemoryError(f"{longest} facets are near one point: lists of {points} points have no room")
        self._give_room(more, min(bodies, max(room_beside, room_for(body_pairs))))
        return True

    def _give_room(self, room: int, body_pairs: int) -> None:
        """Make lists with room for `room` facets near a point, and `body_pairs` bodies near one."""
        data, device = self.data, self._model.device
        points, bodies = len(data.candidate_count), len(data.body_pair_count)
        data.candidates, data.candidate_body = (wp.zeros((points, room), dtype=int, device=device) for _ in "rw")
        data.candidate_distance = wp.zeros((points, room), dtype=self._model.scalar, device=device)
        data.body_pairs = wp.zeros((bodies, body_pairs), dtype=int, device=device)
        data.candidate_count.zero_()
        data.body_pair_count.zero_()
        self._model.generation += 1


def room_for(many: int) -> int:
    """Return room for `many` entries, with some to spare: a power of 2."""
    return 1 << max(math.ceil(many / ROOM_TO_SPARE) - 1, 0).bit_length()


def pieces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return pieces of at most PIECE facets of one body each, as rows (body, first facet, last facet + 1)."""
    begins = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
    ends = np.append(begins[1:], len(owner))
    firsts = np.concatenate([np.arange(a, b, PIECE) for a, b in zip(begins, ends, strict=True)])
    lasts = np.minimum(firsts + PIECE, ends[np.searchsorted(begins, firsts, side="right") - 1])
    return np.stack([owner[firsts], firsts, lasts], axis=1).astype(np.int32)
