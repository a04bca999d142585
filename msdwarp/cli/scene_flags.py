"""The flags of a scene: a command made of the parameters of its `build` and of the options of what is done."""

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

from cyclopts import App

from .integer_flags import with_wholes
from .scene_files import Origin


def flags_app(origin: Origin, command: str, options_type: type, act: Callable[[Origin, Any], None]) -> App:
    """Return the command whose flags are the parameters of `build` and the fields of `options_type`.

    It calls `act` with the scene's origin, which has the parameters then, and the options.

    Raises
    ------
    ValueError
        If a parameter has the name of an option.
    """
    defaults = options_type()

    def command_of_flags(*, options: Any = defaults, **parameters: Any) -> None:
        act(origin._replace(parameters=parameters), options)

    own = inspect.signature(origin.build, eval_str=True).parameters.values()
    own = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=with_wholes(parameter.annotation))
        for parameter in own
    ]
    common = inspect.Parameter(
        "options", inspect.Parameter.KEYWORD_ONLY, annotation=options_type, default=defaults
    )
    clash = {parameter.name for parameter in own} & _names(defaults)
    if clash:
        raise ValueError(
            f"build of scene {origin.name!r} has parameters with the names of common flags: {sorted(clash)}"
        )
    command_of_flags.__signature__ = inspect.Signature([*own, common])  # type: ignore[attr-defined]
    command_of_flags.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, common)}
    command_of_flags.__doc__ = origin.build.__doc__
    scene_app = App(name=command, version_flags=(), suppress_keyboard_interrupt=False)
    scene_app.default(command_of_flags)
    return scene_app


def _names(options: Any) -> set[str]:
    """Return the names of options, those within others among them."""
    names = set()
    for one in fields(options):
        value = getattr(options, one.name)
        names |= _names(value) if is_dataclass(value) else {one.name}
    return names
