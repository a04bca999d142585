"""Model: the constant part of a system on a device."""

from collections.abc import Mapping
from math import lcm
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ... import checks
from ...bodies import LawKinds, System, each_law, is_uniform, stored, uniform_like
from ...kernels.basis import vector
from ...kernels.records import record_length
from ...kernels.springs.constants import CONSTANTS as CONSTANTS
from ...kernels.springs.dampers import law_numbers
from ...kernels.springs.spring_laws import Laws, connection_table, forms_of, numbers_of
from ...runtime import Kernels, find_device, in_turn
from ...world import Falling, Gravity, with_potential
from ..device.device import PRECISIONS, scalar_array, view_of
from ..device.vector_arrays import records_together
from .algorithm_choice import AUTO, choose_force_algorithm, ensemble_force_algorithm, scatter_order

Rows = Mapping[str, Any]
"""Parameters that differ between worlds, by name: world w uses row w mod (number of rows)."""
LINE = 8
"""Particles in a cache line of a GPU; each world begins at a new line."""
MOST_RECORDS = 2**31 - 1
"""Maximal number of particles of all worlds, from 32-bit indices."""


class Model:
    """The part of a system that substeps read but never change, on a device, in one world or many.

    Vectors of many worlds are concatenated, `stride` particles apart. Constants that differ between worlds are in
    `rows`; worlds share all others. An `Assembly` adds the effects on the system.

    `system` is the simulated system, common to all worlds. `gravity`, `device`, `precision` and `force_algorithm`
    are as for `msdwarp.Simulation`; time-dependent gravity is a load, `falling`. `driven` is the mask of particles
    with prescribed motions.

    `rows` differ between worlds: rest_length, stiffness, damping of shape [rows, connection_count]; mass
    [rows, particle_count]; gravity [rows, d]; friction [rows, collider_count]; position, velocity
    [rows, particle_count, d]; delay [rows, actuator_count, particle_count]; strain: a `StrainRows`. Each number of
    rows divides `worlds`. For a single world `rows` is None.

    Raises ValueError if an argument is out of range, or a stencil is requested for a system that is no lattice.
    """

    generation = 0
    """Increases when a kernel or an argument of its launches is replaced: recorded graphs are then invalid."""

    @in_turn
    def __init__(
        self,
        system: System,
        *,
        gravity: Gravity = 9.82,
        driven: NDArray[np.bool_] | None = None,
        device: str | None = None,
        precision: str = "float32",
        force_algorithm: str = "auto",
        worlds: int = 1,
        rows: Rows | None = None,
    ) -> None:
        checks.one_of("precision", precision, PRECISIONS)
        self.device = find_device(device)
        self.kernels = Kernels(self.device)
        self.precision = precision
        self.scalar, self.dtype = PRECISIONS[precision]
        self.worlds, self.in_worlds, self.rows = worlds, rows is not None, dict(rows or {})
        self.tables = dict[str, wp.array]()
        """Tables that `table` has uploaded; effects that change constants store their own arrays here."""
        if self.in_worlds:
            # The largest mass and damping of all worlds: a pin or damper in one world needs code in all.
            largest = {name: self.rows[name].max(axis=0) for name in ("mass", "damping") if name in self.rows}
            first = {name: self.rows[name][0] for name in ("position", "velocity") if name in self.rows}
            if force_algorithm == AUTO:
                force_algorithm = ensemble_force_algorithm(system, on_gpu=self.device.is_cuda)
                if force_algorithm == "stencil" and (system.tears or not self._is_alike_by_direction(system)):
                    force_algorithm = "gather"
            system = system.replace(**largest, **first)
        self.dim = system.dim
        self.vector = vector(self.dim, self.scalar)
        self.particle_count = system.particle_count
        self.connection_count = system.connection_count

        self.system = system
        self.force_algorithm, self.lattice = choose_force_algorithm(
            system, force_algorithm, on_gpu=self.device.is_cuda
        )
        # A stencil also reads missing neighbours, at most `margin` particles beyond the ends; rounded up to cache
        # lines (128 bytes).
        self.margin = -(-self.lattice.margin // 8) * 8 if self.lattice else 0

        self.compensated = precision == "float32-compensated"
        # Code for features that a scene lacks is not compiled.
        laws, count = (system.spring, system.damper), self.connection_count
        (springs, spring), (dampers, damper) = (each_law(law, count) for law in laws)
        several = any(isinstance(law, LawKinds) for law in laws)
        damper_forms, spring_forms = (forms_of([law.law for law in of]) for of in (dampers, springs))
        self.law_forms = Laws(damper_forms, spring_forms, several)
        """The forms of laws, with that of dampers, even if there is no damping."""
        self.laws = self.law_forms if system.damping.any() else self.law_forms._replace(damper=None)
        self._law_rows = [numbers_of(one.law, other.law, self.law_forms) for other in dampers for one in springs]
        self._law_data = dict[Any, Any]()
        self.law_number: Any = np.float64(len(springs)) * damper + spring if several else None
        """If there are several laws, the number of each connection's law, shape [connection_count]."""
        self.driven = np.zeros(self.particle_count, dtype=bool) if driven is None else driven
        """Mask of particles with prescribed motions, shape [particle_count]."""
        # No force moves driven particles, so their mass is infinite, as for pinned ones.
        self.mass = np.where(self.driven, np.inf, system.mass) if self.driven.any() else system.mass
        self.pinned = bool(np.isinf(self.mass).any())
        if "mass" in self.rows and self.driven.any():
            self.rows["mass"] = np.where(self.driven, np.inf, self.rows["mass"])

        self.fall(with_potential(gravity))
        self.falling = Falling(gravity, on=np.isfinite(self.mass)) if callable(gravity) else None
        """The particles' weight as a load, if gravity changes with time."""
        self._check_masses()
        self.inverse_mass = self._upload(uniform_like(1.0 / self.mass, self.mass), "1 / mass")
        self.order = scatter_order(system) if self.device.is_cuda and self.force_algorithm == "scatter" else None
        """Index in the system of each connection on the device; None if both orders are equal."""
        self.connections = wp.array(self.ordered(system.connections), dtype=wp.vec2i, device=self.device)
        self.law_each = None
        if self.law_number is not None:
            self.law_each = wp.array(self.ordered(self.law_number), dtype=wp.uint8, device=self.device)
        rest_length = system.rest_length
        if self.system.yields:  # a number for each connection
            rest_length = np.array(rest_length)
        self.rest_length = self._upload(self.ordered(rest_length), "rest_length")
        self.stiffness = self._upload_unbroken(system.stiffness, "stiffness")
        self.damping = self._upload_unbroken(system.damping, "damping")
        # An explicit step must be stable at the steepest slope of a damping law.
        slope = system.damper.steepest
        self.steepest_damping = self.damping
        if self.laws.damper and np.any(slope != 1):
            steepest = slope * system.damping
            steepest = steepest if np.ndim(slope) else uniform_like(steepest, system.damping)
            self.steepest_damping = self._upload_unbroken(steepest, "damping")
        for name, values in self.rows.items():
            if isinstance(values, np.ndarray):
                self.check_range(values[np.isfinite(values)], name)
        if worlds * self.stride + 2 * self.margin > MOST_RECORDS:
            most = (MOST_RECORDS - 2 * self.margin) // self.stride
            raise ValueError(
                f"worlds is {worlds}; it must be at most {most} of {self.particle_count} particles each"
            )

    def fall(self, gravity: ArrayLike) -> None:
        """Set gravity [m/s²]; callers that cached its value must read it again. Raises ValueError if invalid."""
        towards = checks.gravity("gravity", gravity, self.dim)
        self.check_range(towards, "gravity")
        self.gravity = self.vector(*towards)
        self.tables.pop("gravity", None)
        self.generation += 1

    def _is_alike_by_direction(self, system: System) -> bool:
        """Return whether connections of a direction have equal constants in each world, as a stencil needs."""
        rows = [self.rows[name] for name in CONSTANTS if name in self.rows and self.rows[name].strides[1] != 0]
        parts = [part for body in system.directions for part in body.values()]
        return all((values[:, part] == values[:, part][:, :1]).all() for values in rows for part in parts)

    @property
    def stride(self) -> int:
        """Index distance between the first particles of successive worlds."""
        return -(-(self.particle_count + self.margin) // LINE) * LINE if self.in_worlds else self.particle_count

    @property
    def stride_in_bytes(self) -> int:
        """`stride` in bytes."""
        return self.stride * record_length(self.dim) * wp.types.type_size_in_bytes(self.scalar)

    @property
    def different(self) -> int:
        """Number of worlds with different parameters: world w has the parameters of world w mod `different`."""
        return lcm(*map(len, self.rows.values()))

    def row_of(self, name: str) -> NDArray[np.float64]:
        """Return the rows of a parameter, shape [rows, ...]: one row if all worlds have the same."""
        if name in self.rows:
            return self.rows[name]
        if name == "gravity":
            return np.array(list(self.gravity), dtype=np.float64)[None]
        return np.asarray(self.mass if name == "mass" else getattr(self.system, name))[None]

    def _check_masses(self) -> None:
        """Raise ValueError for a mass whose inverse is out of range in this precision: 0 would pin a particle."""
        mass, numbers = self.system.mass, np.finfo(self.dtype)
        # Inverses must be normal numbers: some devices flush smaller ones to 0.
        least, most = 1.0 / float(numbers.max), 1.0 / float(numbers.tiny)
        one = stored(mass)
        fits = np.isinf(one) | ((one >= least) & (one <= most))
        if not fits.all():
            allowed = f"from {least:.2g} to {most:.2g} in {self.precision}, or inf, which pins the particle"
            checks.every("mass", mass, np.broadcast_to(fits, mass.shape), allowed)

    def check_range(self, values: NDArray[np.float64], name: str) -> None:
        """Raise ValueError if a value is too large for this precision."""
        most = float(np.finfo(self.dtype).max)
        checks.within(name, values, (lambda v: np.abs(v) <= most, f"at most {most:.2g} in {self.precision}"))

    def ordered(self, values: NDArray) -> NDArray:
        """Return values of connections, given in the system's order, in the device's order."""
        return values if self.order is None or is_uniform(values) else values[self.order]

    def in_system_order(self, values: NDArray) -> NDArray:
        """Return values of connections, given in the device's order, in the system's order."""
        if self.order is None:
            return values
        result = np.empty_like(values)
        result[self.order] = values
        return result

    def vectors(self) -> wp.array:
        """Return an array of zeros with a vector for each particle, in the records of `msdwarp.kernels.records`.

        Kernels may read up to `margin` particles before the first and after the last.
        """
        return self.vectors_together(1)[0]

    def vectors_together(self, count: int) -> tuple[wp.array, ...]:
        """Return `count` arrays like `vectors`, in one shared allocation (`_ref`) if Warp allows its size."""
        each = self.worlds * self.stride  # including the gaps between worlds
        return records_together(count, each, self.dim, self.scalar, self.device, self.margin)

    def of_each_world(self, rows: NDArray) -> NDArray:
        """Return values of connections, given by row, for all worlds in the device's order, concatenated."""
        return self.of_each(self.ordered(rows.T).T).ravel()

    def upload_rows(self, values: NDArray[np.float64]) -> wp.array:
        """Upload numbers of shape [rows, count]; a uniform row is stored as one number (a broadcast array)."""
        if values.shape[1] < 2 or values.strides[1] != 0:
            return wp.array(np.ascontiguousarray(values), dtype=self.scalar, device=self.device)
        once = wp.array(np.ascontiguousarray(values[:, 0]), dtype=self.scalar, device=self.device)
        return view_of(once, values.shape, (wp.types.type_size_in_bytes(self.scalar), 0))

    def table(self, name: str) -> wp.array:
        """Return a parameter on the device; world w reads row w mod (number of rows).

        Parameters: `inverse_mass`, shape [rows, particle_count]; a constant of connections, in the device's order,
        shape [rows, connection_count]; or `gravity`, shape [rows].
        """
        if name in self.tables:
            return self.tables[name]
        if name == "gravity":
            table = wp.array(self.row_of(name), dtype=self.vector, device=self.device)
        elif not self.in_worlds:
            array = getattr(self, name)
            table = view_of(array, (1, len(array)), (0, array.strides[0]))
        elif name == "inverse_mass":
            table = self.upload_rows(1.0 / self.row_of("mass"))
        else:
            rows = self.row_of(name.removeprefix("steepest_"))
            rows = self.system.damper.steepest * rows if name == "steepest_damping" else rows
            table = self.upload_rows(self.ordered(rows.T).T)
        self.tables[name] = table
        return table

    def with_law(self, data: Any, scalar: Any = None) -> Any:
        """Return a struct of springs with the numbers of their law; if all are linear it has none."""
        if "law" in data._cls.vars:
            kind, rows = law_numbers(scalar or self.scalar), self._law_rows
            if kind not in self._law_data:
                several = self.law_number is not None
                self._law_data[kind] = wp.array(rows, kind, device=self.device) if several else kind(*rows[0])
            data.law = self._law_data[kind]
        if "number" in data._cls.vars:
            data.number = self.law_each
        return data

    def connection_table(self, laws: Laws, damping: str = "damping") -> Any:
        """Return the connections and their constants, which may differ by world, for kernels that measure."""
        kind, _ = connection_table(self.scalar, laws)
        table = self.with_law(kind(), wp.float64)
        table.ends, table.damping = self.connections, self.table(damping)
        table.rest_length, table.stiffness = self.table("rest_length"), self.table("stiffness")
        return table

    def by_world(self, vectors: NDArray) -> NDArray:
        """Return a view of shape [worlds, particle_count, d] of a host copy of an array made by `vectors`."""
        return vectors.reshape(self.worlds, self.stride, self.dim)[:, : self.particle_count]

    def of_each(self, rows: NDArray) -> Any:
        """Return the row of each world, shape [worlds, ...]; for a single world its row, without this axis."""
        if self.in_worlds:
            return rows if len(rows) == self.worlds else rows[np.arange(self.worlds) % len(rows)]
        return rows[0].item() if rows.ndim == 1 else rows[0]

    def spread(self, values: NDArray) -> NDArray:
        """Return vectors, shape [rows, particle_count, d], repeated for all worlds, in the layout of `vectors`."""
        if values.shape[:2] == (self.worlds, self.stride):
            return values.reshape(-1, self.dim)
        flat = np.zeros((self.worlds, self.stride, self.dim), dtype=values.dtype)
        rows = len(values)
        flat.reshape(self.worlds // rows, rows, self.stride, self.dim)[:, :, : self.particle_count] = values
        return flat.reshape(-1, self.dim)

    def _upload_unbroken(self, values: NDArray[np.float64], name: str) -> wp.array:
        """Upload values of connections, with 0 for broken ones; stored one by one if connections can break."""
        if self.system.tears:
            values = np.where(self.system.broken, 0.0, values)
        return self._upload(self.ordered(values), name)

    def _upload(self, values: NDArray[np.float64], name: str) -> wp.array:
        self.check_range(values, name)
        return scalar_array(values, self.scalar, self.device)
