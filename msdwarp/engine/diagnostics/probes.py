"""Sensors: the sums of probes in each world, on the device at the end of each frame or substep."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import CORNERS, connection_fractions, mask_of, von_mises
from ...kernels.basis import vector
from ...kernels.integrators.stages import force_on_each
from ...kernels.reductions import probes
from ...kernels.reductions.measure import fold
from ...kernels.reductions.probes import (
    Sum,
    mean_of_function,
    sum_cell_stress,
    sum_members,
    sum_of_group,
    wrench_on_obstacle,
)
from ...kernels.reductions.spring_probes import COUNT, LARGEST, SUM, spring_sums, sum_tensions
from ...world import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    FORCE,
    POSITION,
    STRAIN,
    STRESS,
    TENSION,
    VELOCITY,
    WRENCH,
    Probe,
    probes_by,
)
from ..collision.colliders import Colliders
from ..collision.contact_forces import ContactForces
from ..collision.penetration_depth import touching
from ..device.csr import rows as by_row
from ..loads.actuators import ActuatedSprings
from ..model.model import CONSTANTS, Model
from ..model.state import State
from ..stepping.assemble import Assembly
from ..stepping.dynamics import Dynamics
from ..stepping.stages import Stage
from ..stepping.substep import take_stage
from ..stepping.velocities import Velocities

MOST_THREADS = 65536
"""Maximal number of summing threads on a GPU: enough to occupy it, few enough to combine quickly."""
FEW_EACH = 8
"""Members per thread in a small group: more threads would spend longer on combining their sums."""
ROWS = 64
"""Rows of partial sums that the host adds, for a single world on a GPU."""


class Sensors:
    """Measures the quantities of probes by sums on the device, `readings` times in a frame of `seconds`.

    `contact_forces` sums the contact forces, if a probe measures them.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        requested: Mapping[str, Probe],
        readings: int,
        seconds: float,
        contact_forces: ContactForces | None,
    ) -> None:
        self._dynamics, self._state, model = dynamics, state, dynamics.model
        self._model, self._seconds = model, seconds / readings
        self._sums, first, assembly = list[_Sum | _SpringSum | _StressSum | _WrenchSum](), 0, dynamics.assembly
        for name, probe in requested.items():
            if probe.what == STRESS:
                self._sums.append(_StressSum(model, name, probe, first))
            elif probe.what == WRENCH:
                assert contact_forces is not None
                self._sums.append(_WrenchSum(model, name, probe, first, assembly.colliders, contact_forces))
            elif probe.what in (STRAIN, TENSION):
                self._sums.append(_SpringSum(model, name, probe, first, assembly))
            else:
                self._sums.append(_Sum(model, name, probe, first))
            first += self._sums[-1].width
        asked = {one.what for one in self._sums}
        self.moves = bool(asked & {VELOCITY, FORCE, TENSION})
        """Whether probes need velocities at the time of the positions."""
        self._force = model.vectors() if FORCE in asked else None
        of_contact = asked & {CONTACT_FORCE, BODY_CONTACT_FORCE, WRENCH}
        self._contact_forces = contact_forces if of_contact else None
        on_gpu = model.device.is_cuda
        shape = (readings, model.worlds, ROWS if on_gpu and not model.in_worlds else 1, first)
        self._rows = wp.zeros(shape, dtype=wp.float64, device=model.device)
        # The copy that the host reads: on a GPU in pinned memory.
        self._found = wp.empty_like(self._rows, device="cpu", pinned=True) if on_gpu else self._rows

    def launch(self, v: wp.array, k: int = 0) -> None:
        """Launch the sums of reading k of a frame; a graph may record it.

        v are velocities at the time of the positions [m/s]; they are read only if `moves` is true.
        """
        now, rows = self._state.state_in, self._rows[k]
        assert isinstance(rows, wp.array)
        if self._force is not None:
            fields = {"compensation": now.compensation, "x": now.x, "v": v, "force": self._force}
            take_stage(self._dynamics, Stage(force_on_each, fields))
        places = {"value": now.x, "lost": now.compensation.x}
        state = dict.fromkeys((POSITION, STRAIN, STRESS), places)
        state |= {VELOCITY: {"value": v, "lost": now.compensation.v}, FORCE: {"value": self._force}}
        state[TENSION] = places | {"v": v, "v_lost": now.compensation.v}
        if self._contact_forces is not None:
            state[CONTACT_FORCE] = {"value": self._contact_forces.by_all()}
            state[BODY_CONTACT_FORCE] = {"value": self._contact_forces.by_bodies}
            state[WRENCH] = {"value": self._contact_forces.by_obstacles}
        for one in self._sums:
            given = state[one.what]
            if isinstance(one, _WrenchSum):
                given = one.state(now.x, k if len(self._rows) > 1 else -1) | given
            elif isinstance(one, _SpringSum) and one.actuated is not None:
                given = given | {"strain": one.actuated.data.strain, "row": self._dynamics.scene.stage}
            for part in one.parts:
                part.launch(rows, **given)
        if k == len(self._rows) - 1 and self._found is not self._rows:
            wp.copy(self._found, self._rows)

    def read(self) -> dict[str, NDArray[np.float64]]:
        """Wait for the device, and return the readings of the last launched frame, by the names of probes.

        Their shape is [readings, d], in an ensemble [readings, worlds, d].
        """
        if self._model.device.is_cuda:
            wp.synchronize_stream(self._model.device.stream)
        rows: Any = self._found.numpy()
        return {one.name: one.reading(rows, self._seconds) for one in self._sums}


