"""Small worlds in a GPU's shared memory: the layout of a world's state for the block that advances it."""

from typing import Any, NamedTuple

import warp as wp

from ...kernels.integrators.shared_memory import MOST_BYTES, on_chip_worlds
from ...kernels.places import arrays_of
from ...kernels.records import record_length
from ...kernels.springs.stencil import COLUMN
from ..model.model import Model
from ..model.state import Instant, State
from ..springs.force_algorithms import MANY_NEIGHBOURS
from .dynamics import Dynamics
from .stages import stages_for
from .world_differences import power_of_two, threads_at_a_time

LEAST_BYTES = 1024
"""Smallest size [bytes] of shared memory; there is a kernel for each power of two."""
RESIDENT_IN_COLUMNS = 512
"""Threads per multiprocessor for which the registers suffice, with columns of particles."""
MOST_THREADS = 512
"""Larger worlds use a thread per column of particles, or do not stay in shared memory."""


class Chip(NamedTuple):
    """Layout of worlds in shared memory."""

    threads: int
    """Threads of a block; a block advances a world."""
    in_columns: bool
    """Whether a thread advances a column of particles instead of a single one."""
    steps: wp.array
    """The stages of a substep; their array pointers are byte offsets in shared memory."""
    addresses: wp.array
    """Address of each array of world 0 in the device's memory, shape [array_count]."""
    words: int
    """Length of an array for one world, in words of four bytes."""
    spacing: int
    """Distance between arrays in shared memory [words]."""
    margin: int
    """Readable words before and after an array."""
    size: int
    """Size of shared memory [bytes]: a power of two, or the maximum."""

    def kernel(self, dynamics: Dynamics, method: Any) -> Any:
        """Return the kernel, for blocks of `threads` threads."""
        resident = threads_at_a_time(dynamics.assembly)
        if self.in_columns:
            resident = min(resident, RESIDENT_IN_COLUMNS)
        return on_chip_worlds(dynamics.composition, method, self.threads, resident, self.size, self.in_columns)

    def launch(self, dynamics: Dynamics, method: Any, stages: int) -> None:
        """Launch stages of all worlds, with a block of threads for each world."""
        kernel = self.kernel(dynamics, method)
        inputs = [dynamics.scene, stages_for(kernel, self.steps), stages]
        inputs += [self.addresses, self.words, self.spacing, self.margin]
        threads, device = dynamics.model.worlds * self.threads, dynamics.model.device
        wp.launch(kernel, threads, inputs, device=device, block_dim=self.threads)


def on_chip(dynamics: Dynamics, state: State, method: Any, stages: list[Any]) -> Chip | None:
    """Return the layout of worlds in shared memory; None if they do not fit.

    `state_in` and `state_out` have the same memory, since no thread of a block writes before all have read. The
    method must write `state_out` only in the last of its `stages`.
    """
    model, force_algorithm = dynamics.model, dynamics.composition.force_algorithm
    if not model.device.is_cuda or force_algorithm.evaluate is not None or dynamics.assembly.begins_substeps:
        return None
    Step = method(dynamics.composition).Step
    needed, reach, in_columns = _threads(model, force_algorithm)
    if needed > MOST_THREADS:
        return None
    shared: dict[int, int] = dict(zip(_addresses(state.state_out), _addresses(state.state_in), strict=True))
    table = wp.array(stages, dtype=Step, device="cpu").numpy()
    fields = [_addresses_in(table, name) for name in arrays_of(Step, model.compensated)]
    if any(shared.keys() & set(addresses[:-1].tolist()) for addresses in fields):
        return None
    originals = sorted({shared.get(int(one), int(one)) for addresses in fields for one in addresses})
    record = record_length(model.dim) * wp.types.type_size_in_bytes(model.scalar)
    words, margin = model.particle_count * record // 4, reach * record // 4
    spacing = -(-(words + 2 * margin) // 4) * 4
    size = 4 * spacing * len(originals)
    if size > MOST_BYTES:
        return None
    for addresses in fields:
        for k, one in enumerate(map(int, addresses)):
            addresses[k] = 4 * (originals.index(shared.get(one, one)) * spacing + margin)
    return Chip(
        power_of_two(needed),
        in_columns,
        wp.array(table, dtype=Step, device=model.device),
        wp.array(originals, dtype=wp.int64, device=model.device),
        words,
        spacing,
        margin,
        min(MOST_BYTES, max(LEAST_BYTES, 1 << (size - 1).bit_length())),
    )


def _threads(model: Model, force_algorithm: Any) -> tuple[int, int, bool]:
    """Return a world's threads, how many particles before and after it they read, and whether it has columns."""
    count, lattice = model.particle_count, model.lattice
    if lattice is None:
        return count, 0, False
    few = 2 * len(lattice.steps) <= MANY_NEIGHBOURS  # with few neighbours columns are no faster than the cache
    if count <= MOST_THREADS or few or force_algorithm.column_forces is None or lattice.stride <= 0:
        return count, lattice.reach, False
    columns = -(-count // (COLUMN * lattice.stride)) * lattice.stride
    return columns, lattice.reach + COLUMN * columns - count, True


def _addresses(instant: Instant) -> list[int]:
    """Return the addresses of an instant's arrays, in the same order for `state_in` and `state_out`."""
    arrays = [instant.x, instant.v, *instant.method_state, instant.compensation.x]
    return [int(array.ptr) for array in arrays if array.size]


def _addresses_in(table: Any, name: str) -> Any:
    """Return a view of the addresses that array `name` has in each stage."""
    for part in name.split("."):
        table = table[part]
    return table["data"]
