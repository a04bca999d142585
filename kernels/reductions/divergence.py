"""Watching a run from the device: energies, and the first particle that is no longer finite."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records

KINETIC, POTENTIAL = 0, 1
"""Columns of the energies that `look_over` sums."""
LOOKING_BLOCK = 256
"""Threads of a block that looks over particles on a GPU."""
ADD_UP = """
#if defined(__CUDA_ARCH__)
    __shared__ double sums[2][32];
    __shared__ int least[32];
    __shared__ bool is_last;
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32, warps = blockDim.x / 32;
    double k = kinetic, p = potential;
    int f = first;
    const auto add_up_lanes = [&]() {
        for (int far = 16; far > 0; far /= 2) {
            k += __shfl_down_sync(0xffffffffu, k, far);
            p += __shfl_down_sync(0xffffffffu, p, far);
            const int other = __shfl_down_sync(0xffffffffu, f, far);
            f = other < f ? other : f;
        }
    };
    const auto add_up_block = [&]() {
        add_up_lanes();
        if (lane == 0)
            sums[0][warp] = k, sums[1][warp] = p, least[warp] = f;
        __syncthreads();
        if (warp == 0) {
            k = lane < warps ? sums[0][lane] : 0.0, p = lane < warps ? sums[1][lane] : 0.0;
            f = lane < warps ? least[lane] : 0x7fffffff;
            add_up_lanes();
        }
    };
    add_up_block();
    if (threadIdx.x == 0) {
        double* own = blocks.data + 3 * blockIdx.x;
        own[0] = k, own[1] = p, own[2] = f;
        __threadfence();
        is_last = atomicAdd(done.data, 1) == gridDim.x - 1;
    }
    __syncthreads();
    if (is_last) {
        k = p = 0.0, f = 0x7fffffff;
        for (int b = threadIdx.x; b < gridDim.x; b += blockDim.x) {
            const double* own = blocks.data + 3 * b;
            k += __ldcg(own), p += __ldcg(own + 1);
            const int other = static_cast<int>(__ldcg(own + 2));
            f = other < f ? other : f;
        }
        add_up_block();
        if (threadIdx.x == 0)
            found.data[0] = k, found.data[1] = p, found.data[2] = f, done.data[0] = 0;
    }
#endif
"""
"""The block that comes last adds up what all have found, in their order, which no race decides."""


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
def look_over(dim: int, scalar: type):
    """Compose the kernel that sums energies and lowers `first[0]` to the least particle that is not finite.

    Each thread sums the kinetic and gravitational energies of a share of the particles, in float64; pinned ones
    have none.
    """
    V, energies_of = vector(dim, scalar), free_energies(dim, scalar)

    @kernel
    def look_over_particles(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        # Out:
        first: wp.array(dtype=int),  # particle_count before; shape [1]
        energies: wp.array2d(dtype=wp.float64),  # [J], shape [thread_count, 2]
    ):
        share = wp.tid()
        i = share
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        while i < x.shape[0]:
            if not (wp.isfinite(x[i]) and wp.isfinite(v[i])):
                wp.atomic_min(first, 0, i)
            moves, falls = energies_of(inverse_mass[i], gravity, x[i], v[i])
            kinetic += moves
            potential += falls
            i += energies.shape[0]
        energies[share, wp.static(KINETIC)] = kinetic
        energies[share, wp.static(POTENTIAL)] = potential

    return look_over_particles


@wp.func_native(ADD_UP)
def add_up(
    kinetic: wp.float64,
    potential: wp.float64,
    first: int,
    blocks: wp.array2d(dtype=wp.float64),
    done: wp.array(dtype=int),
    found: wp.array(dtype=wp.float64),
):
    """Add up what threads have found, over a whole grid."""
    ...


@functools.cache
def look_over_in_blocks(dim: int, scalar: type):
    """Compose the same for a GPU, in one launch: found = (kinetic energy, potential energy, first), in float64.

    `first` is the least particle that is not finite, or else a number that no particle has. It is launched with
    blocks of LOOKING_BLOCK threads, as many as `blocks` has rows.
    """
    V, energies_of = vector(dim, scalar), free_energies(dim, scalar)
    load = records(dim, scalar).load

    def look_over_particles(
        # Model:
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        gravity: V,  # [m/s²]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        # Between:
        blocks: wp.array2d(dtype=wp.float64),  # what each has found, shape [block_count, 3]
        done: wp.array(dtype=int),  # how many blocks are; 0 before and after; shape [1]
        # Out:
        found: wp.array(dtype=wp.float64),  # shape [3]
    ):
        i = wp.tid()
        first = int(2147483647)
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
            i += blocks.shape[0] * LOOKING_BLOCK
        add_up(kinetic, potential, first, blocks, done, found)

    return kernel(look_over_particles, grid_stride=False)
