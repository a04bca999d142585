"""The gather algorithm: each particle sums the forces of its springs, using a table of neighbours.

The table is a sparse matrix with a row for each particle and an entry for each neighbour, in sliced ELLPACK format
(Monakov, Lokhmotov & Avetisyan 2010, "Automatically tuning sparse matrix-vector multiplication for GPU
architectures").
"""

import functools

import warp as wp

from ..basis import fully_hashed
from ..compensation import state_types
from ..records import records
from .constants import KIND_SHIFT, MOST_KINDS, constants
from .dampers import law_data
from .force_algorithm import ForceAlgorithm, difference, velocity_of
from .fracture import Breaking
from .lanes import lane_of, sum_over_lanes
from .law import spring_damper
from .spring_laws import Laws

SLICE = 32
"""Particles per slice of the table: the number of threads in a GPU's warp."""
CHUNK = 4
"""Slots that a thread reads at a time, so that their latencies overlap."""
NEIGHBOURS = f"""
    wp::vec_t<{CHUNK}, wp::int32> others;
    for (int n = 0; n < {CHUNK}; ++n) {{
#if defined(__CUDA_ARCH__)
        others[n] = __ldcs(other.data + slot + n * {SLICE});  // read once: it need not stay in the cache
#else
        others[n] = other.data[slot + n * {SLICE}];
#endif
    }}
    return others;
"""


@functools.cache
def gather(
    dim: int,
    scalar: type,
    laws: Laws,
    compensated: bool,
    storage: str,
    breaking: Breaking | None = None,
    lanes: int = 0,
) -> ForceAlgorithm:
    """Compose the gather algorithm: each particle sums the forces of its springs, using a table of neighbours.

    This is Algorithm 2 of the 2014 report. Every force is computed twice, threads never wait, and the order of
    sums is fixed. Slot s of particle i is at first[i / 32] + 32 s + i mod 32, so that adjacent particles read
    adjacent entries. Padding slots, which make all rows of a slice equally long, contain the particle's own index
    and exert no force, like slots of broken springs. With "packed" constants a slot's highest byte is the kind
    of the spring, and the other bytes are the neighbour's index.

    Unless springs break, there may be `lanes`, several threads per particle (see `lanes.py`): lane l takes the
    slots l, l + lanes, ... On the CPU there may be only one.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load, velocity = records(dim, scalar).load, velocity_of(dim, scalar, laws.damper is not None)
    separation, density = difference(dim, scalar, compensated), spring_damper(dim, scalar, laws)
    Constants, take = constants(scalar, storage, laws.several)
    packed, tears = storage == "packed", breaking is not None
    Breaks, is_suspect, breaks = breaking or (None, None, None)
    lane_here, sum_of_lanes = lane_of(max(lanes, 1)), sum_over_lanes(dim, scalar, max(lanes, 1))

    Others = wp.types.vector(CHUNK, int)

    @wp.func_native(NEIGHBOURS)
    def neighbours(other: wp.array(dtype=int), slot: int) -> Others: ...

    @wp.struct
    class Gathered:
        first: wp.array(dtype=int)  # starts of slices, and the end, shape [slice_count + 1]
        other: wp.array(dtype=int)  # neighbour in each slot, shape [slot_count], plus one chunk
        constants: Constants  # of slots
        if not laws.linear:
            law: law_data(scalar, laws)
        if tears:
            breaking: Breaks

    @wp.func
    def spring_in(
        forces: Gathered,
        compensation: Compensation,
        x: Vectors,
        v: Vectors,
        x_i: V,
        v_i: V,
        i: int,
        slot: int,
        other: int,
    ):
        """Return (q, Δx) of the spring in a slot, whose entry is `other`; its force is −q Δx."""
        j = other
        c = slot
        if wp.static(packed):
            c = (j >> wp.static(KIND_SHIFT)) & wp.static(MOST_KINDS - 1)
            j = j & wp.static((1 << KIND_SHIFT) - 1)
        own = take(forces.constants, c)
        dx = separation(compensation, x, x_i, i, j)
        dv = v_i - velocity(v, j)
        if wp.static(tears):
            if is_suspect(forces.breaking, own[0], wp.dot(dx, dx)):
                if breaks(forces.breaking, forces.breaking.number[slot], own[0], wp.dot(dx, dx)):
                    forces.other[slot] = i
                    dx = V()
        q = density(dx, dv, *own) if wp.static(laws.linear) else density(dx, dv, *own, forces.law)
        return q, dx

    @fully_hashed
    def force_at(forces: Gathered, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
        x_i = load(x, i)
        v_i = velocity(v, i)
        force = V()
        part = i / wp.static(SLICE)
        slot = forces.first[part] + i % wp.static(SLICE)
        end = forces.first[part + 1]
        following = neighbours(forces.other, slot)
        while slot < end:
            others = following
            # The next neighbours are loaded before the current ones are used, to hide memory latency.
            following = neighbours(forces.other, slot + wp.static(CHUNK * SLICE))
            for n in range(wp.static(CHUNK)):
                at = slot + wp.static(n * SLICE)
                q, dx = spring_in(forces, compensation, x, v, x_i, v_i, i, at, others[n])
                force -= q * dx
            slot += wp.static(CHUNK * SLICE)
        return force

    @wp.func
    def force_by_lanes(forces: Gathered, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
        part = i / wp.static(SLICE)
        begin = forces.first[part] + i % wp.static(SLICE)
        slots = (forces.first[part + 1] - forces.first[part]) / wp.static(SLICE)
        x_i = load(x, i)
        v_i = velocity(v, i)
        force = V()
        rounds = (slots + wp.static(lanes - 1)) / wp.static(lanes)
        s = lane_here()
        for _n in range(rounds):
            slot = begin + wp.min(s, slots - 1) * wp.static(SLICE)
            q, dx = spring_in(forces, compensation, x, v, x_i, v_i, i, slot, forces.other[slot])
            if s >= slots:  # no slot remains for this lane
                q = scalar(0.0)
            force -= q * dx
            s += wp.static(lanes)
        return sum_of_lanes(force)

    if lanes:
        return ForceAlgorithm(Gathered, force_by_lanes, block=128, grid_stride=False, lanes=lanes)
    bounds = (256, 5) if scalar is wp.float32 else None
    return ForceAlgorithm(Gathered, force_at, bounds=bounds, tears=tears, grid_stride=False)
