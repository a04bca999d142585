"""Whole numbers on the command line: cyclopts rounds 1.5 to 2 without a word."""

from collections.abc import Sequence
from types import GenericAlias, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cyclopts import CoercionError, Parameter, Token, convert


def _whole(kind: Any, tokens: Sequence[Token]) -> Any:
    """Return what a word is as an int or what else a type has; raise CoercionError if it lies between two."""
    try:
        between = "." in tokens[0].value and not float(tokens[0].value).is_integer()
    except ValueError:
        between = False  # no number: what else it may be is for cyclopts to tell
    if between:
        raise CoercionError(token=tokens[0], target_type=kind)
    return convert(kind, tokens)


Whole = Annotated[int, Parameter(converter=_whole)]
"""The type of a flag that takes whole numbers and no others."""
WholeOrAuto = Annotated[int | Literal["auto"], Parameter(converter=_whole)]
"""The same, or the word auto."""


def with_wholes(kind: Any) -> Any:
    """Return a type with `Whole` where it has int, also in unions, tuples and lists."""
    if kind is int:
        return Whole
    inner = get_args(kind)
    origin = get_origin(kind)
    if origin is Annotated:
        return Annotated[(with_wholes(inner[0]), *inner[1:])]  # type: ignore[return-value]
    if origin in (Union, UnionType):  # where cyclopts does not look at what is annotated within
        takes_others = float in inner or str in inner
        return kind if takes_others or int not in inner else Annotated[kind, Parameter(converter=_whole)]
    if origin in (tuple, list, set):
        return GenericAlias(origin, tuple(map(with_wholes, inner)))
    return kind
