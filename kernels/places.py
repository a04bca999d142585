"""Where arrays lie: shifted to another place, and said to be in the memory in which they are.

A kernel that reads its arrays' addresses from memory does not know which memory they point to, and then reads by
slower instructions than it could: so the kernel tells the compiler (`Place`).
"""

import functools
from enum import Enum
from typing import Any

import warp as wp


class Place(Enum):
    """A memory of the GPU, by CUDA's name of the test whether an address lies there."""

    DEVICE = "__isGlobal"
    """That of the whole device."""
    CHIP = "__isShared"
    """That of a multiprocessor, which a block of threads shares."""


SHIFT = "s.{0}.data = reinterpret_cast<decltype(s.{0}.data)>(reinterpret_cast<char*>(s.{0}.data) + bytes);"
SAY = """
#if defined(__CUDA_ARCH__)
    __builtin_assume({1}(s.{0}.data));
#endif
"""


def arrays_of(Step: Any, compensated: bool) -> tuple[str, ...]:
    """Return the names of the arrays of a method's step: a vector for each particle each.

    What sums have lost is as long in compensated precision only, and else has none.
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
    """Compose wp.func (s, bytes): move the arrays of a struct by a number of bytes; they are at that place.

    Fields may be "of.fields".
    """

    @wp.func_native("\n".join(SHIFT.format(one) + SAY.format(one, place.value) for one in fields))
    def shift(s: wp.ref[Struct], bytes: wp.int64): ...

    return shift


@functools.cache
def on_device(Struct: Any, fields: tuple[str, ...]) -> Any:
    """Compose wp.func (s): arrays of a struct lie in the device's memory."""

    @wp.func_native("\n".join(SAY.format(one, Place.DEVICE.value) for one in fields))
    def say(s: wp.ref[Struct]): ...

    return say
