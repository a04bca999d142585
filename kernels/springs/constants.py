"""Storage of the constants of springs: one set if all are equal, one of each kind, or one of each connection."""

import functools

import warp as wp

from ..basis import vector
from ..records import records

CONSTANTS = ("rest_length", "stiffness", "damping")
"""The constants of a spring."""
MOST_KINDS = 256
"""Maximal number of kinds of springs, so that a byte can number them."""
KIND_SHIFT = 24
"""Number of bits of the particle's index in a slot that also has the spring's kind, above these bits."""
TAKE = """
#if defined(__CUDA_ARCH__)
    return __ldcs(values.data + c);  // read once: it need not stay in the cache
#else
    return values.data[c];
#endif
"""


@functools.cache
def constants(scalar: type, storage: str, several: bool = False):
    """Compose (Constants, take): the struct, and take(constants, c), the constants of spring or slot c.

    There are three storages. Uniform: "one" (all springs are equal). By kind, from a table of a few kinds: "kinds"
    (a byte per spring has its kind) or "packed" (c is a kind). By connection: "own" (three numbers per spring),
    "lengths" (a rest length per spring, all else equal) or "listed" (three numbers per spring; c is a slot with a
    spring's index). `take` returns a vector in the order of CONSTANTS; with `several` laws the number of the
    spring's law is a fourth constant.
    """
    Three = vector(4 if several else 3, scalar)
    load = records(4 if several else 3, scalar).load

    if storage == "one":

        @wp.struct
        class OneForAll:
            all: Three  # in the order of CONSTANTS

        @wp.func
        def take_one(constants: OneForAll, c: int) -> Three:
            return constants.all

        return OneForAll, take_one
    if storage in ("kinds", "packed"):

        @wp.func_native(TAKE)
        def kind_of(values: wp.array(dtype=wp.uint8), c: int) -> wp.uint8: ...

        @wp.struct
        class Kinds:
            if storage == "kinds":
                kind: wp.array(dtype=wp.uint8)  # shape [connection_count], or [slot_count]
            table: wp.array(dtype=Three)  # in the order of CONSTANTS, shape [kind_count]

        @wp.func
        def take_kind(constants: Kinds, c: int) -> Three:
            kind = c
            if wp.static(storage == "kinds"):
                kind = int(kind_of(constants.kind, c))
            return load(constants.table, kind)

        return Kinds, take_kind

    @wp.func_native(TAKE)
    def number(values: wp.array(dtype=scalar), c: int) -> scalar: ...

    listed, lengths = storage == "listed", storage == "lengths"
    Each = scalar if lengths else wp.array(dtype=scalar)

    @wp.struct
    class Own:
        if listed:
            connection: wp.array(dtype=int)  # −1 in padding slots, shape [slot_count]
        # Each of shape [connection_count], or [slot_count]; of "lengths" k and b are numbers:
        rest_length: wp.array(dtype=scalar)  # l0 [m]
        stiffness: Each  # k [N/m]
        damping: Each  # b in the units of the law
        if several:
            law: wp.array(dtype=wp.uint8)

    @wp.func
    def take_own(constants: Own, c: int) -> Three:
        if wp.static(listed):
            c = wp.max(constants.connection[c], 0)  # padding slots exert no force
        if wp.static(lengths):
            return Three(number(constants.rest_length, c), constants.stiffness, constants.damping)
        elif wp.static(several):
            l0 = constants.rest_length[c]
            return Three(l0, constants.stiffness[c], constants.damping[c], scalar(constants.law[c]))
        elif wp.static(listed):
            return Three(constants.rest_length[c], constants.stiffness[c], constants.damping[c])
        else:
            return Three(
                number(constants.rest_length, c), number(constants.stiffness, c), number(constants.damping, c)
            )

    return Own, take_own
