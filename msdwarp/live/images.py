"""Images: what a page is shown where triangles are too many for its link, drawn here for each client."""

import asyncio
import time
from concurrent.futures import Future
from typing import Any

import numpy as np

from ..pictures import Camera, Drawing, RayCaster, Stage

QUALITY = 80
"""Of the JPEG images, of 100."""
ROWS, LEAST_ROWS = 1080, 144
"""The most and the fewest rows of an image."""
IN_MOTION = 1 / 15
"""How long an image may take to draw while something moves [s]: it gets coarser before it takes longer."""
AT_REST, PATIENCE = 1.5, 0.3
"""The same where nothing moves, for what has not moved for so long [s]."""
SHARE = 1 / 3
"""The largest share of the time that is drawn for, where the simulation's device draws: the CPU."""


class Link:
    """How soon what a client is sent arrives there.

    viser tells nothing of that. A ping of the websocket goes behind what was sent before it, and is answered once
    all that was read.
    """

    def __init__(self, server: Any, client: Any) -> None:
        self._server, self._client = server, client
        self._asked: Future[float] | None = None
        self.late = 0
        """How often in a row what was sent came late."""

    @property
    def busy(self) -> bool:
        """Whether what was sent before `ask` was called last has not arrived yet."""
        return self._asked is not None and not self._asked.done()

    @property
    def delay(self) -> float:
        """How long the last of what was asked for took [s]; so far, if it has not arrived."""
        if self._asked is None:
            return 0.0
        if not self._asked.done():
            return time.perf_counter() - self._began
        failed = self._asked.cancelled() or self._asked.exception() is not None  # a client that is gone
        return 0.0 if failed else self._asked.result()

    def ask(self) -> None:
        """Ask for an answer once all that was sent until now has arrived."""
        self._began = time.perf_counter()
        self._asked = asyncio.run_coroutine_threadsafe(self._arrival(), self._server.get_event_loop())

    async def _arrival(self) -> float:
        """Return how long it took until what waits for the client alone was sent, and a ping was answered [s]."""
        began = time.perf_counter()
        waiting = self._client._websock_connection.get_message_buffer()
        while waiting.message_from_id and not waiting.done:
            await asyncio.sleep(0.002)
        connection = self._server._websock_server._live_connections.get(self._client.client_id)
        if connection is not None:
            await (await connection.ping())
        return time.perf_counter() - began


class Links:
    """The links to all clients of a page, by their number."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._links: dict[int, Link] = {}

    def now(self) -> list[tuple[int, Any, Link]]:
        """Return number, client and link of all who are there."""
        clients = self._server.get_clients()
        self._links = {k: self._links.get(k) or Link(self._server, one) for k, one in clients.items()}
        return [(k, one, self._links[k]) for k, one in clients.items()]


class Images:
    """Draws for each client of a page, with its camera; only one image is on the way to each at a time.

    Parameters
    ----------
    drawing
        What is drawn: the images are cast on its device.
    stage
        The lights and the ground.
    """

    def __init__(self, drawing: Drawing, stage: Stage) -> None:
        self._caster = RayCaster(drawing, stage)
        self._on_cpu = drawing.device == "cpu"
        self._frame, self._moved, self._fits = 0, 0.0, True
        self._sent: dict[int, tuple[Any, ...]] = {}
        self._seconds_a_row = 0.0
        self._free_at = 0.0

    def follow(self) -> None:
        """Have the next images show the drawing as it is now."""
        self._frame, self._moved, self._fits = self._frame + 1, time.perf_counter(), False

    def send(self, links: list[tuple[int, Any, Link]]) -> None:
        """Draw for each client that has its last image, and would see another one now.

        Who was drawn for longest ago comes first: there may be time for one only.
        """
        turn = {k: place for place, k in enumerate(self._sent)}
        for k, client, link in sorted(links, key=lambda one: turn.get(one[0], -1)):
            if link.busy or time.perf_counter() < self._free_at:
                continue
            self._send(k, client, link)
        there = {k for k, _, _ in links}
        self._sent = {k: what for k, what in self._sent.items() if k in there}

    def _send(self, k: int, client: Any, link: Link) -> None:
        camera, now = client.camera, time.perf_counter()
        pose = (*camera.position, *camera.wxyz, camera.image_width, camera.image_height)
        if not np.isfinite(pose).all() or min(pose[-2:]) < 1:
            return
        frame, seen, rows, since = self._sent.get(k, (-1, None, 0, 0.0))
        moves = (frame, seen) != (self._frame, pose)
        rest = max(since, self._moved) + PATIENCE < now
        wanted = self._rows(pose[-1], IN_MOTION if moves else AT_REST)
        if not moves and not (rest and wanted > rows):
            return
        self._refit()
        size = max(16, round(wanted * pose[-2] / pose[-1])), wanted
        self._caster.look_from(_camera(camera), size)
        # On a CPU shadows take most of the time: what moves goes without.
        image = self._caster.shoot(shadows=not (self._on_cpu and moves))
        client.scene.set_background_image(image, format="jpeg", jpeg_quality=QUALITY)
        client.flush()
        link.ask()
        self._sent.pop(k, None)  # to have it last
        self._sent[k] = self._frame, pose, wanted, now if moves else since
        took = time.perf_counter() - now
        if moves:  # the time goes with the pixels
            self._seconds_a_row = took / wanted**2
        if self._on_cpu:
            self._free_at = time.perf_counter() + took * (1 / SHARE - 1)

    def _rows(self, most: float, seconds: float) -> int:
        """Return how many rows an image can have that is drawn so fast."""
        rows = (seconds / self._seconds_a_row) ** 0.5 if self._seconds_a_row else 2 * LEAST_ROWS
        # In steps, so that it does not change with every image.
        steps = [n for n in (144, 216, 288, 432, 576, 720, 900) if n <= rows]
        return min(int(most), max([LEAST_ROWS, *steps]), ROWS) if rows < ROWS else min(int(most), ROWS)

    def _refit(self) -> None:
        if not self._fits or not self._sent:
            self._caster.refit()
            self._fits = True


def _camera(of_client: Any) -> Camera:
    """Return where a client looks from, with the opening that all pictures have."""
    w, x, y, z = of_client.wxyz / np.linalg.norm(of_client.wxyz)
    forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    down = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    return Camera(of_client.position, of_client.look_at, forward, np.cross(down, forward), -down)
