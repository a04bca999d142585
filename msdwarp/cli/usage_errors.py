"""Words of the command line that are not understood, told in the style of all other errors."""

from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cyclopts import CoercionError, CycloptsError, MissingArgumentError, UnknownCommandError, UnusedCliTokensError

_KINDS: dict[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def usage_errors(error: CycloptsError) -> str:
    """Return in a line what was wrong, and which command says what the words may be."""
    command = error.app.name[0] if error.app is not None else "msdwarp"
    if error.command_chain:
        command = " ".join(("msdwarp", *error.command_chain))
    return f"{_wrong(error)} (see `{command} --help`)"


def _wrong(error: CycloptsError) -> str:
    if isinstance(error, UnknownCommandError) and error.unused_tokens and error.app is not None:
        known = ", ".join(name for name in error.app if not name.startswith("-"))
        return f"command is {error.unused_tokens[0]!r}; it must be one of {known}"
    if isinstance(error, UnusedCliTokensError):
        return f"{' '.join(error.unused_tokens or ())!r} is one argument too many"
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        if any(token.keyword for token in error.argument.tokens) or getattr(error, "keyword", None):
            return f"{error.argument.name} needs a value"
        return f"{error.argument.name} is missing"
    if isinstance(error, CoercionError) and error.msg is None and error.token is not None and error.target_type:
        name = error.token.keyword or (error.argument.name if error.argument is not None else "")
        return f"{name.lstrip('-')} is {error.token.value!r}; it must be {_allowed(error.target_type)}"
    said = str(error).removesuffix(".")
    return said[:1].lower() + said[1:]


def _allowed(kind: Any) -> str:
    """Return what a flag of some type may be."""
    if get_origin(kind) is Annotated:
        return _allowed(get_args(kind)[0])
    if get_origin(kind) is Literal:
        values = [str(value) for value in get_args(kind)]
        return values[0] if len(values) == 1 else f"one of {', '.join(values)}"
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(_allowed(one) for one in get_args(kind) if one is not type(None))
    return _KINDS.get(kind, f"a {getattr(kind, '__name__', kind)}")
