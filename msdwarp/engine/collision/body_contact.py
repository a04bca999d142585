"""BodyContact: contact between the bodies of a system on a device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ... import checks
from ...bodies import contact_surfaces
from ...kernels.collision.body_contact import evaluate_contact
from ...kernels.collision.contact_data import DEEPEST, FLAGS, HELD_BACK, WHOLE, BodyContactData, body_contact_term
from ...kernels.collision.force_sums import add_impulses
from ...kernels.collision.neighbor_search import (
    BLOCK,
    BLOCKS,
    FEW_ON_GPU,
    GRAINS_ON_GPU,
    MANY_ON_GPU,
    MOST_BY_MORE,
    ON_GPU,
)
from ...kernels.collision.segments_and_spheres import evaluate_segments_and_spheres
from ...world import Contact
from ..device.launcher import Launcher
from ..model.effect import Effect
from ..model.model import Model
from .contact_history import SEPARATION_TIME, WithHistory
from .contact_rules import ContactRules, unit_of_sums
from .contact_surfaces import ContactSurfaces
from .division_planes import DivisionPlanes
from .initial_overlap import initial_containment
from .neighbor_list import NeighborList
from .tables_by_world import Repeated
from .torn_facets import TornFacets

DAMPING = 0.25
"""Largest rate of all dampers of contacts at a vertex together, times the substep."""
UNLIMITED = 1e30
"""A rate above that of any damper [1/s]."""
OVERLAP = 0.01
"""Overlap at the start up to which there is no warning, as a fraction of the spacing."""


class BodyContact(WithHistory):
    """Contact of points on the surfaces of bodies with facets of other bodies, in one world or many.

    Facets near a point are listed; a frame whose lists became invalid is repeated, see `NeighborList`. In an
    ensemble the forces in each world equal those of a single run, to the last bit: they are summed as integers,
    and listed facets without contact have no effect.

    The arrays have four owners: `surfaces` (constants), `rules` (by kinds of bodies), `neighbors` (rebuilt lists)
    and the effect itself (its history, in checkpoints). If `contact_forces`, the forces of bodies on each other's
    particles are summed in `impulse`. Vertices and areas are those for particles at `shape` [m], a motion's start.
    """

    def __init__(self, model: Model, rules: Sequence[Contact], contact_forces: bool, shape: NDArray) -> None:
        self._model, self._dt = model, 0.0
        on_host, each = contact_surfaces(model.system, shape), Repeated(model)
        self.rules = ContactRules(model, on_host, rules)
        surfaces = self.surfaces = ContactSurfaces(model, on_host, shape)
        for one in surfaces.by_row:
            self.rules.check(one)
        scalar, device = model.scalar, model.device
        data = self._data = BodyContactData(scalar)()
        self.rules.upload(data.rules, model, each)
        surfaces.upload(data.surfaces, model, each, self.rules.hops(on_host))
        self._points = model.worlds * len(on_host.ends)
        self.set_up_history(model, data.history, self._points, "touch", {"fastest": scalar})
        thickness, stiffness, units = self.rules.thickness, self.rules.stiffness, []
        thickest = 0.0
        for one in surfaces.by_row:
            own = 2.0 * float(one.radius.max(initial=0.0)) if (thickness < 0).any() else 0.0
            reach = max(own, thickness.max(), 0.0)
            thickest = max(thickest, reach)
            stiffest = max(float(one.stiffness.max(initial=0.0)), stiffness.max(), 0.0)
            units.append(unit_of_sums(stiffest * reach))
        self.blocks = self.rules.blocks(surfaces)
        """Additions to diagonal blocks of K [N/m] of each particle, as scalars, by world."""
        self.term = body_contact_term(model.dim, scalar, model.compensated)
        self.data = self.term.Data()
        self.members = surfaces.by_particle(self.data, model)
        self.data.force, self.data.unit = data.surfaces.force, units[0]
        if model.in_worlds:
            self.by_world = ("force",)
            data.surfaces.bodies_each = len(on_host.solid)
            data.surfaces.unit = each.by_row(np.array(units)[:, None], wp.float64)
        self.impulse = wp.zeros(model.particle_count, dtype=wp.vec3d, device=device) if contact_forces else None
        """Impulse of other bodies on each particle since it was zeroed [N s]; None unless requested."""
        self.planes = DivisionPlanes(model, surfaces, data, each, self.rules, self.impulse)
        model.kernels.note(self._kernel(measuring=True), block=BLOCK)
        self.neighbors = NeighborList(model, surfaces, data, each, self.planes, thickest)
        self._flags, self.nothing = self.neighbors.flags, wp.zeros(0, dtype=wp.float64, device=device)
        self._found = wp.empty_like(self._flags, device="cpu", pinned=True) if device.is_cuda else self._flags
        self.held_back = np.zeros(model.worlds)
        """Largest displacement that contact prevented in a substep of the last frame [m], by world."""
        self.deepest = 0.0
        """Deepest overlap in the last frame [m]."""
        self.frozen = np.zeros(model.worlds, dtype=bool)
        """Whether each world was frozen before the last frame: its lists may be invalid."""
        self.shared_points = self._points
        self.touches = False
        """Whether any bodies touch at the start."""
        self._overlapping: str | None = None
        self._release_initial_overlap()
        self.planes.start()

    def lanes(self, triangles: bool) -> int:
        """Return the number of threads per point, if facets are `triangles` or not; as many as in a single run."""
        if not self._model.device.is_cuda:
            return 1
        if not triangles:
            return GRAINS_ON_GPU if self.surfaces.grains else FEW_ON_GPU
        return ON_GPU if self._points <= MOST_BY_MORE * self._model.worlds else MANY_ON_GPU

    @property
    def on_device(self) -> tuple[Any, Any]:
        """The two arguments of contact kernels: the struct of all data, and the tree of facets."""
        return self._data, self.neighbors.tree

    def _release_initial_overlap(self) -> None:
        """Find points that start too near to other bodies, and allow the overlap of their shells, which shrinks.

        Raises ValueError if bodies in an ensemble overlap, since ensembles have no depenetration.
        """
        model, surfaces, data = self._model, self.surfaces.on_host, self._data
        x = model.vectors()
        x.assign(model.spread(model.row_of("position").astype(model.dtype)))
        stored = self._stored_and_heated(x, model.vectors())[0].numpy()
        points, bodies = np.flatnonzero(stored), len(surfaces.solid)
        self.touches = bool(len(points))
        if not len(points):
            return
        a, neighbors = data.surfaces.body.numpy()[points], data.neighbors
        b = neighbors.body_pairs.numpy()[a, neighbors.candidate_pair.numpy()[points, 0]]
        density, (worlds, a), b = data.surfaces.density.numpy()[points], np.divmod(a, bodies), b % bodies
        stiffness = np.array([one.stiffness for one in self.surfaces.by_row])
        row = worlds % len(stiffness)
        k = self.rules.pair_stiffness(a, b, stiffness[row, a], stiffness[row, b])
        deep = np.sqrt(2 * stored[points] / (k * density))
        excess = deep / np.maximum(np.maximum(surfaces.spacing[a], surfaces.spacing[b]), self.neighbors.farthest)
        p = int(np.argmax(excess if model.in_worlds else deep))
        if not excess[p] > OVERLAP:
            return
        one, other = (int(np.argmax(surfaces.body_of_particle == body[p])) for body in (a, b))
        if model.in_worlds:
            raise ValueError(
                f"in world {worlds[p]} the body of particle {one} starts {deep[p]:.3g} m inside "
                f"that of particle {other}; the bodies of each world of an ensemble must start apart"
            )
        allowed = np.zeros(self._points)
        allowed[points] = deep
        self.allow(allowed)
        self.done = data.history.done = wp.zeros(self._points, dtype=wp.float64, device=model.device)
        way_out = "move them apart, or have them ignore each other by Contact(groups=..., exclude=True)"
        if a[p] == b[p]:  # its facets may be smaller than its contact is thick
            way_out = "use sheet or cloth, a coarser surface, or less thickness by Contact(thickness=...)"
        self._overlapping = (
            f"the body of particle {one} starts {deep[p]:.3g} m inside "
            f"{'itself' if a[p] == b[p] else f'that of particle {other}'} ({len(points)} points of surfaces start "
            f"inside bodies): they are moved apart within {SEPARATION_TIME} s, unless their contact meshes cross; "
            f"{way_out}"
        )

    def overlapping(self) -> str | None:
        """Return a warning about the bodies that overlap most at the start; None if none do."""
        return initial_containment(self._model.system, self.surfaces.on_host, self.rules) or self._overlapping

    def tear(self, broken_at: wp.array) -> None:
        """Leave out facets whose springs have broken; `broken_at` as in `Fracture`."""
        given = self.surfaces.on_host, self._data, self.planes.pairs
        self.neighbors.torn = TornFacets(self._model, *given, broken_at)

    def use_launcher(self, launcher: Launcher) -> None:
        """Let `launcher` divide searches and contact forces among CPU threads."""
        self.neighbors.launcher = launcher

    def begin(self, substeps: int, dt: float) -> None:
        """Set the length of substeps [s]."""
        self._dt = dt
        self.neighbors.begin(dt)
        self._model.kernels.note(*(self._kernel(measuring) for measuring in (False, True)), block=BLOCK)
        if self.impulse is not None:
            self._model.kernels.note(self._add_impulses())

    def make_room(self, x: wp.array, v: wp.array) -> None:
        """Reserve room for the facets near each point, since a search between frames cannot be repeated."""
        self.neighbors.make_room(x, v)

    def hold(self, time: float) -> None:
        """Invalidate the neighbor lists, since particles may have been moved; `time` is not used."""
        self.neighbors.invalidate()

    @property
    def recorded_for(self) -> tuple[int, bool, tuple[bool, bool]]:
        """What recorded launches depend on: how often searches begin, their reach, how pairs are kept apart."""
        return self.neighbors.skin.check_every, self.neighbors.overruns.any, self.planes.recorded_for

    def begin_substep(self, substep: int) -> bool:
        """Pass the number of the coming substep to the neighbor list."""
        self.neighbors.substep = substep
        return False

    def search(
        self, x: wp.array, v: wp.array, compensation: Any, after: float, begins: bool, frame_begins: bool
    ) -> None:
        """Launch the update of vertices, and the search of the facets near each point if it is due."""
        self.neighbors.search(x, v, compensation, after, begins, frame_begins)

    def place_vertices(self, x: wp.array, v: wp.array) -> None:
        """Launch the update of vertices between frames, for positions x and velocities v."""
        self.neighbors.place(x, v, None)

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the contact forces for positions x and velocities v."""
        self._evaluate(False, [self._dt if begins else 0.0, DAMPING / self._dt], [self.nothing, self.nothing])

    def _evaluate(self, measuring: bool, times: list[float], sums: list[wp.array]) -> None:
        """Launch a kernel over the active points, which exerts contact forces or, if `measuring`, sums energies.

        `times` are fields of the kernels' `Substep`; `sums` take stored energy [J] and dissipated power [W].
        """
        model, lanes = self._model, self.lanes(self.surfaces.triangles or measuring)
        inputs = [self._data, *times, 1.0 / self.data.unit, self.neighbors.skin.on_device]
        at_a_time = model.device.sm_count * BLOCKS * BLOCK  # on a GPU: further threads would only start and end
        kernel = self._kernel(measuring)
        self.neighbors.launch_parts(kernel, lanes * self._points, inputs, [self._flags, *sums], at_a_time, BLOCK)

    def _kernel(self, measuring: bool) -> Any:
        """Return the kernel that `_evaluate` launches."""
        model, surfaces = self._model, self.surfaces
        triangles = surfaces.triangles or measuring
        composed = model.scalar, self.overlapping_at_start, self.lanes(triangles), model.in_worlds
        if triangles:
            return evaluate_contact(*composed, measuring)
        return evaluate_segments_and_spheres(*composed, surfaces.grains)

    def add_up(self, seconds: float) -> None:
        """Launch the addition of contact forces times `seconds` [s] to `impulse`, if requested."""
        model = self._model
        if self.impulse is not None:
            inputs = [self.data, self.data.force, model.inverse_mass, seconds]
            wp.launch(self._add_impulses(), model.particle_count, inputs, [self.impulse], device=model.device)

    def _add_impulses(self) -> Any:
        return add_impulses(self._model.dim, self._model.scalar, self._model.compensated, False)

    def look(self) -> None:
        """Launch the copy of the neighbor lists' flags for `is_void`."""
        if self._found is not self._flags:
            wp.copy(self._found, self._flags)
            self._flags.zero_()

    def will_be_void(self) -> bool:
        """Return whether lists have become invalid in the frame that runs."""
        return not self.neighbors.hold(self._flags.numpy().reshape(-1, FLAGS), ~self.frozen)

    def is_void(self) -> bool:
        """Return whether lists became invalid in the finished frame; if so, enlarge them for its repetition."""
        flags = self._found.numpy().reshape(-1, FLAGS).copy()
        self.deepest = float(flags[:, DEEPEST].max())
        self.held_back = flags[:, HELD_BACK].astype(np.float64)
        if self._found is self._flags:
            self._flags.zero_()
        return self.neighbors.judge(flags, ~self.frozen)

    def tell_repeats(self, time: float, times: int) -> None:
        """Warn of a frame that takes long, as surfaces move so far in a substep that it is repeated many times."""
        path = self.neighbors.path
        spacings = path / (self.surfaces.on_host.spacing.max(initial=0.0) or self.neighbors.farthest)
        checks.warn(
            f"the frame from {time:.4g} s on takes long: it has begun {times + 1} times, since surfaces in "
            f"contact move by up to {spacings:.2g} spacings in a substep ({path:.3g} m), "
            "and more is near them each time; let springs start nearer to their rest lengths, have a seam pulled "
            "together slowly by an Actuator, or give more substeps",
            checks.StepWarning,
        )

    @property
    def changing(self) -> list[wp.array]:
        """The arrays that substeps change: the history, and the sums of `_count_touching`."""
        return [*super().changing, self._data.surfaces.touching]

    def go_on_from(self, other: Effect) -> None:
        """Copy the contact history of `other`, the effect of another model with the same bodies."""
        super().go_on_from(other)
        self._count_touching()

    def take_history(self, arrays: Mapping[str, NDArray]) -> None:
        """Take the bodies that touch, and their tangential displacements, from a `checkpoint`."""
        super().take_history(arrays)
        self._count_touching()

    def _count_touching(self) -> None:
        """Sum the densities of the touching points around each vertex, as kernels do in `pairs.crowding`."""
        data = self._data.surfaces
        those = self._data.history.contact_body.numpy()[0] >= 0
        ends, second, density = (one.numpy()[those] for one in (data.ends, data.fraction, data.density))
        touching = np.zeros(data.touching.shape, dtype=np.int64)
        for end, weight in ((0, 1 - second), (1, second)):
            np.add.at(touching[:, 0], ends[:, end], (WHOLE * weight * density).astype(np.int64))
        data.touching.assign(touching)

    def checkpoints(self) -> list[dict[str, NDArray]]:
        """Return the checkpoint of each world, with the body and facet indices of a single run."""
        surfaces, arrays, found = self.surfaces.on_host, self.checkpoint(), []
        if not self._model.in_worlds:
            return [arrays]
        points, bodies = len(surfaces.ends), len(surfaces.solid)
        for world in range(self._model.worlds):
            own = {name: values[:, world * points : (world + 1) * points] for name, values in arrays.items()}
            contact_body = own["touch.partner"]
            own["touch.partner"] = np.where(contact_body >= 0, contact_body - world * bodies, contact_body)
            found.append(own)
        return found

    @property
    def units(self) -> wp.array:
        """The unit in which the forces of each world of an ensemble are summed [N], shape [worlds]."""
        return self._data.surfaces.unit

    def add_blocks_of_worlds(self, stiffness: wp.array) -> None:
        """Add the stiffness of contacts in worlds whose constants differ, shape [different, particle_count]."""
        each = self.blocks[np.arange(len(stiffness)) % len(self.blocks)]
        stiffness.assign(stiffness.numpy() + each[..., None, None] * np.eye(self._model.dim))

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the stiffness of contacts to diagonal blocks, as if all points were in contact.

        Dampers add nothing: kernels limit each of them so that it does not shorten the stable step.
        """
        stiffness.assign(stiffness.numpy() + self.blocks[0, :, None, None] * np.eye(self._model.dim))

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the energy that contacts store [J] and the power they dissipate [W], by world."""
        each = (one.numpy().reshape(self._model.worlds, -1) for one in self._stored_and_heated(x, v))
        energies, powers = (one.sum(axis=1) for one in each)
        return energies, powers

    def _stored_and_heated(self, x: wp.array, v: wp.array) -> list[wp.array]:
        """Return the energy that the contacts of each point store [J] and the power they dissipate [W]."""
        self.neighbors.search(x, v, None, 0.0, False, True)
        sums = [wp.zeros(self._points, dtype=wp.float64, device=self._model.device) for _ in range(2)]
        self._evaluate(True, [0.0, DAMPING / self._dt if self._dt else UNLIMITED], sums)
        return sums
