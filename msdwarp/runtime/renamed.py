"""Names of before 0.3, which raise an error with the new one. This file goes with the version after."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

T = TypeVar("T")
RENAMED = {"ColourScale": "ColorScale"}
"""Names of the package: old, new."""


def renamed(**names: str) -> Callable[[T], T]:
    """Let a class or a function raise TypeError with the new name for keywords of before 0.3: old="new"."""

    def decorate(what: T) -> T:
        call: Any = what.__init__ if isinstance(what, type) else what
        own: str = what.__name__  # type: ignore[attr-defined]

        @wraps(call)
        def checked(*arguments: Any, **named: Any) -> Any:
            for old in names.keys() & named.keys():
                raise TypeError(f"{own}({old}=...) is {names[old]} since 0.3")
            return call(*arguments, **named)

        if not isinstance(what, type):
            return cast(T, checked)
        what.__init__ = checked  # type: ignore[misc]
        return what

    return decorate
