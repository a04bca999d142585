"""Whole numbers on the command line: cyclopts rounds 1.5 to 2 without a word."""

from collections.abc import Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cyclopts import CoercionError, Parameter, Token, convert


def _whole(kind: Any, tokens: Sequence[Token]) -> Any:
    """Return what words are as a type; raise CoercionError if one lies between two numbers where it may not."""
    for place, token in enumerate(tokens):
        try:
            between = "." in token.value and not float(token.value).is_integer()
        except ValueError:
            between = False  # no number: what else it may be is for cyclopts to tell
        if between and all(one is int or get_origin(one) is Literal for one in _kinds(kind, place)):
            takes: Any = Union[tuple(_kinds(kind, place))]  # noqa: UP007
            raise CoercionError(token=token, target_type=takes)
    return convert(kind, tokens)


def _kinds(kind: Any, place: int) -> list[Any]:
    """Return what the word at a place may be: the types within unions, tuples and lists."""
    inner, origin = get_args(kind), get_origin(kind)
    if origin is Annotated:
        return _kinds(inner[0], place)
    if origin in (Union, UnionType):
        return [found for one in inner for found in _kinds(one, place)]
    if origin is tuple and ... not in inner and not any(get_origin(one) is tuple for one in inner):
        return _kinds(inner[place], 0) if place < len(inner) else []
    if origin in (tuple, list, set):
        return [found for one in inner if one is not ... for found in _kinds(one, place)]
    return [] if kind is type(None) else [kind]


Whole = Annotated[int, Parameter(converter=_whole)]
"""The type of a flag that takes whole numbers and no others."""
WholeOrAuto = Annotated[int | Literal["auto"], Parameter(converter=_whole)]
"""The same, or the word auto."""
WholeOrWord = Annotated[int | Literal["auto", "ensemble"], Parameter(converter=_whole)]
"""The same, or the words that say how points of a sweep are shared out."""


def with_wholes(kind: Any) -> Any:
    """Return a type whose flag takes a word for an int, also in unions, tuples and lists, only if it is one."""
    if get_origin(kind) is Annotated:
        inner = get_args(kind)
        return Annotated[(with_wholes(inner[0]), *inner[1:])]  # type: ignore[return-value]
    return Annotated[kind, Parameter(converter=_whole)] if _has_whole(kind) else kind


def _has_whole(kind: Any) -> bool:
    inner, origin = get_args(kind), get_origin(kind)
    if origin is Literal:
        return any(type(value) is int for value in inner)
    if origin in (Annotated, Union, UnionType, tuple, list, set):
        return any(map(_has_whole, inner))
    return kind is int
