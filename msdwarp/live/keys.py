"""The keys of a view, which include those of the 2014 program, and their commands."""

from typing import Any, NamedTuple


class Key(NamedTuple):
    """A key, by its X11 name; the view's command and the command's values; the text in the list of keys."""

    name: str
    command: str
    values: dict[str, Any]
    text: str
    shift: bool = False


STEP = 1.25
"""Factor by which a key press multiplies a parameter."""
FLAGS = "v"
"""The key that prints the camera's flags of the screen where it is pressed."""
_SCALED = (("m", "mass"), ("s", "stiffness"), ("l", "rest_length"), ("d", "damping"))
KEYS = (
    Key("space", "pause", {}, "pause or continue"),
    Key("right", "step", {}, "one frame"),
    Key("up", "pace", {"by": 2.0}, "play faster"),
    Key("down", "pace", {"by": 0.5}, "play slower"),
    *(
        Key(key, "scale", {"name": name, "by": by}, f"{word} {name.replace('_', ' ')}", shift)
        for key, name in _SCALED
        for word, by, shift in (("more", STEP, False), ("less", 1 / STEP, True))
    ),
    Key("f", "freeze", {}, "freeze: rest lengths become the current lengths"),
    Key("r", "reset", {}, "restart"),
    Key("w", "wires", {}, "connections colored by strain, or the surface"),
    Key("c", "color", {}, "colors: texture, speed, strain"),
    Key("p", "pin", {}, "pin the particles held, or held last"),
    Key(FLAGS, "flags", {}, "print the camera's flags for run, render and view"),
    Key("h", "help", {}, "this list"),
)
"""All keys; a key with another command under shift is listed without shift, then with shift."""
SCENES = "123456789"
"""The keys of scenes."""
ARROWS = {"right": "→", "up": "↑", "down": "↓"}
"""Arrow symbols of the arrow keys."""


def listed(scenes: list[str]) -> str:
    """Return the list of keys as text, one line per key."""
    lines = [f"{k}  {name}" for k, name in zip(SCENES, scenes, strict=False)]
    for key in KEYS:
        if key.shift:
            lines[-1] += f" (shift: {key.text})"
        else:
            lines.append(f"{ARROWS.get(key.name, key.name)}  {key.text}")
    return "\n".join([*lines, "drag  pull the body by its surface"])
