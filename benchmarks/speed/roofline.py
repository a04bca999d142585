"""What the machine could do at most, and what a substep asks of it at least: the ceilings of `throughput`.

Ceilings: a copy, an empty launch and records that are added to are measured; arithmetic is what the maker states.

Floors: let V be a vector's record: 16 bytes in float32, 32 in float64; S a number: 4 or 8; C a connection's
constants: 0 if all connections have the same, 1 if they are of few kinds (lattices; 0 in gather, where the kind is
packed with the neighbour), else 3S. What a substep of symplectic Euler must move if every particle's neighbours
are found in a cache:

    stencil   4V + 4 bytes a particle: x, v and mask read; x, v written (float32: 68)
    gather    4V a particle, 4 + C for each slot of its table (float32 lattice: 64, and 4 a slot)
    scatter   10V a particle, 8 + C a connection: forces added up in one kernel from x, v, then read, zeroed and
              used with x, v in another (float32 lattice: 160, and 9 a connection)

Other methods move more records (`TRAFFIC`); compensated sums add lost.x and lost.v, masses that differ S bytes.
Small bodies stay in the caches, so that they may be faster than this floor.

Arithmetic at an end of a connection: Δx 3, Δv 3, |Δx|² 6, root 1, spring 1, damper 8, density 2, times Δx and
sum 6: 30 operations, 6 more if compensated. Stencil and gather compute both ends, and also the neighbours that a
particle lacks (stencil) or slots that pad a table (gather); scatter computes a connection once and adds twice, 33.
The 24 or so operations of the particle itself are left out. The peak counts a fused multiplication and addition as
two, and every instruction as one of those: no force is computed so.
"""

import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import NamedTuple

import warp as wp

from msdwarp import Simulation
from msdwarp.kernels.basis import kernel
from msdwarp.kernels.records import records

FLOPS_AT_END, FLOPS_AT_CONNECTION, FLOPS_COMPENSATED = 30, 33, 6
UNITS = {"copy": "B/s", "launch": "s", "records added": "1/s"}


class Traffic(NamedTuple):
    """Records that a substep reads and writes, for each particle, beside x and v that a force needs."""

    evaluations: int
    others: int
    """Read and written by the particle alone."""
    again: int
    """Of x and v: read once more by the particle where the force was scattered before."""


TRAFFIC = {
    "symplectic Euler": Traffic(1, 2, 2),
    "leapfrog": Traffic(1, 2, 2),
    "leapfrog θ=½": Traffic(1, 4, 1),
    "RK4": Traffic(4, 3 + 6 + 6 + 7, 5),
    "RKC2": Traffic(4, 5 + 11 + 11 + 9, 5),
}


class Chip(NamedTuple):
    """What a multiprocessor can do, as its maker states."""

    clock: float
    """Highest clock [Hz]."""
    lanes: dict[str, int]
    """Multiply-adds per clock by precision."""


HOPPER = Chip(1.98e9, {"float32": 128, "float32-compensated": 128, "float64": 64})
CHIPS = {"H200": HOPPER, "H100 80GB HBM3": HOPPER}


def shares(simulation: Simulation, row: dict, substep: float, ceilings: dict[str, float]) -> dict:
    """Return a substep's bytes and operations, and the shares that their floors have of the time it took [s]."""
    moved, computed = least_bytes(simulation, row), operations(simulation, row)
    peak = ceilings.get(f"arithmetic, {row['precision']}")
    return {
        "bytes_per_substep": moved,
        "share_of_bandwidth": moved / ceilings["copy"] / substep,
        "operations_per_substep": computed,
        "share_of_arithmetic": computed / peak / substep if peak else "",
    }


