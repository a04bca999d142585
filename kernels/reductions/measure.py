"""Measures of a state, in float64 for every precision of a simulation: sums, and strains of connections.

The order of sums is fixed, so equal states have equal measures to the last bit.
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..springs.dampers import LINEAR, damper_force
from ..springs.spring_laws import Laws, connection_table, spring_energy
from .columns import COLUMNS, LOOKED, MAXIMA, NONE

SUMMING_BLOCKS = (32, 256)
"""Threads per block for sums on a GPU: in small worlds, and in larger worlds."""
ADD_UP = """
#if defined(__CUDA_ARCH__)
    constexpr int COLUMNS = {columns}, MAXIMA = {maxima};
    __shared__ double each[COLUMNS * {block}];
    __shared__ bool is_last;
    const int count = blocks.shape[2], block = blockIdx.x % count;
    double* const of_world = blocks.data + static_cast<size_t>(world) * COLUMNS * count;
    double* const result = found.data + static_cast<size_t>(world) * found.shape[1];
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
    if (count == 1) {{
        add_up_each(each, blockDim.x, result, 1);
        return;
    }}
    add_up_each(each, blockDim.x, of_world + block, count);
    __threadfence();
    __syncthreads();
    if (threadIdx.x == 0)
        is_last = atomicAdd(done.data + world, 1) == count - 1;
    __syncthreads();
    if (is_last) {{
        __threadfence();
        add_up_each(of_world, count, result, 1);
        if (threadIdx.x == 0)
            done.data[world] = 0;
    }}
#else
    for (int c = 0; c < {columns}; ++c)
        found.data[static_cast<size_t>(world) * found.shape[1] + c] = own[c];
#endif
"""
"""One warp sums each column; the last block of a world to finish sums the results of all blocks of this world.

