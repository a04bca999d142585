"""The host side of the algorithms that sum spring forces: scatter, gather and stencil.

Each class has `force_algorithm`, its composed device functions, and `data`, the struct that these read; see
`msdwarp.kernels.springs`.
"""

from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import is_uniform
from ...kernels.springs import tables
from ...kernels.springs.constants import CONSTANTS, KIND_SHIFT
from ...kernels.springs.gather import CHUNK, SLICE, gather
from ...kernels.springs.lanes import MOST_NEIGHBOURS, stencil_of_lanes
from ...kernels.springs.scatter import scatter
from ...kernels.springs.stencil import stencil, stencil_rows
from ..device.device import upload_fields
from ..device.vector_arrays import in_records
from ..model.lattice import Lattice, find_kinds
from ..model.model import Model
from .fracture import Fracture

MANY_NEIGHBOURS = 12
"""Number of neighbours per particle above which several threads per particle save more time."""
LANES = {
    ("stencil", "many"): ((32, 8), (64, 4), (350, 1), (1_024, 4), (12_000, 8), (30_000, 4)),
    ("stencil", "few"): ((32, 8), (64, 4), (4_096, 1), (30_000, 4)),
    ("gather", "many"): ((20_000, 8), (32_000, 4)),
    ("gather", "few"): ((32, 8), (64, 4), (350, 1), (1_024, 4), (2_048, 1), (20_000, 4)),
}
"""(maximal particle count, threads per particle) by algorithm and number of neighbours; above these, 1 thread.

From measurements on an H200. For some sizes in between one thread per particle is fastest, because one block or
cluster advances such systems for a whole frame.
"""


class Scatter:
    """The scatter algorithm: a thread per spring."""

    def __init__(self, model: Model, fracture: Fracture | None = None) -> None:
        storage, fields = stored_constants(model)
        kinds = (model.dim, model.scalar, model.laws, model.compensated, storage)
        self.force_algorithm = scatter(*kinds, fracture and fracture.breaking)
        self.data = model.with_law(self.force_algorithm.Forces())
        self.data.f, self.data.connections = model.vectors(), model.connections
        for name, value in fields.items():
            setattr(self.data.constants, name, value)
        if fracture is not None:
            joined = self.data.connections = wp.clone(model.connections)
            fracture.carry_out(joined, partial(_join_with_themselves, fracture, joined))


def _join_with_themselves(fracture: Fracture, connections: wp.array) -> None:
    """Replace the second particle of each broken spring by its first particle, so that its force is 0."""
    joined = np.array(connections.numpy())
    joined[fracture.broken, 1] = joined[fracture.broken, 0]
    connections.assign(joined)


class Gather:
    """The gather algorithm: a thread per particle, with a table of neighbours built on the device.

    `lanes` is the number of threads per particle; more than one needs a GPU, and springs that do not break.
    """

    def __init__(self, model: Model, fracture: Fracture | None = None, lanes: int = 1) -> None:
        storage, fields = stored_constants(model)
        packed = storage == "kinds" and model.particle_count <= 1 << KIND_SHIFT
        storage = "packed" if packed else "listed" if model.system.yields else storage
        kinds = (model.dim, model.scalar, model.laws, model.compensated, storage)
        self.force_algorithm = gather(*kinds, fracture and fracture.breaking, lanes if lanes > 1 else 0)
        self.data = model.with_law(self.force_algorithm.Forces())
        self.data.first, self.data.other, connection = neighbour_table(model)
        if packed:
            kind, other = fields.pop("kind"), self.data.other
            wp.launch(tables.pack_kinds, len(connection), [connection, kind], [other], device=model.device)
        if model.system.yields:  # rest lengths change, and both ends must read the same ones
            fields["connection"] = connection
        for name, value in fields.items():
            by_connection = storage == "own" or name == "kind" or (storage, name) == ("lengths", "rest_length")
            setattr(self.data.constants, name, _by_slot(value, connection) if by_connection else value)
        if fracture is not None:
            fracture.data.number = connection
            fracture.carry_out(self.data.other, partial(self._name_themselves, model, fracture))

    def _name_themselves(self, model: Model, fracture: Fracture) -> None:
        """Replace the neighbour in slots of broken springs by the particle itself, so that the force is 0."""
        inputs = [self.data.first, fracture.data.number, fracture.broken_at]
        kernel, outputs = tables.name_itself_where_broken, [self.data.other]
        wp.launch(kernel, model.particle_count, inputs, outputs, device=model.device)