def least_bytes(simulation: Simulation, row: dict) -> int:
    """Return the bytes that a substep moves at least; see the module's docstring."""
    model, (evaluations, others, again) = simulation.model, TRAFFIC[row["method"]]
    number = 8 if row["precision"] == "float64" else 4
    particle, connection = 2 * evaluations + others, 0
    if row["force_algorithm"] == "scatter":
        particle += 4 * evaluations + again  # forces added to, read and zeroed
        connection = (8 + constant_bytes(simulation, number)) * model.connection_count
    if model.compensated:
        particle += evaluations + 3 + (row["force_algorithm"] == "scatter")
    if row["force_algorithm"] == "gather":
        connection = (4 + constant_bytes(simulation, number)) * slots(simulation)
    own = 4 if row["force_algorithm"] == "stencil" else 0
    own += 0 if model.system.mass.strides == (0,) else number
    particles = model.particle_count * (4 * number * particle + evaluations * own)
    return particles + evaluations * connection


def constant_bytes(simulation: Simulation, number: int) -> int:
    """Return the bytes of a connection's constants, as `msdwarp.kernels.springs.constants` stores them."""
    constants = simulation.stepping.dynamics.scene.forces.constants
    return 3 * number if hasattr(constants, "rest_length") else int(hasattr(constants, "kind"))


def operations(simulation: Simulation, row: dict) -> int:
    """Return the floating-point operations of a substep's connections; see the module's docstring."""
    model, each = simulation.model, TRAFFIC[row["method"]].evaluations
    more = FLOPS_COMPENSATED if model.compensated else 0
    if row["force_algorithm"] == "scatter":
        return each * model.connection_count * (FLOPS_AT_CONNECTION + more)
    if row["force_algorithm"] == "gather":
        return each * slots(simulation) * (FLOPS_AT_END + more)
    return each * 2 * len(model.lattice.steps) * model.particle_count * (FLOPS_AT_END + more)


def slots(simulation: Simulation) -> int:
    """Return how many slots the table of neighbours has, those that pad it included."""
    return int(simulation.stepping.dynamics.scene.forces.first.numpy()[-1])


@kernel
def nothing():
    """Do nothing: what a launch costs."""


_, _, add = records(3, wp.float32)


@kernel
def add_to_records(x: wp.array(dtype=wp.vec3), value: wp.vec3):
    """Add a vector to a record, as scattered forces are added."""
    add(x, wp.tid() % x.shape[0], value)


def time_of(action: Callable[[], None], device: str, repeats: int = 9) -> float:
    """Return the median time of an action [s]."""
    times = []
    for _ in range(repeats + 1):
        wp.synchronize_device(device)
        start = time.perf_counter()
        action()
        wp.synchronize_device(device)
        times.append(time.perf_counter() - start)
    return median(times[1:])


def measure_ceilings(device: str) -> dict[str, float]:
    """Return what the device can do: bytes copied a second (read and written), seconds a launch, and so on."""
    found = {"copy": copied_bytes(device)}
    wp.launch(nothing, 1, device=device)  # compiles
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(1000):
            wp.launch(nothing, 1, device=device)
    found["launch"] = time_of(partial(wp.capture_launch, capture.graph), device) / 1000
    found["records added"] = added_records(device)
    if device != "cpu":
        gpu = wp.get_device(device)
        chip = next((chip for name, chip in CHIPS.items() if name in gpu.name), None)
        for precision in chip.lanes if chip else ():
            found[f"arithmetic, {precision}"] = 2 * gpu.sm_count * chip.lanes[precision] * chip.clock
    return found


def copied_bytes(device: str) -> float:
    """Return how many bytes are read and written in a second by copies of 1 GB, 200 MB on the CPU."""
    count = 50_000_000 if device == "cpu" else 250_000_000
    here, there = (wp.zeros(count, dtype=wp.float32, device=device) for _ in range(2))

    def copy() -> None:
        for _ in range(10):
            wp.copy(there, here)

    return 10 * 2 * 4 * count / time_of(copy, device)


def added_records(device: str) -> float:
    """Return how many records are added to in a second, neighbours by neighbouring threads, in 16 MB."""
    particles, threads = 1_000_000, 10_000_000 if device == "cpu" else 200_000_000
    storage = wp.zeros(4 * particles, dtype=wp.float32, device=device)
    view = wp.array(ptr=storage.ptr, dtype=wp.vec3, shape=particles, strides=(16,), device=device)
    inputs = [view, wp.vec3(1.0, 1.0, 1.0)]
    return threads / time_of(partial(wp.launch, add_to_records, threads, inputs, device=device), device)
