"""Checks of users' functions that are compiled into kernels (`wp.func`)."""

import ast
import zlib
from typing import Any

from .. import checks


def check_law(name: str, function: Any, arguments: tuple[str, ...], returned: str) -> None:
    """Raise ValueError unless a law is a generic `wp.func` of these arguments, for any scalar type."""
    taken = getattr(getattr(function, "adj", None), "args", ())
    if len(taken) != len(arguments) or any(one.type is not Any for one in taken):
        signature = ", ".join(f"{one}: Any" for one in arguments)
        raise ValueError(
            f"{name} is {checks.repr_short(function)}; it must be a wp.func ({signature}) -> {returned}"
        )
    import warp as wp

    for scalar in (wp.float32, wp.float64):
        check_types(name, function, dict.fromkeys(arguments, scalar), scalar)


def check_types(name: str, function: Any, arguments: dict[str, type], returned: type) -> set[str]:
    """Return which of these arguments the code of a `wp.func` names.

    Raises ValueError unless it can be compiled for their types, and returns `returned`.
    """
    import warp as wp
    from warp.types import type_repr, types_equal

    taken = ", ".join(f"{one}: {type_repr(kind)}" for one, kind in arguments.items())
    if not isinstance(function, wp.Function):
        raise ValueError(f"{name} is {checks.repr_short(function)}; it must be a wp.func ({taken})")
    overload = function.get_overload(list(arguments.values()), {})
    if overload is None:
        own = ", ".join(function.adj.arg_types)
        raise ValueError(
            f"{name} is {function.key}({own}); it must be a wp.func ({taken}), or one of arguments annotated Any"
        )
    try:
        overload.build(None)
    except Exception as error:  # Warp raises errors of its own, and passes on those of the function's expressions
        reason = error.args[0] if error.args else checks.message(error)
        raise ValueError(f"{name} cannot be compiled for ({taken}): {reason}") from error
    _hash_all_constants(overload, set())
    given = [one.type for one in overload.adj.return_var or ()]
    if len(given) != 1 or not types_equal(given[0], returned):
        is_given = ", ".join(map(type_repr, given)) or "nothing"
        raise ValueError(f"{name} returns {is_given} for ({taken}); it must return {type_repr(returned)}")
    named = {one.id for one in ast.walk(overload.adj.tree) if isinstance(one, ast.Name)}
    return {ours for ours, own in zip(arguments, overload.adj.args, strict=True) if own.label in named}


def _hash_all_constants(overload: Any, seen: set[Any]) -> None:
    """Have the hash of a kernel include all constants in a generic function, and in those that it calls.

    Warp hashes the generic function. It finds values of `wp.static` that depend on the variable of a loop when it
    generates code for an overload, and of numbers it hashes the digits of float32. So two laws that differ in
    nothing else would share a kernel; see `msdwarp.kernels.basis.fully_hashed`.
    """
    seen.add(overload)
    adj, generic = overload.adj, overload.generic_parent
    constants, _, functions = adj.get_references()
    if generic is not None:
        found = [*constants.items(), *adj.resolved_static_expressions.items(), *adj.deferred_static_expressions]
        digits = repr([value for _, value in found if isinstance(value, float)])
        digest = zlib.crc32(digits.encode()) >> 1  # 31 bits, an int for Warp
        generic.adj.deferred_static_expressions = [*adj.deferred_static_expressions, ("digits", digest)]
    for called in functions:
        for one in [] if called.is_builtin() else list(called.user_overloads.values()):
            if one not in seen:
                _hash_all_constants(one, seen)