def stored_constants(model: Model) -> tuple[str, dict[str, Any]]:
    """Return the most compact storage for the constants of springs, and the fields of its struct.

    See `msdwarp.kernels.springs.constants`.
    """
    device = model.device
    kinds = None if model.system.yields else find_kinds(model.system, model.law_number)
    if kinds is None:
        system = model.system
        uniform = not model.system.yields and not model.laws.several
        if uniform and is_uniform(system.stiffness) and is_uniform(system.damping):
            alike = {name: float(getattr(system, name)[0]) for name in ("stiffness", "damping")}
            return "lengths", {"rest_length": model.rest_length, **alike}
        own = {name: getattr(model, name) for name in CONSTANTS}
        if model.laws.several:
            own["law"] = model.law_each
        return "own", {name: wp.clone(array) if array.strides == (0,) else array for name, array in own.items()}
    table, kind = kinds
    if len(table) == 1:
        return "one", {"all": wp.types.vector(table.shape[1], model.scalar)(*map(float, table[0]))}
    held = records_of_three(model, table)
    return "kinds", {"table": held, "kind": wp.array(model.ordered(kind), dtype=wp.uint8, device=device)}


def records_of_three(model: Model, values: NDArray) -> wp.array:
    """Return values of shape [count, 3 or 4] on the device, in records of four numbers (see `kernels.records`)."""
    held = in_records(len(values), values.shape[1], model.scalar, model.device)
    held.assign(values.astype(model.dtype))
    return held


def _by_slot(values: wp.array, connection: wp.array) -> wp.array:
    """Return the value of each slot's spring; 1 for padding slots."""
    slots = wp.ones(len(connection), dtype=values.dtype, device=values.device)
    wp.launch(tables.take(values.dtype), len(connection), [connection, values], [slots], device=values.device)
    return slots


def note_tables(model: Model) -> None:
    """Note the kernels that make tables of neighbours, if the force algorithm needs these."""
    if model.force_algorithm == "gather":
        model.kernels.note(tables.list_ends, tables.name_itself, tables.fill_slots, tables.pack_kinds)


