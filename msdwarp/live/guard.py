"""Guard: checks of requests and messages, and thread safety, which viser's server does not have."""

import asyncio
import dataclasses
import inspect
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from websockets.asyncio import server

from .access import Access

MOST_CLIENTS = 64
"""Maximal number of open web sockets."""
_STARTING = threading.Lock()


@contextmanager
def guarded(access: Access, busy: Callable[[], bool]) -> Iterator[None]:
    """Make a server that viser starts in this context refuse all that `Access` and `Filter` do not allow.

    viser has no setting for this. It uses `serve` of the package websockets, which is given further settings here:
    a check of each request, the class of connections, the longest message. While `busy()` is true, clients must
    wait before they send messages. ValueError is raised if viser starts a server in another way.
    """
    import viser
    from viser import _messages

    unable = f"viser {viser.__version__} works in a way that msdwarp cannot guard"
    advice = "choose another version: pip install 'viser==1.1.*'"
    try:
        messages = Filter(vars(_messages))
    except ValueError as error:
        raise ValueError(f"{unable} ({error}); {advice}") from error

    class Connection(server.ServerConnection):
        """A connection that only passes on allowed messages."""

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                data = await super().recv(decode)
                await asyncio.sleep(0)  # so that the previous message is handled
                while busy():
                    await asyncio.sleep(0.01)
                if messages.passes(data):
                    return data

        def recv_streaming(self, decode: bool | None = None) -> Any:
            raise NotImplementedError(unable)

    before, started = server.serve, list[bool]()

    def serve(handler: Any, *words: Any, **options: Any) -> Any:
        if not handler.__module__.startswith("viser"):  # called by another thread than viser's
            return before(handler, *words, **options)
        inner = options.get("process_request")

        async def process_request(connection: Any, request: Any) -> Any:
            why = access.refusal(request.path, request.headers)
            if why is not None:
                return connection.respond(403, why + "\n")
            if len(connection.server.connections) >= MOST_CLIENTS:
                return connection.respond(503, "too many pages are open\n")
            response = inner(connection, request) if inner is not None else None
            if inspect.isawaitable(response):
                response = await response
            if response is not None:
                for name, value in access.response_headers.items():
                    response.headers[name] = value
            return response

        started.append(True)
        own = {"process_request": process_request, "create_connection": Connection, "max_size": MOST_BYTES}
        return before(handler, *words, **(options | own))

    with _STARTING:
        server.serve = serve  # type: ignore[assignment]
        try:
            yield
        finally:
            server.serve = before  # type: ignore[misc]
    if not started:
        raise ValueError(f"{unable}; {advice}")


def allow_any_thread(page: Any) -> None:
    """Let any thread send messages through a viser server, also to a client that is leaving.

    viser 1.1.1 sets `message_event` of its buffers in the thread that adds a message, although asyncio allows that
    only in the loop's thread: sometimes this fails, or wakes no task. It also warns about clients that have left.
    """
    inner, loop = page._websock_server, page.get_event_loop()

    def mend(buffer: Any) -> None:
        set_in_loop = buffer.message_event.set

        def set_from_any_thread() -> None:
            with suppress(RuntimeError):  # the loop is closed, so no task waits
                loop.call_soon_threadsafe(set_in_loop)

        buffer.message_event.set = set_from_any_thread
        buffer._warned_push_after_done = True

    inner.on_client_connect(lambda client: mend(client.get_message_buffer()))
    mend(inner.get_message_buffer())
    for client in list(inner._client_state_from_id.values()):
        mend(client.message_buffer)


# Messages that may come from a page. viser trusts its pages and sets any attribute that a message names.

MOST_BYTES = 1 << 16
"""Longest accepted message [bytes]; the longest that a page sends is the content of a text field."""
LONGEST, LARGEST, WIDEST = 1000, 1e30, 1 << 14
"""Longest text, largest number, and maximal number of pixels along an edge of a client's picture."""
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
    """Return whether a widget of the panel can have this value; a vector must have three numbers."""
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
"""The messages that a page needs, with a check for each field; other messages are dropped."""


class Filter:
    """Recognizes messages that a page may send.

    `declared` are viser's message classes by name; ValueError is raised if a message or field of the rules is
    missing there. Fields without a rule may be numbers or short texts.
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
        """Return whether a page may send this message."""
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
