"""Waking: what other threads hand to viser's page reaches the thread that sends it."""

import asyncio
import contextlib
from asyncio import AbstractEventLoop
from typing import Any


class Woken(asyncio.Event):
    """An event that any thread may set: what waits for it is woken in the thread of its loop.

    asyncio's own event is for that thread alone. Set from another, it may fail, as what waits comes and goes
    meanwhile, or may miss what begins to wait at that moment, which then waits for ever.
    """

    def __init__(self, loop: AbstractEventLoop) -> None:
        super().__init__()
        self._its = loop

    def set(self) -> None:
        """Set it as soon as its loop comes to that."""
        with contextlib.suppress(RuntimeError):  # the loop is closed: nothing waits any more
            self._its.call_soon_threadsafe(super().set)


def wake_from_any_thread(server: Any) -> None:
    """Let any thread add to what a server of viser's sends.

    Its buffers of messages have a `message_event`, which is set in the thread that adds a message (viser 1.1.1).
    From here on it is one that any thread may set.
    """
    inner, loop = server._websock_server, server.get_event_loop()

    def mend(buffer: Any) -> None:
        before, buffer.message_event = buffer.message_event, Woken(loop)
        before.set()  # what waits for it already looks for messages, and then waits for the new one

    async def mend_all() -> None:
        there = [client.message_buffer for client in inner._client_state_from_id.values()]
        for buffer in (inner.get_message_buffer(), *there):
            mend(buffer)
        inner.on_client_connect(lambda client: mend(client.get_message_buffer()))

    asyncio.run_coroutine_threadsafe(mend_all(), loop).result()