def neighbour_table(model: Model) -> tuple[wp.array, wp.array, wp.array]:
    """Return (first, other, connection): where slices of the table start, and each slot's particle and spring.

    A particle's slots are in the order of its springs, on every device. A padding slot has the particle itself,
    and −1 as its spring.
    """
    n, ends, device = model.particle_count, 2 * model.connection_count, model.device
    count = np.zeros(-(-n // SLICE) * SLICE, dtype=np.int64)
    count[:n] = np.bincount(model.system.connections.ravel(), minlength=n)
    # Each particle of a slice has as many slots as the one with most neighbours, in whole chunks.
    slots = CHUNK * SLICE * -(-count.reshape(-1, SLICE).max(axis=1) // CHUNK)
    start, first = (
        wp.array(np.append(0, np.cumsum(each)), dtype=int, device=device) for each in (count[:n], slots)
    )

    def launch(kernel: Any, threads: int, inputs: list, outputs: list) -> None:
        wp.launch(kernel, threads, inputs, outputs, device=device)

    particle, end = (wp.zeros(2 * ends, dtype=int, device=device) for _ in range(2))  # half is for sorting
    launch(tables.list_ends, model.connection_count, [model.connections], [particle, end])
    wp.utils.radix_sort_pairs(particle, end, ends)
    total = int(slots.sum())
    other = wp.zeros(total + SLICE * CHUNK, dtype=int, device=device)  # one more chunk is read without use
    connection = wp.full(total, -1, dtype=int, device=device)
    launch(tables.name_itself, len(slots), [first, n], [other])
    launch(tables.fill_slots, ends, [particle, end, start, first, model.connections], [other, connection])
    return first, other, connection


class Stencil:
    """The gather algorithm for lattices, without a table; ties are added by an effect, `ExtraSprings`.

    `lanes` is the number of threads per particle; more than one needs a GPU and a lattice without tearing that is
    uniform or `rimmed`. In an ensemble it is 0: one thread, and constants in arrays by name.
    """

    def __init__(self, model: Model, fracture: Fracture | None = None, lanes: int = 0) -> None:
        lattice, device = model.lattice, model.device
        assert lattice is not None
        laws = model.laws
        if not lattice.constants["damping"].any():  # only ties are damped
            laws = laws._replace(damper=None)
        if lanes > 1 or (lanes and lattice.rimmed and fracture is None):
            kinds = (model.dim, model.scalar, laws, model.compensated, lattice.steps, lanes)
            self.force_algorithm = stencil_of_lanes(*kinds, lattice.rimmed)
            self._share(model, lattice)
            return
        kinds = (model.dim, model.scalar, laws, model.compensated, lattice.steps, lattice.uniform)
        self.force_algorithm = stencil(*kinds, fracture and fracture.breaking)
        data = self.data = model.with_law(self.force_algorithm.Forces())
        upload_fields(data, device, mask=lattice.mask)
        if fracture is not None:
            numbers = lattice.numbers(model.system)
            upload_fields(fracture.data, device, number=numbers.ravel())
            if lattice.uniform:
                offset, own = lattice.neighbours()
                upload_fields(fracture.data, device, offset=offset, own=own[0])
            fracture.carry_out(data.mask, partial(self._clear, model, fracture, numbers))
        if lattice.uniform:
            data.stride = lattice.stride
            data.shift = wp.types.vector(len(lattice.shift), int)(*map(int, lattice.shift))
            for name in CONSTANTS:
                values = lattice.constants[name][0]
                setattr(data, name, wp.types.vector(len(values), model.scalar)(*map(float, values)))
            return
        shift = lattice.shift
        if shift.ndim == 1:
            shift = np.repeat(shift[:, None], model.particle_count, axis=1)
        upload_fields(data, device, shift=shift, kind=lattice.kind, **lattice.constants)

    def _share(self, model: Model, lattice: Lattice) -> None:
        """Fill the struct for several lanes; mask bits are in the order in which lanes visit neighbours."""
        _, own = lattice.neighbours()
        constants = np.ones((len(own), MOST_NEIGHBOURS, 3))
        constants[:, : own.shape[1]] = own
        bits = [one.bit for row in stencil_rows(lattice.steps)[1] for one in row]
        mask = np.zeros_like(lattice.mask)
        for k, bit in enumerate(bits):
            mask |= np.where(lattice.mask & np.uint32(bit), np.uint32(1 << k), np.uint32(0))
        self.data = model.with_law(self.force_algorithm.Forces())
        upload_fields(self.data, model.device, mask=mask)
        if lattice.rimmed:
            upload_fields(self.data, model.device, kind=lattice.kind)
        self.data.shift = wp.types.vector(len(lattice.shift), int)(*map(int, lattice.shift))
        self.data.constants = records_of_three(model, constants.reshape(-1, 3))

    def _clear(self, model: Model, fracture: Fracture, numbers: NDArray[np.int32]) -> None:
        """Clear the mask bits of broken springs; `numbers`: the spring by direction and first particle, or −1."""
        mask, directions = np.array(self.data.mask.numpy()), len(numbers)
        gone = (numbers >= 0) & fracture.broken[numbers]
        for d, first in enumerate(map(np.flatnonzero, gone)):
            mask[first] &= ~np.uint32(1 << d)
            mask[model.system.connections[numbers[d, first], 1]] &= ~np.uint32(1 << (d + directions))
        self.data.mask.assign(mask)


def lanes(model: Model, tears: bool = False) -> int:
    """Return the number of threads per particle: more than 1 on a GPU with few particles."""
    lattice = model.lattice
    if model.force_algorithm == "scatter" or not model.device.is_cuda or tears:
        return 1
    if lattice is not None and not (lattice.uniform or lattice.rimmed):
        return 1
    ends = 2 * (len(lattice.steps) * model.particle_count if lattice else model.connection_count)
    table = LANES[model.force_algorithm, "many" if ends > MANY_NEIGHBOURS * model.particle_count else "few"]
    return next((count for most, count in table if model.particle_count <= most), 1)


CLASSES = {"scatter": Scatter, "gather": Gather, "stencil": Stencil}


def forces_of(model: Model, fracture: Fracture | None = None) -> Scatter | Gather | Stencil:
    """Return a model's force algorithm, in the fastest form for a single world."""
    if model.force_algorithm == "scatter":
        return Scatter(model, fracture)
    return CLASSES[model.force_algorithm](model, fracture, lanes(model, fracture is not None))
