"""Messages that may come from a page. viser trusts its pages: it sets any attribute that they name."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

MOST_BYTES = 1 << 16
"""Longest accepted message [bytes]; the longest that a page sends is that of a text field."""
LONGEST, LARGEST, WIDEST = 1000, 1e30, 1 << 14
"""Longest text, largest number, and maximal number of pixels along an edge of a camera's picture."""
Rule = Callable[[Any], bool]


def _number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= LARGEST  # False for NaN


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST


def _numbers(count: int) -> Rule:
    return lambda value: isinstance(value, list | tuple) and len(value) == count and all(map(_number, value))


def _one_of(*allowed: str) -> Rule:
    return lambda value: isinstance(value, str) and value in allowed


def _pixels(value: Any) -> bool:
    return _number(value) and 1 <= value <= WIDEST


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, bool) or _number(value) or _text(value)


def _entered(value: Any) -> bool:
    """Return whether a widget of the panel can have this value: a vector has three numbers."""
    return (value is not None and _plain(value)) or _numbers(3)(value)


RULES: dict[str, dict[str, Rule]] = {
    "ViewerCameraMessage": {
        "wxyz": lambda value: _numbers(4)(value) and math.hypot(*value) > 1e-6,
        "position": _numbers(3),
        "fov": lambda value: _number(value) and 0 < value < math.pi,
        "near": _number,
        "far": _number,
        "image_height": _pixels,
        "image_width": _pixels,
        "look_at": _numbers(3),
        "up_direction": _numbers(3),
    },
    "SceneNodeDragMessage": {
        "phase": _one_of("start", "update", "end"),
        "name": _text,
        "instance_index": lambda value: value is None or type(value) is int,
        "start_position": _numbers(3),
        "start_screen_pos": _numbers(2),
        "end_position": _numbers(3),
        "end_screen_pos": _numbers(2),
        "button": _one_of("left", "middle", "right"),
        "modifier": lambda value: value is None or _text(value),
    },
    "GuiUpdateMessage": {
        "uuid": _text,
        "updates": lambda value: isinstance(value, dict) and [*value] == ["value"] and _entered(value["value"]),
    },
    "CommandTriggerMessage": {"uuid": _text},
}
"""The messages that a page needs, with a check of each field; all others are dropped."""


class Filter:
    """Recognizes messages that a page may send.

    `declared` are viser's message classes, by name; ValueError is raised if they lack a message or a field of the
    rules. Their other fields may be numbers or short texts.
    """

    def __init__(self, declared: Mapping[str, Any]) -> None:
        self._allowed: dict[str, dict[str, Rule]] = {}
        for name, rules in RULES.items():
            kind = declared.get(name)
            fields = [one.name for one in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else []
            if missing := [field for field in rules if field not in fields]:
                raise ValueError(f"{name} has no field {missing[0]}")
            self._allowed[name] = dict.fromkeys((*fields, "type"), _plain) | rules

    def passes(self, raw: Any) -> bool:
        """Return whether a page may send this."""
        import msgspec

        if not isinstance(raw, bytes) or len(raw) > MOST_BYTES:
            return False
        try:
            message = msgspec.msgpack.decode(raw)
        except (msgspec.DecodeError, RecursionError, ValueError, TypeError):
            return False
        if not isinstance(message, dict) or not isinstance(kind := message.get("type"), str) or kind not in RULES:
            return False
        allowed = self._allowed[kind]
        if not RULES[kind].keys() <= message.keys() <= allowed.keys():
            return False
        return all(allowed[name](value) for name, value in message.items())
