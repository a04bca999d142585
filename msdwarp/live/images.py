"""Images, drawn for each client of a page, for links that are too slow for triangles."""

import asyncio
import time
from concurrent.futures import Future
from typing import Any

import numpy as np

from ..pictures import Camera, Drawing, RayCaster, Stage

QUALITY = 80
"""Quality of JPEG images, out of 100."""
ROWS, LEAST_ROWS = 1080, 144
"""Largest and smallest number of rows of an image."""
STEPS = (144, 216, 288, 432, 576, 720, 900)
"""Smaller numbers of rows, if ROWS take too long; only a few, so that the size seldom changes."""
IN_MOTION = 1 / 15
"""Longest time to draw an image while the scene moves [s]; if it is exceeded, rows are reduced."""
AT_REST, PATIENCE = 1.5, 0.3
"""Longest time to draw an image of a scene at rest [s]; time without motion until a scene is at rest [s]."""
BUSY = 1 / 3
"""Largest fraction of time for drawing on the CPU, which the simulation also needs."""


class Link:
    """The link to a client, which measures how long messages take to arrive.

    viser does not measure this. A client answers a ping of the websocket after reading all messages before it.
    """

    def __init__(self, server: Any, client: Any) -> None:
        self._server, self._client = server, client
        self._answer: Future[float] | None = None
        self.late = 0  # successive late messages

    @property
    def busy(self) -> bool:
        """Whether messages sent before the last `ask` are still in transit."""
        return self._answer is not None and not self._answer.done()

    @property
    def delay(self) -> float:
        """Time until the last answer [s]; 0 if there is none, or the client is gone."""
        if self._answer is None or self._answer.cancelled() or self._answer.exception() is not None:
            return 0.0
        return self._answer.result()

    def ask(self) -> None:
        """Request an answer that comes after all messages sent so far have arrived."""
        self._answer = asyncio.run_coroutine_threadsafe(self._arrival(), self._server.get_event_loop())

    async def _arrival(self) -> float:
        """Send the client's waiting messages, then a ping; return the time until the answer [s]."""
        began = time.perf_counter()
        waiting = self._client._websock_connection.get_message_buffer()
        while waiting.message_from_id and not waiting.done:
            await asyncio.sleep(0.002)
        connection = self._server._websock_server._live_connections.get(self._client.client_id)
        if connection is not None:
            await (await connection.ping())
        return time.perf_counter() - began


class Images:
    """Draws images for each client of a page, with the client's camera; one image per client is in transit."""

    def __init__(self, drawing: Drawing, stage: Stage) -> None:
        self._caster, self._field_of_view = RayCaster(drawing, stage), stage.camera.field_of_view
        self._on_cpu = drawing.device == "cpu"
        self._frame, self._moved, self._fits = 0, 0.0, False
        self.shift = np.zeros(3)  # displacement of cameras that follow the body [m]
        self._sent: dict[int, tuple[int, tuple[float, ...], int, float]] = {}
        """Frame, camera, rows and start of rest of each client's last image; ordered by time of sending."""
        self._seconds_a_row = 0.0
        self._free_at = 0.0

    def follow(self) -> None:
        """Record a change of the drawing, which the next images must show."""
        self._frame, self._moved, self._fits = self._frame + 1, time.perf_counter(), False

    def send(self, links: list[tuple[int, Any, Link]]) -> None:
        """Draw for clients that have received their last image and need another; longest wait first."""
        present = {k for k, _, _ in links}
        self._sent = {k: sent for k, sent in self._sent.items() if k in present}
        turn = {k: place for place, k in enumerate(self._sent)}
        for k, client, link in sorted(links, key=lambda one: turn.get(one[0], -1)):
            if not link.busy and time.perf_counter() >= self._free_at and self._send_to(k, client):
                link.ask()

    def _send_to(self, k: int, client: Any) -> bool:
        """Draw for a client if the image has changed; return whether it has."""
        camera, now = client.camera, time.perf_counter()
        pose = (*camera.position, *camera.wxyz, camera.image_width, camera.image_height)
        if not np.isfinite(pose).all() or min(pose[-2:]) < 1:
            return False
        frame, before, rows, since = self._sent.get(k, (-1, (), 0, 0.0))
        moves = (frame, before) != (self._frame, pose)
        rests = max(since, self._moved) + PATIENCE < now
        wanted = self._rows(pose[-1], IN_MOTION if moves else AT_REST)
        if not moves and not (rests and wanted > rows):
            return False
        if not self._fits:
            self._caster.refit()
            self._fits = True
        seen_from = _camera(camera, self._field_of_view).shifted(self.shift)
        self._caster.look_from(seen_from, (max(16, round(wanted * pose[-2] / pose[-1])), wanted))
        # On a CPU shadows take most of the time, so moving scenes have none.
        image = self._caster.shoot(shadows=not (self._on_cpu and moves))
        client.scene.set_background_image(image, format="jpeg", jpeg_quality=QUALITY)
        client.flush()
        self._sent.pop(k, None)  # reinserted last below
        self._sent[k] = self._frame, pose, wanted, now if moves else since
        took = time.perf_counter() - now
        if moves:  # the time is proportional to the number of pixels
            self._seconds_a_row = took / wanted**2
        if self._on_cpu:
            self._free_at = time.perf_counter() + took * (1 / BUSY - 1)
        return True

    def _rows(self, most: float, seconds: float) -> int:
        """Return the number of rows that can be drawn in a time [s], at most `most`."""
        rows = (seconds / self._seconds_a_row) ** 0.5 if self._seconds_a_row else 2 * LEAST_ROWS
        fast = ROWS if rows >= ROWS else max((n for n in STEPS if n <= rows), default=LEAST_ROWS)
        return min(int(most), fast)


def _camera(of_client: Any, field_of_view: float) -> Camera:
    """Return a client's camera, with a field of view [degrees]."""
    from viser.transforms import SO3

    right, down, forward = SO3(of_client.wxyz / np.linalg.norm(of_client.wxyz)).as_matrix().T
    return Camera(of_client.position, of_client.look_at, forward, right, -down, field_of_view)
