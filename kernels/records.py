"""The layout of particles in memory: vectors of three coordinates in records of four numbers.

A GPU reads or writes a record (16 bytes) with one instruction, and from compute capability 9.0 on also adds to it
atomically. This access is most of the cost of a force. The fourth number is never used.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from .basis import vector


class Records(NamedTuple):
    """Access to the vector of particle i in an array."""

    load: Any
    """wp.func (x, i) -> x[i]."""
    store: Any
    """wp.func (x, i, value): x[i] = value."""
    add: Any
    """wp.func (x, i, value): x[i] += value, atomically."""


def record_length(dim: int) -> int:
    """Return how many numbers a vector of `dim` coordinates takes in memory."""
    return 4 if dim == 3 else dim


LOAD = """
#if defined(__CUDA_ARCH__)
    {read}
#else
    const auto* r = x.data->c + 4 * static_cast<size_t>(i);
    return {{r[0], r[1], r[2]}};
#endif
"""
STORE = """
#if defined(__CUDA_ARCH__)
    {write}
#else
    auto* r = x.data->c + 4 * static_cast<size_t>(i);
    r[0] = value[0], r[1] = value[1], r[2] = value[2];
#endif
"""
ADD = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    {add}
#elif defined(__CUDA_ARCH__)
    wp::atomic_add(x, i, value);
#else
    auto* r = x.data->c + 4 * static_cast<size_t>(i);
    r[0] += value[0], r[1] += value[1], r[2] += value[2];
#endif
"""
FLOAT4 = {
    "read": """const float4 r = reinterpret_cast<const float4*>(x.data)[i];
    return wp::vec_t<3, wp::float32>(r.x, r.y, r.z);""",
    "write": "reinterpret_cast<float4*>(x.data)[i] = make_float4(value[0], value[1], value[2], 0.0f);",
    "add": "atomicAdd(reinterpret_cast<float4*>(x.data) + i, make_float4(value[0], value[1], value[2], 0.0f));",
}
DOUBLE4 = {
    "read": """const double2* r = reinterpret_cast<const double2*>(x.data) + 2 * static_cast<size_t>(i);
    const double2 a = r[0], b = r[1];
    return wp::vec_t<3, wp::float64>(a.x, a.y, b.x);""",
    "write": """double2* r = reinterpret_cast<double2*>(x.data) + 2 * static_cast<size_t>(i);
    r[0] = make_double2(value[0], value[1]);
    r[1] = make_double2(value[2], 0.0);""",
    "add": "wp::atomic_add(x, i, value);",
}


@functools.cache
def records(dim: int, scalar: type) -> Records:
    """Compose the access to arrays of vectors that `msdwarp.engine.Model.vectors` made."""
    V = vector(dim, scalar)
    if dim == 3:
        parts = FLOAT4 if scalar is wp.float32 else DOUBLE4

        @wp.func_native(LOAD.format(**parts))
        def load(x: wp.array(dtype=V), i: int) -> V: ...

        @wp.func_native(STORE.format(**parts))
        def store(x: wp.array(dtype=V), i: int, value: V): ...

        @wp.func_native(ADD.format(**parts))
        def add(x: wp.array(dtype=V), i: int, value: V): ...

    else:
        # Warp reads x[-1] as the last element. Here it means the memory before the first, which may be read.
        @wp.func_native("return x.data[i];")
        def load(x: wp.array(dtype=V), i: int) -> V: ...

        @wp.func_native("x.data[i] = value;")
        def store(x: wp.array(dtype=V), i: int, value: V): ...

        @wp.func
        def add(x: wp.array(dtype=V), i: int, value: V):
            wp.atomic_add(x, i, value)

    return Records(load, store, add)


ENTRY = """
#if defined(__CUDA_ARCH__)
    return __ldg(values.data + i);
#else
    return values.data[i];
#endif
"""
ENTRY_OF_VECTORS = """
#if defined(__CUDA_ARCH__)
    {kind} value;
    for (int k = 0; k < {length}; ++k)
        value.c[k] = __ldg(values.data[i].c + k);
    return value;
#else
    return values.data[i];
#endif
"""


@functools.cache
def table(kind: type) -> Any:
    """Compose wp.func (values, i) -> values[i], for values that no kernel changes while it runs.

    They are read through a GPU's read-only cache, which barriers in a kernel of many substeps do not empty, as
    they empty the ordinary cache.
    """
    length = getattr(kind, "_length_", 1)
    text = ENTRY if length == 1 else ENTRY_OF_VECTORS.format(kind=f"wp::vec_t<{length}, wp::int32>", length=length)

    @wp.func_native(text)
    def entry(values: wp.array(dtype=kind), i: int) -> kind: ...

    return entry