The order of these additions is fixed, whichever block is last. Other blocks' results are read as volatile, past
the cache. On the CPU a world has one thread.
"""


@functools.cache
def add_up(column_count: int, block: int):
    """Compose the end of a kernel: it combines the results of each world's threads.

    The kernel is launched with blocks of `block` threads; each world has blocks.shape[2] blocks.
    """
    Columns = wp.types.vector(column_count, wp.float64)

    @wp.func_native(ADD_UP.format(columns=column_count, maxima=MAXIMA, block=block))
    def add_up_columns(
        own: Columns,
        world: int,
        blocks: wp.array3d(dtype=wp.float64),
        done: wp.array(dtype=int),
        found: wp.array2d(dtype=wp.float64),
    ): ...

    return add_up_columns


@functools.cache
def difference(dim: int, scalar: type):
    """Compose separation(x, x_lost, i, j) = x[i] − x[j]; unless x_lost is empty, positions are x − x_lost."""
    V = vector(dim, scalar)

    @wp.func
    def separation(x: wp.array(dtype=V), x_lost: wp.array(dtype=V), i: int, j: int) -> wp.vec3d:
        dx = wp.vec3d()
        for k in range(wp.static(dim)):
            dx[k] = wp.float64(x[i][k]) - wp.float64(x[j][k])
            if x_lost.shape[0] > 0:
                dx[k] -= wp.float64(x_lost[i][k]) - wp.float64(x_lost[j][k])
        return dx

    return separation


@functools.cache
def sum_up(dim: int, scalar: type, everything: bool, laws: Laws, block: int):
    """Compose the kernel that computes all `columns` for a state.

    Unless `everything`, it only visits particles, and computes LOOKED columns.
    """
    V, separation = vector(dim, scalar), difference(dim, scalar)
    resistance, energy = damper_force(wp.float64, laws), spring_energy(laws.spring or LINEAR)
    Connected, law_of = connection_table(scalar, laws)
    column_count, load = COLUMNS if everything else LOOKED, records(dim, scalar).load
    add_up_columns, Columns = add_up(column_count, block), wp.types.vector(column_count, wp.float64)

    def sum_up_state(
        # Model, row w mod (number of rows) for world w:
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], 0 where pinned, shape [rows, particle_count]
        gravity: wp.array(dtype=V),  # [m/s²], shape [rows]
        connections: Connected,
        # The same in all worlds:
        counts: wp.array(dtype=wp.uint8),  # whether its strain is included, shape [connection_count]; or empty
        tears: int,  # whether connections without stiffness and damping are broken: their strain is not included
        # State in, of all worlds:
        x: wp.array(dtype=V),  # positions [m]
        x_lost: wp.array(dtype=V),  # compensation of positions [m], or empty
        u: wp.array(dtype=V),  # velocities of the method [m/s]
        v: wp.array(dtype=V),  # velocities at the time of the positions [m/s]
        work: wp.array(dtype=wp.float64),  # terms to sum [J], equally many for each world
        stride: int,  # particles from one world to the next
        # Intermediate:
        threads: int,  # per world
        blocks: wp.array3d(dtype=wp.float64),  # partial results, shape [worlds, columns, block_count]
        done: wp.array(dtype=int),  # number of finished blocks; 0 before and after; shape [worlds]
        # Out:
        found: wp.array2d(dtype=wp.float64),  # shape [worlds, columns or more]
    ):
        w = int(0)
        thread = wp.tid()
        if found.shape[0] > 1:  # in a single world the division would take 1 % of a frame
            w = wp.tid() / threads
            thread = wp.tid() % threads
        start = w * stride
        g = gravity[w % gravity.shape[0]]
        row = w % inverse_mass.shape[0]
        i = thread
        first = int(wp.static(NONE))
        kinetic = wp.float64(0.0)
        potential = wp.float64(0.0)
        mean = wp.float64(0.0)
        swing = wp.float64(0.0)
        momenta = wp.vec3d()
        turns = wp.vec3d()
        while i < inverse_mass.shape[1]:
            x_i = load(x, start + i)
            u_i = load(u, start + i)
            if not (wp.isfinite(x_i) and wp.isfinite(u_i)):
                first = wp.min(first, i)
            inverse = wp.float64(inverse_mass[row, i])
            if inverse > wp.float64(0.0):
                square = wp.float64(0.0)
                fall = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    speed = wp.float64(u_i[k])
                    square += speed * speed
                    fall += wp.float64(g[k]) * wp.float64(x_i[k])
                mass = wp.float64(1.0) / inverse  # memory traffic hides one float64 division, but not two
                kinetic += wp.float64(0.5) * square * mass
                potential -= fall * mass
                if wp.static(everything):
                    v_i = load(v, start + i)
                    position = wp.vec3d()
                    momentum = wp.vec3d()
                    difference_squared = wp.float64(0.0)
                    for k in range(wp.static(dim)):
                        position[k] = wp.float64(x_i[k])
                        momentum[k] = mass * wp.float64(v_i[k])
                        ahead = wp.float64(v_i[k]) - wp.float64(u_i[k])
                        difference_squared += ahead * ahead
                    mean += wp.float64(0.5) * inverse * wp.dot(momentum, momentum)
                    swing += wp.float64(0.5) * mass * difference_squared
                    momenta += momentum
                    turns += wp.cross(position, momentum)
            i += threads
        done_work = wp.float64(0.0)
        per_world = work.shape[0] / found.shape[0]
        i = thread
        while i < per_world:
            done_work += work[w * per_world + i]
            i += threads
        if wp.static(everything):
            length_row = w % connections.rest_length.shape[0]
            stiffness_row = w % connections.stiffness.shape[0]
            damping_row = w % connections.damping.shape[0]
            c = thread
            elastic = wp.float64(0.0)
            dissipated = wp.float64(0.0)
            strain = wp.float64(0.0)
            while c < connections.ends.shape[0]:
                i = start + connections.ends[c][0]
                j = start + connections.ends[c][1]
                rest = wp.float64(connections.rest_length[length_row, c])
                spring = wp.float64(connections.stiffness[stiffness_row, c])
                damper = wp.float64(connections.damping[damping_row, c])
                dx = separation(x, x_lost, i, j)
                closing = wp.float64(0.0)
                for k in range(wp.static(dim)):
                    closing += dx[k] * (wp.float64(v[i][k]) - wp.float64(v[j][k]))
                length = wp.length(dx)
                stretch = length - rest
                if wp.static(laws.spring is None):
                    elastic += wp.float64(0.5) * spring * stretch * stretch
                else:
                    elastic += spring * rest * rest * energy(stretch / rest, law_of(connections, c))
                if length > wp.float64(0.0):
                    rate = closing / length
                    resisting = damper * rate
                    if wp.static(not laws.linear):
                        pull = spring * wp.max(stretch, wp.float64(0.0))  # limits the damper if springs only pull
                        resisting = resistance(stretch / rest, rate, damper, pull, law_of(connections, c))
                    dissipated += resisting * rate
                if tears != 0 and spring == wp.float64(0.0) and damper == wp.float64(0.0):
                    stretch = wp.float64(0.0)
                if counts.shape[0] > 0:
                    if counts[c] == wp.uint8(0):
                        stretch = wp.float64(0.0)
                strain = wp.max(strain, wp.abs(stretch) / rest)
                c += threads
            own = Columns(
                -wp.float64(first),
                strain,
                kinetic,
                potential,
                done_work,
                mean,
                swing,
                momenta[0],
                momenta[1],
                momenta[2],
                turns[0],
                turns[1],
                turns[2],
                elastic,
                dissipated,
            )
            add_up_columns(own, w, blocks, done, found)
        else:
            own = Columns(-wp.float64(first), wp.float64(0.0), kinetic, potential, done_work)
            add_up_columns(own, w, blocks, done, found)

    return kernel(sum_up_state, grid_stride=False)


@kernel
def fold(
    partial: wp.array3d(dtype=wp.float64),  # shape [worlds, thread_count, columns]
    largest: int,  # column that is a maximum instead of a sum; -1: none
    first: int,  # column of `rows` for the first column of `partial`
    rows: wp.array3d(dtype=wp.float64),  # partial sums in rows, in a fixed order
):
    """Add the partial sums of a world's threads up to a few rows; one thread per entry of `rows`."""
    w, row, column = wp.tid()
    total = wp.float64(0.0)
    thread = row
    while thread < partial.shape[1]:
        if column == largest:
            total = wp.max(total, partial[w, thread, column])
        else:
            total += partial[w, thread, column]
        thread += rows.shape[1]
    rows[w, row, first + column] = total


