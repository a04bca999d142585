"""The flags of a scene: a command made of the parameters of its `build` and of the options of the command."""

import inspect
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from itertools import cycle
from typing import Any, get_args

from cyclopts import App, CoercionError, Parameter, Token, convert

from .scene_files import Origin


def new_app(name: str, **options: Any) -> App:
    """Return a command that raises its errors, and refuses fractions for whole numbers."""
    return App(
        name=name,
        suppress_keyboard_interrupt=False,
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        default_parameter=Parameter(converter=_convert),
        **options,
    )


def flags_app(origin: Origin, command: str, options_type: type) -> App:
    """Return the command whose flags are the parameters of `build` and the fields of `options_type`.

    It returns the origin with its parameters, and the options; None if help was shown. A parameter must not have
    the name of an option.
    """
    defaults = options_type()

    def command_of_flags(*, options: Any = defaults, **parameters: Any) -> tuple[Origin, Any]:
        return origin._replace(parameters=parameters), options

    keyword = inspect.Parameter.KEYWORD_ONLY
    own = inspect.signature(origin.build, eval_str=True).parameters
    if clash := own.keys() & _names(defaults):
        raise ValueError(
            f"build of scene {origin.name!r} has parameters with the names of common flags: {sorted(clash)}"
        )
    every = [parameter.replace(kind=keyword) for parameter in own.values()]
    every.append(inspect.Parameter("options", keyword, annotation=options_type, default=defaults))
    command_of_flags.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    command_of_flags.__annotations__ = {parameter.name: parameter.annotation for parameter in every}
    command_of_flags.__doc__ = origin.build.__doc__
    app = new_app(command, version_flags=())
    app.default(command_of_flags)
    return app


def _names(options: Any) -> set[str]:
    """Return the names of options, with those of nested ones."""
    names = set()
    for one in fields(options):
        value = getattr(options, one.name)
        names |= _names(value) if is_dataclass(value) else {one.name}
    return names


def _convert(kind: Any, tokens: Any) -> Any:
    """Convert words as cyclopts does, but refuse 1.5 for a whole number, which cyclopts rounds to 2."""
    value = convert(kind, tokens)
    several = isinstance(value, tuple | list | set)
    for token, found in zip(tokens, cycle(_flat(value)), strict=False):
        if isinstance(token, Token) and type(found) is int and "." in token.value and float(token.value) != found:
            others = () if several else {float, str} & set(get_args(kind))
            if not others:
                raise CoercionError(token=token, target_type=int if several else kind)
            value = convert(float if float in others else str, tokens)
    return value


def _flat(value: Any) -> Iterable[Any]:
    """Yield the numbers of nested lists and tuples."""
    if isinstance(value, tuple | list | set):
        for one in value:
            yield from _flat(one)
    else:
        yield value
