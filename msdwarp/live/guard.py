"""Guard: checks of requests and messages, and thread safety, which viser's server lacks."""

import asyncio
import inspect
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from websockets.asyncio import server

from .access import Access
from .messages import MOST_BYTES, Filter

MOST_CLIENTS = 64
"""Maximal number of open web sockets."""
_STARTING = threading.Lock()


@contextmanager
def guarded(access: Access, busy: Callable[[], bool]) -> Iterator[None]:
    """Make a server that viser starts in this context refuse everything that `Access` and `Filter` do not allow.

    viser has no setting for this. It uses the package websockets, whose `serve` is given further settings here: a
    check of each request, the class of connections, and the longest message. While `busy()`, messages wait at
    their senders. ValueError is raised if viser starts a server in another way.
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
        """A connection that passes on only allowed messages."""

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
        if not handler.__module__.startswith("viser"):  # called by another thread, not by viser
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
    """Let any thread send messages through a viser server, also to a client that is just leaving.

    viser 1.1.1 sets its buffers' `message_event` in the thread that adds a message, although asyncio's events are
    only for the loop's thread: sometimes that fails, or wakes no task. It also warns about a client that is gone.
    """
    inner, loop = page._websock_server, page.get_event_loop()

    def mend(buffer: Any) -> None:
        set_in_loop = buffer.message_event.set

        def set_from_any_thread() -> None:
            with suppress(RuntimeError):  # the loop is closed: no task waits any more
                loop.call_soon_threadsafe(set_in_loop)

        buffer.message_event.set = set_from_any_thread
        buffer._warned_push_after_done = True

    inner.on_client_connect(lambda client: mend(client.get_message_buffer()))
    mend(inner.get_message_buffer())
    for client in list(inner._client_state_from_id.values()):
        mend(client.message_buffer)