class _Part:
    """A sum in each world, whose numbers are columns of a table of sums, starting at `first`.

    A term takes as long as `work` particles; `fields` are those of its data that do not change.
    """

    def __init__(self, model: Model, of: Sum, count: int, first: int, work: int = 1, **fields: Any) -> None:
        self._kernel, self._data, self._count, self._first = sum_members(of), of.Data(), count, first
        model.kernels.note(self._kernel, fold)
        self._largest, device = of.largest, model.device
        self._data.stride = model.stride
        for name, value in fields.items():
            setattr(self._data, name, value)
        most = max(MOST_THREADS // model.worlds, 1)
        threads = min(max(work * count // FEW_EACH, 1), most) if device.is_cuda else 1
        self._partial = wp.zeros((model.worlds, threads, of.columns), dtype=wp.float64, device=device)

    def launch(self, rows: wp.array, **state: Any) -> None:
        """Launch the sum for a state, given as fields of the data, and its addition into a few rows."""
        for name, value in state.items():
            setattr(self._data, name, value)
        partial = self._partial
        wp.launch(self._kernel, partial.shape[:2], [self._data, self._count], [partial], device=partial.device)
        threads, where = (*rows.shape[:2], partial.shape[2]), [self._largest, self._first]
        wp.launch(fold, threads, [partial, *where], [rows], device=partial.device)


def _springs(model: Model) -> dict[str, Any]:
    """Return the fields of the data of `spring_sums` that all sums have in common."""
    return {"connections": model.connections} | {name: model.table(name) for name in CONSTANTS}


class _Sum:
    """The sums for one probe: columns of the table of all probes' sums, starting at `first`."""

    def __init__(self, model: Model, name: str, probe: Probe, first: int) -> None:
        self.name, self.what, self._first, self._model = name, probe.what, first, model
        member = np.flatnonzero(probe.particles(model.system))
        weight, self._mass = _weights(self.what, model.row_of("mass")[:, member])
        fields: dict[str, Any] = {"weight": wp.array(weight, dtype=wp.float64, device=model.device)}
        wide = self.what in (CONTACT_FORCE, BODY_CONTACT_FORCE)
        of = sum_of_group(model.dim, vector(model.dim, wp.float64) if wide else model.vector)
        fields["member"] = wp.array(member, dtype=int, device=model.device)
        self.width, self.parts = of.columns, [_Part(model, of, len(member), first, **fields)]

    def reading(self, rows: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
        """Return the probe's values by reading, `seconds` apart; `rows`: [readings, worlds, rows, columns]."""
        result = total = rows[..., self._first : self._first + self.width].sum(axis=2)
        if self.what in (CONTACT_FORCE, BODY_CONTACT_FORCE):  # impulses are summed since the frame's start
            result = np.diff(total, axis=0, prepend=0.0) / seconds
        elif self.what == FORCE:
            each, gravity = np.arange(self._model.worlds), self._model.row_of("gravity")
            result = total + self._mass[each % len(self._mass), None] * gravity[each % len(gravity)]
        return result if self._model.in_worlds else result[:, 0]


class _SpringSum:
    """The sums of a probe of strains or tensions: their sum, the largest, and the number of connections.

    `actuated` are the muscles among the connections; None if there are none, or strains are measured.
    """

    actuated: ActuatedSprings | None = None

    def __init__(self, model: Model, name: str, probe: Probe, first: int, assembly: Assembly) -> None:
        self.name, self.what, self._first, self._model = name, probe.what, first, model
        chosen = mask_of(probe.connections(model.system), model.connection_count)
        member = np.flatnonzero(model.ordered(chosen))
        fields: dict[str, Any] = {"tears": int(assembly.fracture is not None)}
        if self.what == STRAIN:
            of, more = spring_sums(model.dim, model.scalar)[0], _springs(model)
        else:
            place = np.full(model.connection_count, -1)
            place[model.ordered(np.arange(model.connection_count))[member]] = np.arange(len(member))
            more = {"connections": model.connection_table(model.law_forms)} | self._muscles(assembly, place)
            of = sum_tensions(model.dim, model.scalar, model.law_forms, self.actuated is not None)
        fields |= more | {"member": wp.array(member, dtype=int, device=model.device)}
        self.width, self.parts = of.columns, [_Part(model, of, len(member), first, **fields)]

    def _muscles(self, assembly: Assembly, place: NDArray[np.integer]) -> dict[str, Any]:
        """Return the fields of the data with the muscles among the members; `place` is that of a connection."""
        found = next((one for one in assembly.all if isinstance(one, ActuatedSprings)), None)
        if found is None or (place[found.connection] < 0).all():
            return {}
        self.actuated, own = found, place[found.connection]
        order, first = by_row(own[own >= 0], int(place.max()) + 1)
        given = {"entries": first, "column": found.column[own >= 0][order]}
        arrays = {name: wp.array(one, dtype=int, device=self._model.device) for name, one in given.items()}
        return arrays | {"columns": found.columns}

    def reading(self, rows: NDArray[np.float64], _seconds: float) -> NDArray[np.float64]:
        """Return mean and largest value by reading; `rows`: [readings, worlds, rows, columns]."""
        own = rows[..., self._first : self._first + self.width]
        total = own.sum(axis=2)
        count = total[..., COUNT]
        known = np.where(count > 0, count, np.nan)  # NaN if all connections are broken
        largest = np.where(count > 0, own[..., LARGEST].max(axis=2), np.nan)
        result = np.stack([total[..., SUM] / known, largest], axis=-1)
        return result if self._model.in_worlds else result[:, 0]


class _StressSum:
    """The sums of a stress probe: virials of connections, virials of cells, then volumes."""

    def __init__(self, model: Model, name: str, probe: Probe, first: int) -> None:
        self.name, self.what, self._first, self._model = name, probe.what, first, model
        self._components = probes.COMPONENTS[model.dim]
        self.width = 2 * len(self._components) + 1
        system, device = model.system, model.device
        cells, inside = system.cells, probe.cells(system)
        assert cells is not None
        fraction = model.ordered(connection_fractions(system, inside))
        chosen = np.flatnonzero(fraction)
        springs: dict[str, Any] = _springs(model) | {
            "weight": wp.array(fraction[chosen], dtype=wp.float64, device=device),
            "member": wp.array(chosen, dtype=int, device=device),
        }
        own: dict[str, Any] = {"corners": wp.array(cells.corners[inside], dtype=int, device=device)}
        for name in ("rest_volume", "modulus"):
            own[name] = wp.array(getattr(cells, name)[inside], dtype=wp.float64, device=device)
        kind, flat = (model.dim, model.scalar), cells.flat
        stress = sum_cell_stress(*kind, not flat.all(), bool(flat.any()))
        self.parts = [
            _Part(model, spring_sums(*kind)[1], len(chosen), first, **springs),
            _Part(model, stress, int(inside.sum()), first + len(self._components), CORNERS, **own),
        ]

    def reading(self, rows: NDArray[np.float64], _seconds: float) -> NDArray[np.float64]:
        """Return stress components and von Mises stress by reading; `rows`: [readings, worlds, rows, columns]."""
        total, count = rows[..., self._first : self._first + self.width].sum(axis=2), len(self._components)
        mean = (total[..., :count] + total[..., count:-1]) / total[..., -1:]
        tensor = np.empty((*mean.shape[:-1], self._model.dim, self._model.dim))
        for k, (a, b) in enumerate(self._components):
            tensor[..., a, b] = tensor[..., b, a] = mean[..., k]
        result = np.concatenate([mean, von_mises(tensor)[..., None]], axis=-1)
        return result if self._model.in_worlds else result[:, 0]


class _WrenchSum:
    """The sums of a probe on an obstacle: impulses on it, and their moments about its centre."""

    def __init__(
        self, model: Model, name: str, probe: Probe, first: int, colliders: Colliders, forces: ContactForces
    ) -> None:
        self.name, self.what, self._first, self._colliders = name, probe.what, first, colliders
        of = wrench_on_obstacle(model.dim, model.scalar, colliders.kinds, colliders.moves)
        fields = {
            "mass": forces.mass,
            "solids": colliders.data.solids,
            "obstacle_count": len(colliders.solids),
            "obstacle": next(p for p, one in enumerate(colliders.solids) if one is probe.on),
            "centre": model.vector(*probe.on.center(model.dim)),
            "slack": touching(model.system),
        }
        self.width, self.parts = of.columns, [_Part(model, of, model.particle_count, first, **fields)]

    def state(self, x: wp.array, substep: int) -> dict[str, Any]:
        """Return the fields of the data that differ between readings: at the end of a substep, or −1: the last."""
        poses = self._colliders.data
        if not self._colliders.moves:
            return {"x": x}
        row = substep + 1 if substep >= 0 else poses.turn.shape[0] - 1
        return {"x": x, "turn": poses.turn, "shift": poses.shift, "row": row}

    def reading(self, rows: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
        """Return force [N] and torque [N m] by reading, `seconds` apart; `rows`: [readings, 1, rows, columns]."""
        total = rows[..., self._first : self._first + self.width].sum(axis=2)[:, 0]
        return np.diff(total, axis=0, prepend=0.0) / seconds


class GroupMeans:
    """Unweighted mean of a function over chosen particles, in each world; see `mean_of_function`."""

    def __init__(self, model: Model, function: Any, chosen: NDArray[np.bool_], width: int) -> None:
        of = mean_of_function(model.dim, model.scalar, function, width)
        member = wp.array(np.flatnonzero(chosen), dtype=int, device=model.device)
        self._part = _Part(model, of, len(member), 0, member=member)
        self._means = wp.zeros((model.worlds, 1, of.columns), dtype=wp.float64, device=model.device)

    def read(self, state: State, v: wp.array) -> NDArray[np.float64]:
        """Return the means, shape [worlds, columns]; v are velocities at the time of the positions [m/s]."""
        lost = state.compensation
        self._part.launch(self._means, x=state.x, v=v, x_lost=lost.x, v_lost=lost.v)
        return self._means.numpy()[:, 0].astype(np.float64)


def _weights(what: str, mass: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return weights of a group's particles, and the free particles' total mass [kg], for each row of masses."""
    free = np.where(np.isfinite(mass), mass, 0.0)
    total = free.sum(axis=1)
    if what in (FORCE, CONTACT_FORCE, BODY_CONTACT_FORCE):
        return np.ones((1, mass.shape[1])), total
    each = free / np.where(total > 0, total, 1.0)[:, None]
    return np.where(total[:, None] > 0, each, 1.0 / mass.shape[1]), total


def sensors_of(
    dynamics: Dynamics,
    state: State,
    every: str,
    readings: int,
    seconds: float,
    contact_forces: ContactForces | None,
) -> Sensors | None:
    """Return the sensors that are read every "frame" or every "substep"; None if there are none."""
    requested = probes_by(every, dynamics.assembly.probes)
    return Sensors(dynamics, state, requested, readings, seconds, contact_forces) if requested else None


def measure_substep(sensors: Sensors, dynamics: Dynamics, now: State, velocities: Velocities, k: int) -> None:
    """Launch the probes that measure at the end of each substep."""
    with dynamics.measuring():
        sensors.launch(velocities.read() if sensors.moves else now.v, k)
