"""Where the state of a small world lies in the shared memory of the block of threads that advances it."""

from typing import Any, NamedTuple

import warp as wp

from ...kernels.integrators import MOST_BYTES, on_chip_worlds
from ...kernels.places import arrays_of
from ...kernels.records import record_length
from ...kernels.springs import COLUMN
from ..model.model import Model
from ..model.state import Instant, State
from ..springs.force_algorithms import MANY_NEIGHBOURS
from .dynamics import Dynamics
from .worlds import power_of_two, threads_at_a_time

LEAST_ROOM = 1024
"""Bytes; there is a kernel for each power of two from here on."""
IN_COLUMNS = 512
"""Threads of a multiprocessor that find registers enough for columns of particles."""
MOST_THREADS = 512
"""Larger worlds have a thread for each column of particles, or are not advanced on the chip."""


class Chip(NamedTuple):
    """What a kernel needs to know to keep worlds on the chip."""

    threads: int
    """Threads of a block, which advances a world."""
    in_columns: bool
    """Whether a thread has a column of particles, not one."""
    steps: wp.array
    """The stages of a substep; their arrays are given by the byte of shared memory at which they begin."""
    home: wp.array
    """Where each array begins in the device's memory, as world 0 has it, shape [array_count]."""
    words: int
    """Numbers of four bytes that an array has for each world."""
    each: int
    """How far apart arrays lie in shared memory, in such numbers."""
    margin: int
    """How many of them may be read before an array begins, and behind it."""
    room: int
    """Bytes of shared memory: a power of two, or the most that there is."""

    def launch(self, dynamics: Dynamics, method: Any, stages: int) -> None:
        """Launch so many stages of all worlds, a block of threads for each."""
        at_a_time = threads_at_a_time(dynamics.assembly)
        together = min(at_a_time, IN_COLUMNS) if self.in_columns else at_a_time
        kernel: Any = on_chip_worlds(
            dynamics.composition, method, self.threads, together, self.room, self.in_columns
        )
        inputs = [dynamics.scene, self.steps, stages, self.home, self.words, self.each, self.margin]
        threads, device = dynamics.model.worlds * self.threads, dynamics.model.device
        wp.launch(kernel, threads, inputs, device=device, block_dim=self.threads)


def on_chip(dynamics: Dynamics, state: State, method: Any, stages: list[Any]) -> Chip | None:
    """Return how the worlds of a model stay on the chip; None where they are too large for it.

    What a substep writes `state_out` goes where it is `state_in`: in a block nobody writes before all have read.
    This needs a method that writes there in the last stage only.

    Parameters
    ----------
    dynamics, state
        The worlds, and what moves.
    method, stages
        The method, and its stages of a substep.
    """
    model, force_algorithm = dynamics.model, dynamics.composition.force_algorithm
    if not model.device.is_cuda or force_algorithm.evaluate is not None or dynamics.assembly.begins_substeps:
        return None
    Step = method(dynamics.composition).Step
    needed, reach, in_columns = _threads(model, force_algorithm)
    if needed > MOST_THREADS:
        return None
    twins: dict[int, int] = dict(zip(_addresses(state.state_out), _addresses(state.state_in), strict=True))
    table = wp.array(stages, dtype=Step, device="cpu").numpy()
    fields = [_addresses_in(table, name) for name in arrays_of(Step, model.compensated)]
    if any(twins.keys() & set(addresses[:-1].tolist()) for addresses in fields):
        return None
    home = sorted({twins.get(int(one), int(one)) for addresses in fields for one in addresses})
    size = record_length(model.dim) * wp.types.type_size_in_bytes(model.scalar)
    words, margin = model.particle_count * size // 4, reach * size // 4
    each = -(-(words + 2 * margin) // 4) * 4
    room = 4 * each * len(home)
    if room > MOST_BYTES:
        return None
    for addresses in fields:
        for k, one in enumerate(map(int, addresses)):
            addresses[k] = 4 * (home.index(twins.get(one, one)) * each + margin)
    return Chip(
        power_of_two(needed),
        in_columns,
        wp.array(table, dtype=Step, device=model.device),
        wp.array(home, dtype=wp.int64, device=model.device),
        words,
        each,
        margin,
        min(MOST_BYTES, max(LEAST_ROOM, 1 << (room - 1).bit_length())),
    )


def _threads(model: Model, force_algorithm: Any) -> tuple[int, int, bool]:
    """Return how many threads a world takes, how far beyond its particles they read, and if they have columns."""
    count, lattice = model.particle_count, model.lattice
    if lattice is None:
        return count, 0, False
    few = 2 * len(lattice.steps) <= MANY_NEIGHBOURS  # then columns are no faster than the cache
    if count <= MOST_THREADS or few or force_algorithm.column_forces is None or lattice.stride <= 0:
        return count, lattice.reach, False
    columns = -(-count // (COLUMN * lattice.stride)) * lattice.stride
    return columns, lattice.reach + COLUMN * columns - count, True


def _addresses(instant: Instant) -> list[int]:
    """Return where the arrays of an instant begin that the next instant has too."""
    arrays = [instant.x, instant.v, *instant.method_state, instant.compensation.x]
    return [int(array.ptr) for array in arrays if array.size]


def _addresses_in(table: Any, name: str) -> Any:
    """Return where an array of each stage begins, as integers that can be changed."""
    for part in name.split("."):
        table = table[part]
    return table["data"]
