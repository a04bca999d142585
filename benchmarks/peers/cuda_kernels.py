"""The CUDA C++ of `cuda`; the numbers in capitals are defined when it is compiled for a body."""

COMMON = r"""
const float RESTITUTION = 0.5f, FRICTION = 0.5f, REST_SPEED = 0.01f;  // msdwarp.Plane's defaults

struct Particle { float4 x, v; float3 f; };

__device__ __forceinline__ float rest_length(int steps_away)
{
    return steps_away == 1 ? 1.0f : steps_away == 2 ? 1.41421356f : 1.73205081f;  // spacing 1 m
}

// The force that a connection to (x, v) exerts on p, per vector from p to x: F = s dx.
__device__ __forceinline__ float pull(float3 dx, float3 dv, float l0)
{
    float inverse_length = rsqrtf(dx.x * dx.x + (dx.y * dx.y + (dx.z * dx.z + 1e-30f)));
    float approach = DAMPING * (dv.x * dx.x + dv.y * dx.y + dv.z * dx.z);
    return STIFFNESS + inverse_length * (approach * inverse_length - STIFFNESS * l0);
}

__device__ __forceinline__ float3 minus(float4 a, float4 b)
{
    return make_float3(a.x - b.x, a.y - b.y, a.z - b.z);
}

__device__ __forceinline__ void add_force(Particle& p, float4 x, float4 v, float l0, bool here = true)
{
    float3 dx = minus(x, p.x);
    float s = here ? pull(dx, minus(v, p.v), l0) : 0.0f;
    p.f.x += s * dx.x;
    p.f.y += s * dx.y;
    p.f.z += s * dx.z;
}

// Semi-implicit Euler, then the floor: no bounce below the rest speed, Coulomb's friction, way taken back.
__device__ __forceinline__ void advance(Particle& p)
{
    float w = p.x.w, h = STEP;
    float4 v_old = p.v, x_old = p.x;
    p.v.x += h * (w * p.f.x);
    p.v.y += h * (w * p.f.y);
    p.v.z += h * (w * p.f.z - (w > 0.0f ? GRAVITY : 0.0f));
    p.x.x += h * p.v.x;
    p.x.y += h * p.v.y;
    p.x.z += h * p.v.z;
    if (p.x.z < FLOOR && p.v.z < 0.0f) {
        float v_n = v_old.z < -REST_SPEED ? -RESTITUTION * v_old.z : 0.0f;
        float speed = sqrtf(p.v.x * p.v.x + p.v.y * p.v.y), loss = FRICTION * (v_n - p.v.z);
        float share = loss < speed ? 1.0f - loss / speed : 0.0f;
        p.v = make_float4(share * p.v.x, share * p.v.y, v_n, 0.0f);
        p.x.x -= (1.0f - share) * (p.x.x - x_old.x);
        p.x.y -= (1.0f - share) * (p.x.y - x_old.y);
        p.x.z = FLOOR;
    }
}

__device__ __forceinline__ void load(Particle& p, const float4* x, const float4* v, int index)
{
    p.x = x[index];
    p.v = v[index];
    p.f = make_float3(0.0f, 0.0f, 0.0f);
}
"""

LATTICE = r"""
// The nine records of a plane pull what is below, in and above it in this thread's column.
template <bool BELOW, bool IN, bool ABOVE>
__device__ __forceinline__ void read_plane(const float4* x, const float4* v, int i, int j, int plane,
                                           Particle& below, Particle& in, Particle& above)
{
    const int column = j * NX + i;
#pragma unroll
    for (int n = 0; n < 9; ++n) {
        const int a = n % 3 - 1, b = n / 3 - 1, away = a * a + b * b;
        const bool here = i + a >= 0 && i + a < NX && j + b >= 0 && j + b < NY, centre = away == 0;
        const int index = plane * NX * NY + column + (here ? b * NX + a : 0);  // no branch: loads run ahead
        const float4 xq = centre && IN ? in.x : x[index];
        const float4 vq = centre && IN ? in.v : v[index];
        if (BELOW) add_force(below, xq, vq, rest_length(away + 1), here);
        if (IN && !centre) add_force(in, xq, vq, rest_length(away), here);
        if (ABOVE) add_force(above, xq, vq, rest_length(away + 1), here);
    }
}

extern "C" __global__ void __launch_bounds__(BLOCK)
lattice_step(const float4* __restrict__ x, const float4* __restrict__ v, float4* __restrict__ x_out,
             float4* __restrict__ v_out)
{
    const int i = blockIdx.x * blockDim.x + threadIdx.x, j = blockIdx.y * blockDim.y + threadIdx.y;
    if (i >= NX || j >= NY) return;
    const int first = blockIdx.z * DEPTH, end = min(first + DEPTH, NZ), column = j * NX + i;
    Particle below, in, above;  // of the plane that is read
    load(in, x, v, first * NX * NY + column);
    if (first > 0) read_plane<false, false, true>(x, v, i, j, first - 1, below, below, in);
    for (int plane = first; plane < end; ++plane) {
        const bool bottom = plane == first, top = plane + 1 == end;
        if (!top) load(above, x, v, (plane + 1) * NX * NY + column);
        if (bottom && top) read_plane<false, true, false>(x, v, i, j, plane, below, in, above);
        else if (bottom) read_plane<false, true, true>(x, v, i, j, plane, below, in, above);
        else if (top) read_plane<true, true, false>(x, v, i, j, plane, below, in, above);
        else read_plane<true, true, true>(x, v, i, j, plane, below, in, above);
        if (!bottom) {
            advance(below);
            x_out[(plane - 1) * NX * NY + column] = below.x;
            v_out[(plane - 1) * NX * NY + column] = below.v;
        }
        below = in;
        in = above;
    }
    if (end < NZ) read_plane<true, false, false>(x, v, i, j, end, below, in, above);
    advance(below);
    x_out[(end - 1) * NX * NY + column] = below.x;
    v_out[(end - 1) * NX * NY + column] = below.v;
}
"""