@kernel
def put_in_order(
    values: wp.array(dtype=wp.float32),  # in the device's order, shape [connection_count]
    place: wp.array(dtype=int),  # index in `result` of each value, shape [connection_count]
    # Out:
    result: wp.array(dtype=wp.float32),  # shape [connection_count]
):
    """Write values of connections in the system's order."""
    c = wp.tid()
    result[place[c]] = values[c]


@functools.cache
def strain_each(dim: int, scalar: type):
    """Compose the kernel, over connections, that writes length / rest length − 1; NaN for broken connections."""
    V, separation = vector(dim, scalar), difference(dim, scalar)

    @kernel
    def strain_of_each(
        # Model:
        connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
        rest_length: wp.array(dtype=scalar),  # l0 [m], shape [connection_count]
        broken_at: wp.array(dtype=wp.float32),  # [s], inf if unbroken, shape [connection_count]; or empty
        place: wp.array(dtype=int),  # index in `strain` of each connection, shape [connection_count]; or empty
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        x_lost: wp.array(dtype=V),  # compensation of positions [m], shape [particle_count], or empty
        # Out:
        strain: wp.array(dtype=scalar),  # shape [connection_count]
    ):
        c = wp.tid()
        length = wp.length(separation(x, x_lost, connections[c][0], connections[c][1]))
        own = scalar(length / wp.float64(rest_length[c]) - wp.float64(1.0))
        if broken_at.shape[0] > 0:
            if wp.isfinite(broken_at[c]):
                own = scalar(wp.nan)
        at = c
        if place.shape[0] > 0:
            at = place[c]
        strain[at] = own

    return strain_of_each
