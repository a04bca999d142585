"""Watching a run from the device: energies, and the first particle that is no longer finite."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from .columns import LOOKED, MAXIMA, NONE

LOOKING_BLOCK = 256
"""Threads of a block that looks over particles on a GPU."""
ADD_UP = """
#if defined(__CUDA_ARCH__)
    constexpr int COLUMNS = {columns}, MAXIMA = {maxima};
    __shared__ double each[COLUMNS * {block}];
    __shared__ bool is_last;
    const int lane = threadIdx.x % 32, warps = blockDim.x / 32;
    const auto join = [](int c, double a, double b) {{ return c < MAXIMA ? (b > a ? b : a) : a + b; }};
    const auto add_up_each = [&](const volatile double* from, int count, double* to, int apart) {{
        for (int c = threadIdx.x / 32; c < COLUMNS; c += warps) {{
            double total = c < MAXIMA ? -1e300 : 0.0;
            for (int k = lane; k < count; k += 32)
                total = join(c, total, from[c * count + k]);
            for (int far = 16; far > 0; far /= 2)
                total = join(c, total, __shfl_down_sync(0xffffffffu, total, far));
            if (lane == 0)
                to[c * apart] = total;
        }}
    }};
    #pragma unroll
    for (int c = 0; c < COLUMNS; ++c)
        each[c * blockDim.x + threadIdx.x] = own[c];
    __syncthreads();
    add_up_each(each, blockDim.x, blocks.data + blockIdx.x, gridDim.x);
    __threadfence();
    __syncthreads();
    if (threadIdx.x == 0)
        is_last = atomicAdd(done.data, 1) == gridDim.x - 1;
    __syncthreads();
    if (is_last) {{
        __threadfence();
        add_up_each(blocks.data, gridDim.x, found.data, 1);
        if (threadIdx.x == 0)
            done.data[0] = 0;
    }}
#else
    for (int c = 0; c < {columns}; ++c)
        found.data[c] = own[c];
#endif
"""
"""A warp adds up each column; the block that comes last does so with what all have found.

They are added in their order, which no race decides. What other blocks have written is read as volatile, past the
cache of this one. On the CPU there is one thread.
"""


@functools.cache
def free_energies(dim: int, scalar: type):
    """Compose the kinetic and gravitational energy of a particle [J], in float64; a pinned one has none."""
    V = vector(dim, scalar)

    @wp.func
    def energies_of(inverse_mass: scalar, gravity: V, x: V, v: V):
        w = wp.float64(inverse_mass)
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        if w > wp.float64(0.0):
            square = wp.float64(0.0)
            fall = wp.float64(0.0)
            for k in range(wp.static(dim)):
                speed = wp.float64(v[k])
                square += speed * speed
                fall += wp.float64(gravity[k]) * wp.float64(x[k])
            mass = wp.float64(1.0) / w  # of divisions in float64 the pass over the particles has time for one
            kinetic = wp.float64(0.5) * square * mass
            potential = -fall * mass
        return kinetic, potential

    return energies_of


@functools.cache
def add_up(columns: int):
    """Compose what adds up what threads have found, over a whole grid: the last thing that a kernel does.

    The kernel is launched with blocks of LOOKING_BLOCK threads, as many as `blocks` has columns.
    """
    Columns = wp.types.vector(columns, wp.float64)

    @wp.func_native(ADD_UP.format(columns=columns, maxima=MAXIMA, block=LOOKING_BLOCK))
    def add_up_columns(
        own: Columns,
        blocks: wp.array2d(dtype=wp.float64),
        done: wp.array(dtype=int),
        found: wp.array(dtype=wp.float64),
    ): ...

    return add_up_columns


@functools.cache
def look_over(dim: int, scalar: type):
    """Compose the kernel that finds what has diverged: so many as LOOKED of `columns`, in float64."""
    V, energies_of, add_up_columns = vector(dim, scalar), free_energies(dim, scalar), add_up(LOOKED)
    load, Columns = records(dim, scalar).load, wp.types.vector(LOOKED, wp.float64)

    def look_over_particles(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        work: wp.array(dtype=wp.float64),  # to be added up [J], shape [any]
        # Between:
        threads: int,  # how many there are
        blocks: wp.array2d(dtype=wp.float64),  # what each has found, shape [LOOKED, block_count]
        done: wp.array(dtype=int),  # how many blocks are; 0 before and after; shape [1]
        # Out:
        found: wp.array(dtype=wp.float64),  # shape [LOOKED] or more
    ):
        i = wp.tid()
        first = int(wp.static(NONE))
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        while i < x.shape[0]:
            x_i = load(x, i)
            v_i = load(v, i)
            if not (wp.isfinite(x_i) and wp.isfinite(v_i)):
                first = wp.min(first, i)
            moves, falls = energies_of(inverse_mass[i], gravity, x_i, v_i)
            kinetic += moves
            potential += falls
            i += threads
        done_work = wp.float64(0.0)
        i = wp.tid()
        while i < work.shape[0]:
            done_work += work[i]
            i += threads
        own = Columns(-wp.float64(first), wp.float64(0.0), kinetic, potential, done_work)
        add_up_columns(own, blocks, done, found)

    return kernel(look_over_particles, grid_stride=False)
