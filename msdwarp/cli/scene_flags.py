"""The flags of a scene: a command made from the parameters of `build` and the options of a command."""

import inspect
from dataclasses import asdict
from typing import Annotated, Any

from cyclopts import App, Parameter, convert

from .options import flattened
from .scene_files import Origin

COMMON = {
    "mass": "Mass of each particle [kg].",
    "stiffness": "Spring constant of each connection [N/m].",
    "damping": "Damper constant of each connection [N s/m].",
}
"""Help texts of common parameters, if a scene does not describe them."""


def new_app(name: str, **options: Any) -> App:
    """Return a command-line app that raises errors, and rejects fractions for whole numbers."""
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
    """Return a command whose flags are the parameters of `build` and the fields of `options_type`.

    The command returns (origin with its parameters, options), or None if help was shown. No parameter may have the
    name of an option.
    """
    defaults = options_type()

    def command_of_flags(*, options: Any = defaults, **parameters: Any) -> tuple[Origin, Any]:
        return origin._replace(parameters=parameters), options

    keyword = inspect.Parameter.KEYWORD_ONLY
    try:
        own = inspect.signature(origin.build, eval_str=True).parameters
    except Exception as error:
        raise ValueError(f"build of scene {origin.name!r} has a wrong annotation: {error}") from error
    if clash := own.keys() & flattened(asdict(defaults)).keys():
        raise ValueError(
            f"build of scene {origin.name!r} has parameters with the names of common flags: {sorted(clash)}"
        )
    every = [_described(parameter, origin.build.__doc__).replace(kind=keyword) for parameter in own.values()]
    every.append(inspect.Parameter("options", keyword, annotation=options_type, default=defaults))
    command_of_flags.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    command_of_flags.__annotations__ = {parameter.name: parameter.annotation for parameter in every}
    command_of_flags.__doc__ = origin.build.__doc__
    app = new_app(command, version_flags=())
    app.default(command_of_flags)
    return app


def _described(parameter: inspect.Parameter, doc: str | None) -> inspect.Parameter:
    """Return a parameter of a scene, with the usual help for its name unless the docstring describes it."""
    if parameter.name not in COMMON or f"\n{parameter.name}\n" in inspect.cleandoc(doc or ""):
        return parameter
    common = Parameter(help=COMMON[parameter.name])
    return parameter.replace(annotation=Annotated[parameter.annotation, common])


def _convert(kind: Any, tokens: Any) -> Any:
    """Convert words as cyclopts does, but reject 1.5 for a whole number, which cyclopts rounds to 2."""

    def converted(kind: Any, word: str) -> Any:
        if kind is int and "." in word and not float(word).is_integer():
            raise ValueError
        return convert(kind, [word])

    return convert(kind, tokens, converted)