LANES = r"""
// LANES threads share a particle: each takes every LANES-th of the 27 places around, and they add up by shuffles.
extern "C" __global__ void __launch_bounds__(BLOCK)
lanes_step(const float4* __restrict__ x, const float4* __restrict__ v, float4* __restrict__ x_out,
           float4* __restrict__ v_out)
{
    const int thread = blockIdx.x * BLOCK + threadIdx.x, index = thread / LANES, lane = thread % LANES;
    const bool mine = index < NX * NY * NZ;
    const int at = mine ? index : 0, i = at % NX, j = at / NX % NY, k = at / (NX * NY);
    Particle p;
    load(p, x, v, at);
#pragma unroll
    for (int round = 0; round < (27 + LANES - 1) / LANES; ++round) {
        const int n = round * LANES + lane;
        const int a = n % 3 - 1, b = n / 3 % 3 - 1, d = n / 9 - 1, away = a * a + b * b + d * d;
        const bool here = n < 27 && away > 0 && i + a >= 0 && i + a < NX && j + b >= 0 && j + b < NY && k + d >= 0
                          && k + d < NZ;
        const int other = at + (here ? (d * NY + b) * NX + a : 0);  // no branch: loads run ahead
        add_force(p, x[other], v[other], rest_length(away), here);
    }
#pragma unroll
    for (int far = LANES / 2; far > 0; far /= 2) {
        p.f.x += __shfl_xor_sync(0xffffffffu, p.f.x, far);
        p.f.y += __shfl_xor_sync(0xffffffffu, p.f.y, far);
        p.f.z += __shfl_xor_sync(0xffffffffu, p.f.z, far);
    }
    if (mine && lane == 0) {
        advance(p);
        x_out[index] = p.x;
        v_out[index] = p.v;
    }
}
"""

ONE_BLOCK = r"""
extern "C" __global__ void __launch_bounds__(1024)
one_block_steps(float4* x, float4* v, int steps)
{
    __shared__ float4 shared_x[NX * NY * NZ], shared_v[NX * NY * NZ];
    const int index = threadIdx.x, i = index % NX, j = index / NX % NY, k = index / (NX * NY);
    const bool mine = index < NX * NY * NZ;
    Particle p;
    if (mine) {
        load(p, x, v, index);
        shared_x[index] = p.x;
        shared_v[index] = p.v;
    }
    __syncthreads();
    for (int step = 0; step < steps; ++step) {
        if (mine) {
            p.f = make_float3(0.0f, 0.0f, 0.0f);
#pragma unroll
            for (int n = 0; n < 27; ++n) {
                const int a = n % 3 - 1, b = n / 3 % 3 - 1, d = n / 9 - 1, away = a * a + b * b + d * d;
                if (away == 0 || i + a < 0 || i + a >= NX || j + b < 0 || j + b >= NY || k + d < 0 || k + d >= NZ)
                    continue;
                const int other = index + (d * NY + b) * NX + a;
                add_force(p, shared_x[other], shared_v[other], rest_length(away));
            }
            advance(p);
        }
        __syncthreads();
        if (mine) {
            shared_x[index] = p.x;
            shared_v[index] = p.v;
        }
        __syncthreads();
    }
    if (mine) {
        x[index] = p.x;
        v[index] = p.v;
    }
}
"""

SCATTER = r"""
__device__ __forceinline__ void add_to(float4* f, float3 dx, float s)
{
#if __CUDA_ARCH__ >= 900
    atomicAdd(f, make_float4(s * dx.x, s * dx.y, s * dx.z, 0.0f));
#else
    atomicAdd(&f->x, s * dx.x);
    atomicAdd(&f->y, s * dx.y);
    atomicAdd(&f->z, s * dx.z);
#endif
}

extern "C" __global__ void __launch_bounds__(BLOCK)
scatter_forces(const int2* __restrict__ connections, const float* __restrict__ rest_lengths,
               const float4* __restrict__ x, const float4* __restrict__ v, float4* f, int count)
{
    const int n = blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= count) return;
    const int2 ends = connections[n];
    const float3 dx = minus(x[ends.y], x[ends.x]), dv = minus(v[ends.y], v[ends.x]);
    const float s = pull(dx, dv, rest_lengths[n]);
    add_to(f + ends.x, dx, s);
    add_to(f + ends.y, dx, -s);
}

extern "C" __global__ void __launch_bounds__(BLOCK)
integrate(float4* x, float4* v, float4* f, int count)
{
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    Particle p;
    load(p, x, v, i);
    p.f = make_float3(f[i].x, f[i].y, f[i].z);
    f[i] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
    advance(p);
    x[i] = p.x;
    v[i] = p.v;
}
"""
