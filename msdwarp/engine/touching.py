"""Touching: contact between the bodies of a system on a device."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import touching_surfaces
from ..kernels.compensation import compensation
from ..kernels.touch import (
    DEEPEST,
    FLAGS,
    HISTORY,
    LONGEST_ROW,
    MOVED,
    NOTED,
    Surfaces,
    add_impulses,
    box_bodies,
    box_facets,
    box_neighbours,
    energy_of_touch,
    find_rows,
    forget_boxes,
    place_vertices,
    touch,
    touching_piece,
)
from ..world import Load, Touch
from .effect import Effect
from .overrun import Overrun
from .rows import rows
from .touch_tables import (
    check_stiffness,
    chunks,
    contact_blocks,
    hops_apart,
    led_apart,
    neighbourhoods,
    rules_by_kind,
    stiffness_of_pairs,
)

if TYPE_CHECKING:
    from .model import Model

ROOM = 32
"""Facets that a row has room for at first."""
ROOM_TO_SPARE = 0.8
"""Share of it that may be taken."""
MOST_ROOM = 2**30
"""Numbers in all rows, at most."""
LEAST_SKIN = 0.25
"""The skin at first, and at least, by how far off bodies touch."""
SKIN_BY_WAY = 3.0
"""The skin by the furthest way of a vertex between two searches: lists hold as long as it is more than 2."""
OVERLAP = 0.01
"""By so much of their spacing bodies may overlap at the start before something is said."""
LED_APART_IN = 0.5
"""What overlaps at the start is led apart within this time [s]."""
FARTHEST_WAY = 16.0
"""What moves further in a substep, by how far off bodies touch, is flying apart."""
PATIENCE = 5
"""Frames in which little moves after which searches are made less often."""
MOST_PATIENCE = 80
"""That doubles when it was too early, up to this."""
MOST_BETWEEN = 32
"""Substeps from one search to the next, at most."""
UNITS = 2.0**-40
"""The unit in which forces are summed, by the largest force that a contact is meant to bear."""


def touching(model: "Model", loads: Sequence[Load], felt: bool) -> Effect | None:
    """Return the effect of contact between the bodies of a scene, if they touch; `felt` as for `Touching`."""
    rules = [one for one in loads if isinstance(one, Touch)]
    if not any(one.between != "none" for one in rules):
        return None
    return Touching(model, rules, felt)


class Touching(Effect):
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

    def __init__(self, model: "Model", rules: Sequence[Touch], felt: bool = False) -> None:
        self._model, self._rules, self._dt = model, rules, 0.0
        surfaces = self._surfaces = touching_surfaces(model.system)
        scalar, device, dtype = model.scalar, model.device, model.dtype
        kind, rule = rules_by_kind(model, surfaces, rules)
        check_stiffness(surfaces, rules, kind, rule)

        def array(values: Any, kind: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=kind, device=device)

        vertices, points, bodies = len(surfaces.particle), len(surfaces.share), len(surfaces.closed)
        data = self._touch = Surfaces(scalar)()
        each = surfaces.weight != 0
        data.first = array(np.append(0, np.cumsum(each.sum(axis=1))), int)
        data.particle, data.weight = array(surfaces.particle[each], int), array(surfaces.weight[each], scalar)
        inverse = np.broadcast_to(1.0 / model.mass, model.particle_count)
        mobility = (surfaces.weight**2 * inverse[surfaces.particle]).sum(axis=1)
        data.mobility = array(mobility, scalar)
        start = np.einsum("vk,vkd->vd", surfaces.weight, model.system.position[surfaces.particle])
        first, near = neighbourhoods(surfaces, hops_apart(surfaces, rules, kind, rule))
        data.first_near, data.near = array(first, int), array(near, int)
        for name in ("x", "v", "x_found"):
            setattr(data, name, wp.zeros(vertices, dtype=model.vector, device=device))
        data.force = wp.zeros((vertices, 3), dtype=wp.int64, device=device)
        data.ends, data.share = array(surfaces.ends, wp.vec2i), array(surfaces.share, scalar)
        data.body = array(surfaces.body[surfaces.ends[:, 0]], int)
        data.row, data.whose = (wp.zeros((ROOM, points), dtype=int, device=device) for _ in "rw")
        data.away = wp.zeros((ROOM, points), dtype=scalar, device=device)
        data.length, data.busy = (wp.zeros(points, dtype=int, device=device) for _ in "lb")
        data.busy_count = wp.zeros(1, dtype=int, device=device)
        data.slip = wp.zeros((HISTORY, points), dtype=model.vector, device=device)
        data.allowed = wp.zeros(points, dtype=scalar, device=device)
        data.partner = wp.full((HISTORY, points), -1, dtype=int, device=device)
        data.overrun = wp.zeros(NOTED, dtype=wp.float64, device=device)
        self._noted = wp.empty_like(data.overrun, device="cpu", pinned=True) if device.is_cuda else data.overrun
        data.corner = array(surfaces.corner, wp.vec3i)
        data.owner = array(surfaces.body[surfaces.corner[:, 0]], int)
        data.kind, data.closed = array(kind, int), array(surfaces.closed.astype(np.int32), int)
        # A lattice is one spacing thick at least: what is past its middle has come from the other side.
        depth = np.where(surfaces.closed, 0.5 * surfaces.spacing, 0.0)
        on_vertices = np.bincount(surfaces.body, minlength=bodies)
        carriers = np.unique(surfaces.particle[surfaces.weight != 0])
        carrying = np.bincount(surfaces.body_of_particle[carriers], minlength=bodies)
        on_points = np.bincount(surfaces.body[surfaces.ends[:, 0]], minlength=bodies)
        density = np.minimum(carrying, on_vertices) / np.maximum(on_points, 1)
        for name, values in (
            ("depth", depth),
            ("stiffness", surfaces.stiffness),
            ("density", density),
            ("radius", surfaces.radius),
        ):
            setattr(data, name, array(values, scalar))
        data.rule = array(rule, int)
        data.among = array([one.between == "all" for one in rules], int)
        for name, values in (
            ("friction", [one.friction for one in rules]),
            ("damping", [one.damping_ratio for one in rules]),
            ("thickness", [-1.0 if one.thickness is None else one.thickness for one in rules]),
            ("given", [-1.0 if one.stiffness is None else one.stiffness for one in rules]),
        ):
            setattr(data, name, array(values, scalar))
        given = [one.thickness for one in rules if one.thickness is not None]
        own = 2.0 * float(surfaces.radius.max(initial=0.0)) if len(given) < len(rules) else 0.0
        self._farthest = max(own, float(depth.max(initial=0.0)), *given, 0.0)
        self._least_skin = LEAST_SKIN * self._farthest
        self._blocks = contact_blocks(model, surfaces, rules, kind, rule, density)

        self.piece = touching_piece(model.dim, scalar, model.compensated)
        self.data = self.piece.Data()
        owner = surfaces.particle[each]
        order, first = rows(owner, model.particle_count)
        self.members = np.diff(first) > 0
        self.data.first = array(first, int)
        self.data.vertex = array(np.repeat(np.arange(vertices), each.sum(axis=1))[order], int)
        self.data.weight = array(surfaces.weight[each][order], scalar)
        self.data.force = data.force
        self.impulse = wp.zeros(model.particle_count, dtype=wp.vec3d, device=device) if felt else None
        """What other bodies have pushed each particle with since it was zeroed [N s]; None where nobody asks."""
        stiffest = max(float(surfaces.stiffness.max(initial=0.0)), *(one.stiffness or 0.0 for one in rules))
        self.data.unit = stiffest * max(self._farthest, 1e-30) * UNITS
        data.x.assign(start.astype(dtype))
        self._lower, self._upper = (wp.zeros(len(surfaces.corner), dtype=wp.vec3, device=device) for _ in "lu")
        wp.launch(box_facets(scalar), len(surfaces.corner), [data], [self._lower, self._upper], device=device)
        owner = surfaces.body[surfaces.corner[:, 0]]
        self._tree = wp.Bvh(self._lower, self._upper)
        self._chunk = array(chunks(owner), wp.vec3i)
        boxes = [wp.zeros(bodies, dtype=wp.vec3, device=device) for _ in range(4)]
        self._boxes, self._limits = boxes[:2], boxes[2:]
        self._box_bodies()
        self._bodies, self._flags = wp.Bvh(boxes[0], boxes[1]), wp.zeros(FLAGS, dtype=float, device=device)
        self._found = wp.empty_like(self._flags, device="cpu", pinned=True) if device.is_cuda else self._flags
        self._overrun = np.zeros(NOTED)
        self._skin_now, self._calm, self._patience = self._least_skin, 0, PATIENCE
        self._skin = wp.full(1, self._skin_now, dtype=scalar, device=device)
        self._unread, self._nowhere = wp.zeros_like(self._flags), wp.zeros(0, dtype=wp.float64, device=device)
        self.deepest = 0.0
        """The deepest overlap in the frame looked at last [m]."""
        self._find_rows()
        self._make_room(int(self._flags.numpy()[LONGEST_ROW]))
        self._flags.zero_()
        self._sink()

    def _sink(self) -> None:
        """Find out which points start inside other bodies, and let them stay there for a moment."""
        model, data, surfaces = self._model, self._touch, self._surfaces
        x = model.vectors()
        x.assign(model.system.position.astype(model.dtype))
        self._sunk, self._overlapping = False, None
        stored = self._stored_and_heated(x, model.vectors())[0].numpy()
        points = np.flatnonzero(stored)
        if not len(points):
            return
        a, b = data.body.numpy()[points], data.whose.numpy()[0, points]
        kind = data.kind.numpy()
        k = stiffness_of_pairs(surfaces, self._rules, data.rule.numpy()[kind[a], kind[b]], a, b)
        deep = np.sqrt(2 * stored[points] / (k * data.density.numpy()[a]))
        p = int(np.argmax(deep))
        if not deep[p] > OVERLAP * max(surfaces.spacing[a[p]], surfaces.spacing[b[p]], self._farthest):
            return
        allowed = np.zeros(len(stored))
        allowed[points] = deep
        data.allowed.assign(allowed.astype(model.dtype))
        self._sunk, data.outwards = True, float(deep[p]) / LED_APART_IN
        self.done = data.done = wp.zeros(len(stored), dtype=wp.float64, device=model.device)
        self._overlapping = led_apart(surfaces, (int(a[p]), int(b[p])), float(deep[p]), len(points), LED_APART_IN)

    def overlapping(self) -> str | None:
        """Return words about the bodies that overlap most at the start; None where none do but by touching."""
        return self._overlapping

    def go_on_from(self, other: Effect) -> None:
        """Let points stick to what they stuck to in another model of the same bodies."""
        assert isinstance(other, Touching)
        if other._touch.partner.shape == self._touch.partner.shape:
            wp.copy(self._touch.slip, other._touch.slip)
            wp.copy(self._touch.partner, other._touch.partner)

    def begin(self, substeps: int, dt: float) -> None:
        """Take the length of substeps."""
        self._dt = dt

    def search(self, x: wp.array, v: wp.array, lost: Any) -> None:
        """Launch what lists the facets near each point."""
        data, device, scalar = self._touch, self._model.device, self._model.scalar
        self._place(x, v, lost, self._unread)
        wp.launch(box_facets(scalar), len(data.corner), [data], [self._lower, self._upper], device=device)
        self._tree.refit()
        self._box_bodies()
        self._bodies.refit()
        wp.copy(data.x_found, data.x)
        self._find_rows()

    def _find_rows(self) -> None:
        """Launch what lists the facets near each point, by the boxes that there are."""
        data, device, scalar = self._touch, self._model.device, self._model.scalar
        limits, around = self._limits, [self._farthest, self._skin]
        inputs = [data, self._bodies.id, *self._boxes, *around, data.busy_count]
        wp.launch(box_neighbours(scalar), len(data.kind), inputs, limits, device=device)
        inputs = [data, self._bodies.id, self._tree.id, *limits, *around]
        self._share(find_rows(scalar), len(data.share), inputs, [self._flags])

    def _share(self, kernel: Any, many: int, inputs: list, outputs: list) -> None:
        """Launch a kernel whose threads share so many things: a thread for each, on the CPU one for all."""
        threads = many if self._model.device.is_cuda else 1  # there each has a copy of its arguments, of 2 kB
        wp.launch(kernel, threads, [*inputs, threads], outputs, device=self._model.device)

    def _box_bodies(self) -> None:
        """Launch what finds the boxes around bodies."""
        device, inputs = self._model.device, [self._chunk, self._lower, self._upper]
        wp.launch(forget_boxes(), len(self._boxes[0]), outputs=self._boxes, device=device)
        wp.launch(box_bodies(), len(self._chunk), inputs, self._boxes, device=device)

    def _place(self, x: wp.array, v: wp.array, lost: Any, flags: wp.array) -> None:
        """Launch what puts vertices where particles at x are; without `lost` these have lost nothing."""
        model = self._model
        compensated = model.compensated and lost is not None
        if lost is None:
            lost = compensation(model.dim, model.scalar, False)[0]()
        kernel = place_vertices(model.dim, model.scalar, compensated)
        self._share(kernel, len(self._touch.x), [self._touch, lost, x, v], [flags])

    def before_forces(self, x: wp.array, v: wp.array, lost: Any, begins: bool) -> None:
        """Launch the contacts of particles at x that move at v."""
        model, data = self._model, self._touch
        self._place(x, v, lost, self._flags)
        lag = self._dt if self.steps.lagging else 0.0
        inputs = [data, self._dt if begins else 0.0, lag, self.data.unit, self._skin]
        kernel, nowhere = touch(model.scalar, self._sunk), self._nowhere
        self._share(kernel, len(data.share), inputs, [self._flags, nowhere, nowhere])

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
            wp.copy(self._noted, self._touch.overrun)
            self._flags.zero_()
            self._touch.overrun.zero_()

    def is_void(self) -> bool:
        """Tell whether lists held in the frame that was waited for; if not, make room for it to be repeated."""
        flags = self._found.numpy()
        moved, longest, self.deepest = float(flags[MOVED]), int(flags[LONGEST_ROW]), float(flags[DEEPEST])
        self._overrun = np.array(self._noted.numpy(), dtype=np.float64)
        if self._found is self._flags:
            self._flags.zero_()
            self._touch.overrun.zero_()
        if not moved < FARTHEST_WAY * self._farthest * self.search_every:
            return False  # it flies apart, which the watch sees
        held = moved <= 0.5 * self._skin_now
        # Where all moves fast lists are made more often, before they grow long.
        # Made each time they need a skin for the later stages of a substep alone, where a method has such.
        per_substep = moved / max(self.search_every - 1, 1)
        best = 1 + self._farthest / (2 * SKIN_BY_WAY * max(per_substep, 1e-30))
        self._calm = self._calm + 1 if best >= 2 * self.search_every else 0
        if best < self.search_every:
            self.search_every, self.is_stale = 1 << (int(best).bit_length() - 1), True
            self._patience = min(2 * self._patience, MOST_PATIENCE)
        elif self._calm >= self._patience and self.search_every < MOST_BETWEEN:
            self.search_every, self.is_stale, self._calm = 2 * self.search_every, True, 0
        wanted = max(self._least_skin, SKIN_BY_WAY * per_substep * max(self.search_every - 1, 1))
        if wanted > self._skin_now or wanted < 0.25 * self._skin_now:
            self._skin_now = wanted
            self._skin.fill_(wanted)
        room = self._touch.row.shape[0]
        self.is_stale |= self._make_room(longest)
        return not held or longest > room

    def doubt(self) -> str | None:
        """Return words about the first contact that was overrun in the frame that was waited for."""
        found = Overrun.of(self._overrun, self._touch, self._surfaces, self._rules)
        return found and found.described(self._model.system, self._surfaces, self.steps.substeps, self._dt)

    def _make_room(self, longest: int) -> bool:
        """Make room for more than the longest row; tell whether there was not.

        Some is kept to spare: between frames rows are found too, and nothing is repeated there.
        """
        room, points = self._touch.row.shape
        if longest <= ROOM_TO_SPARE * room:
            return False
        more = 1 << (int(longest / ROOM_TO_SPARE) - 1).bit_length()
        if more * points > MOST_ROOM:
            raise MemoryError(f"{longest} facets are near one point: lists of {points} points have no room")
        data, device = self._touch, self._model.device
        data.row, data.whose = (wp.zeros((more, points), dtype=int, device=device) for _ in "rw")
        data.away = wp.zeros((more, points), dtype=self._model.scalar, device=device)
        return True

    @property
    def changing(self) -> list[wp.array]:
        """How points stick."""
        return [self._touch.slip, self._touch.partner, self._touch.allowed]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return how points stick."""
        names = ("slip", "partner", *(("allowed",) if self._sunk else ()))
        arrays = {f"touch.{name}": getattr(self._touch, name).numpy().copy() for name in names}
        return arrays | ({"touch.outwards": np.array([self._touch.outwards])} if self._sunk else {})

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Take back what `checkpoint` gave."""
        self._touch.slip.assign(arrays["touch.slip"])
        self._touch.partner.assign(arrays["touch.partner"])
        self._sunk = "touch.allowed" in arrays
        if self._sunk:
            self._touch.allowed.assign(arrays["touch.allowed"])
            self._touch.outwards = float(arrays["touch.outwards"][0])

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array) -> None:
        """Add what contacts hold particles with: all points of a surface may be in contact at a time."""
        for blocks, each in zip((stiffness, damping), self._blocks, strict=True):
            blocks.assign(blocks.numpy() + each[:, None, None] * np.eye(self._model.dim))

    def energy(self, x: wp.array) -> float:
        """Return what contacts store [J]."""
        return self.energy_and_power(x, self._model.vectors())[0]

    def dissipated_power(self, x: wp.array, v: wp.array) -> float:
        """Return what contacts turn to heat [W]."""
        return self.energy_and_power(x, v)[1]

    def energy_and_power(self, x: wp.array, v: wp.array) -> tuple[float, float]:
        """Return what contacts store [J], and what they turn to heat [W]."""
        stored, heated = self._stored_and_heated(x, v)
        return float(stored.numpy().sum()), float(heated.numpy().sum())

    def _stored_and_heated(self, x: wp.array, v: wp.array) -> list[wp.array]:
        """Return what the contacts of each point store [J], and turn to heat [W]."""
        model, data = self._model, self._touch
        self.search(x, v, None)
        sums = [wp.zeros(len(data.share), dtype=wp.float64, device=model.device) for _ in range(2)]
        inputs = [data, 0.0, 0.0, self.data.unit, self._skin]
        self._share(energy_of_touch(model.scalar, self._sunk), len(data.share), inputs, [self._flags, *sums])
        return sums
