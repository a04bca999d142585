"""Addresses of arrays: functions that shift them, and that tell the compiler which memory they point to.

If a kernel reads its arrays' addresses from memory, the compiler does not know which memory they point to, and
emits slower instructions. So the kernel states the memory (`Place`).
"""

import functools
from enum import Enum
from typing import Any

import warp as wp


class Place(Enum):
    """A memory of the GPU; the value is CUDA's predicate for addresses in that memory."""

    DEVICE = "__isGlobal"
    """The memory of the whole device."""
    CHIP = "__isShared"
    """The shared memory of a multiprocessor, for a block of threads."""


SHIFT = "s.{0}.data = reinterpret_cast<decltype(s.{0}.data)>(reinterpret_cast<char*>(s.{0}.data) + bytes);"
SAY = """
#if defined(__CUDA_ARCH__)
    __builtin_assume({1}(s.{0}.data));
#endif
"""


def arrays_of(Step: Any, compensated: bool) -> tuple[str, ...]:
    """Return the names of the arrays in a method's step struct that have a vector for each particle.

    Only compensated precision includes the arrays of rounding errors; otherwise they are empty.
    """
    fields = []
    for name, field in Step.vars.items():
        if wp.types.is_array(field.type):
            fields.append(name)
        elif name == "compensation" and compensated:
            fields += [f"compensation.{inner}" for inner in field.type.vars]
    return tuple(fields)


@functools.cache
def shifts(Struct: Any, fields: tuple[str, ...], place: Place = Place.DEVICE) -> Any:
    """Compose wp.func (s, bytes): shift the arrays of a struct by a number of bytes, in the memory `place`.

    A field may be nested: "compensation.x".
    """

    @wp.func_native("\n".join(SHIFT.format(one) + SAY.format(one, place.value) for one in fields))
    def shift(s: wp.ref[Struct], bytes: wp.int64): ...

    return shift


@functools.cache
def on_device(Struct: Any, fields: tuple[str, ...]) -> Any:
    """Compose wp.func (s): tell the compiler that a struct's arrays lie in device memory."""

    @wp.func_native("\n".join(SAY.format(one, Place.DEVICE.value) for one in fields))
    def say(s: wp.ref[Struct]): ...

    return say
