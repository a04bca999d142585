"""Storage of the constants of springs: one set if all springs are equal, one per spring only if necessary."""

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

    Storage: "one" (all springs are equal), "kinds" (a byte per spring, and a table of a few kinds), "packed" (a
    table of kinds; c is a kind), "lengths" (a rest length per spring, all else equal), "own" (three numbers per
    spring) or "listed" (three numbers per spring; c is a slot with a spring's index). `take` returns a vector in
    the order of CONSTANTS; with `several` laws the number of the spring's law is a fourth constant.
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
    if storage == "packed":

        @wp.struct
        class Table:
            table: wp.array(dtype=Three)  # in the order of CONSTANTS, shape [kind_count]

        @wp.func
        def take_listed(constants: Table, kind: int) -> Three:
            return load(constants.table, kind)

        return Table, take_listed
    if storage == "kinds":

        @wp.func_native(TAKE)
        def kind_of(values: wp.array(dtype=wp.uint8), c: int) -> wp.uint8: ...

        @wp.struct
        class Kinds:
            kind: wp.array(dtype=wp.uint8)  # shape [connection_count], or [slot_count]
            table: wp.array(dtype=Three)  # in the order of CONSTANTS, shape [kind_count]

        @wp.func
        def take_kind(constants: Kinds, c: int) -> Three:
            return load(constants.table, int(kind_of(constants.kind, c)))

        return Kinds, take_kind

    @wp.func_native(TAKE)
    def number(values: wp.array(dtype=scalar), c: int) -> scalar: ...

    if storage == "lengths":

        @wp.struct
        class Lengths:
            rest_length: wp.array(dtype=scalar)  # l0 [m], shape [connection_count], or [slot_count]
            stiffness: scalar  # k [N/m]
            damping: scalar  # b in the units of the law

        @wp.func
        def take_length(constants: Lengths, c: int) -> Three:
            return Three(number(constants.rest_length, c), constants.stiffness, constants.damping)

        return Lengths, take_length
    if storage == "listed":

        @wp.struct
        class Listed:
            connection: wp.array(dtype=int)  # −1 in padding slots, shape [slot_count]
            # Each of shape [connection_count]:
            rest_length: wp.array(dtype=scalar)  # l0 [m]
            stiffness: wp.array(dtype=scalar)  # k [N/m]
            damping: wp.array(dtype=scalar)  # b in the units of the law
            if several:
                law: wp.array(dtype=wp.uint8)

        @wp.func
        def take_named(constants: Listed, slot: int) -> Three:
            c = wp.max(constants.connection[slot], 0)  # padding slots exert no force
            return Three(constants.rest_length[c], constants.stiffness[c], constants.damping[c])

        @wp.func
        def take_named_and_law(constants: Listed, slot: int) -> Three:
            c = wp.max(constants.connection[slot], 0)
            l0 = constants.rest_length[c]
            return Three(l0, constants.stiffness[c], constants.damping[c], scalar(constants.law[c]))

        return Listed, take_named_and_law if several else take_named

    @wp.struct
    class Own:
        # Each of shape [connection_count], or [slot_count]:
        rest_length: wp.array(dtype=scalar)  # l0 [m]
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        damping: wp.array(dtype=scalar)  # b in the units of the law
        if several:
            law: wp.array(dtype=wp.uint8)

    @wp.func
    def take_own(constants: Own, c: int) -> Three:
        return Three(
            number(constants.rest_length, c), number(constants.stiffness, c), number(constants.damping, c)
        )

    @wp.func
    def take_own_and_law(constants: Own, c: int) -> Three:
        l0 = constants.rest_length[c]
        return Three(l0, constants.stiffness[c], constants.damping[c], scalar(constants.law[c]))

    return Own, take_own_and_law if several else take_own
