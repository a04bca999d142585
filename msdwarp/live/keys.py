"""Keys: those of the 2014 program, and what they do."""

from typing import Any, NamedTuple


class Key(NamedTuple):
    """What a key does."""

    command: str
    """What is asked of the view: the name of one of its commands."""
    values: dict[str, Any]
    """With which values."""
    says: str
    """What it does, for the list of keys."""
    shift: bool = False
    """Whether shift is held too."""


STEP = 1.25
"""By how much a press of a key multiplies."""


def _scaled(name: str, said: str) -> list[Key]:
    up = Key("scale", {"name": name, "by": STEP}, f"more {said}")
    return [up, Key("scale", {"name": name, "by": 1 / STEP}, f"less {said}", shift=True)]


KEYS: dict[str, list[Key]] = {
    "space": [Key("pause", {}, "pause or continue")],
    "right": [Key("step", {}, "one frame")],
    "up": [Key("pace", {"by": 2.0}, "play faster")],
    "down": [Key("pace", {"by": 0.5}, "play slower")],
    "m": _scaled("mass", "mass"),
    "s": _scaled("stiffness", "stiffness"),
    "l": _scaled("rest_length", "rest length"),
    "d": _scaled("damping", "damping"),
    "f": [Key("freeze", {}, "freeze: rest lengths become the current lengths")],
    "r": [Key("reset", {}, "restart")],
    "w": [Key("wires", {}, "connections coloured by strain, or the surface")],
    "c": [Key("colour", {}, "colours: texture, speed, strain")],
    "p": [Key("pin", {}, "pin the particles held, or held last")],
    "h": [Key("help", {}, "this list")],
}
"""Keys by name, each with what it does, and with shift."""
SCENES = "123456789"
"""The keys of scenes."""
NAMES = {"space": "space", "right": "→", "up": "↑", "down": "↓"}


def listed(scenes: list[str]) -> str:
    """Return the list of keys as text, a line for each."""
    lines = [f"{k}  {name}" for k, name in zip(SCENES, scenes, strict=False)]
    for name, several in KEYS.items():
        said = [one.says for one in several]
        extra = f" (shift: {said[1]})" if len(said) > 1 else ""
        lines.append(f"{NAMES.get(name, name)}  {said[0]}{extra}")
    return "\n".join([*lines, "drag  pull the body by its surface"])
