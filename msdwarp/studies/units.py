"""Units of a scene's parameters, as docstrings give them in brackets."""

import inspect
import re
from collections.abc import Callable, Iterable
from itertools import takewhile
from typing import Any

USUAL = {"mass": "kg", "stiffness": "N/m", "damping": "N s/m", "duration": "s", "fps": "1/s"}
"""Units of parameters that a docstring does not describe, and of options."""
_UNIT = re.compile(r"(?<!shape )\[([^\[\]]*[^\W\d_][^\[\]]*|[°%])\]")
"""A unit in brackets: "[N/m]", "[°]"; no shape, such as "[3]"."""


def units_of(function: Callable[..., Any], names: Iterable[str]) -> dict[str, str]:
    """Return the units of a function's parameters by name; without an entry if the docstring gives none.

    The docstring describes a parameter in the line that begins with its name, or in indented lines below.
    """
    lines, found = inspect.cleandoc(function.__doc__ or "").splitlines(), dict[str, str]()
    for name in names:
        unit, begins = USUAL.get(name), re.compile(rf"(\s*)(?::param |\w+, )*{re.escape(name)}(?=$|[:,( ])")
        for k, line in enumerate(lines):
            if match := begins.match(line):
                deeper = takewhile(re.compile(rf"{match[1]}\s|$").match, lines[k + 1 :])
                if (described := unit_in(" ".join([line, *deeper]))) is not None:
                    unit = described
                    break
        if unit is not None:
            found[name] = unit
    return found


def unit_in(text: str | None) -> str | None:
    """Return the first unit in a text, without its brackets; None if there is none."""
    match = _UNIT.search(text or "")
    return match and match[1]
