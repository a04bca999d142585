"""A view with a page, in a process of its own, that tells how it is: what `page.py` attacks."""

import json
import secrets
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from msdwarp import Simulation
from msdwarp.cli.commands.view import SHELF, view_of
from msdwarp.cli.options import ViewOptions
from msdwarp.cli.scene_files import find_scene
from msdwarp.live import Browser, View, guard

PATIENCE = 300.0
"""How long the view may take to do what waits for it [s]."""
SIZE, FRAMES = 5, 10
"""Particles along an edge of the cube; frames, after which it is compared with one that nobody attacked."""


def main() -> None:
    """Serve a cube on this machine; answer each line of standard input with a line of JSON."""
    heard: Counter[str] = Counter()
    passes = guard.Filter.passes

    def counted(self: guard.Filter, raw: Any) -> bool:
        passed = passes(self, raw)
        heard["heard"] += 1
        heard["passed"] += passed
        return passed

    guard.Filter.passes = counted
    origin = find_scene("cube")._replace(parameters={"size": SIZE})
    view = view_of(origin, origin.scene(), ViewOptions(browser=True, device="cpu"))
    (page,) = view.screens
    assert isinstance(page, Browser)
    if "token" in sys.argv[1:]:  # as where a network can open it, but served to this machine alone
        page._access.token = secrets.token_urlsafe(32)
    view.start()
    view.post("pause", value=False)  # it would wait for somebody who looks
    _wait(lambda: view.source.time > 0)
    _say({"port": page.port, "address": page.address})
    for line in sys.stdin:
        if line.strip() == "widgets":
            _say(_widgets(page))
        else:
            _say(_state(view, page) | dict(heard))
            heard.clear()
    view.close()


def _widgets(page: Browser) -> dict[str, str]:
    """Return what a client may name of the page: labels and uuids of widgets and commands, and a mesh."""
    gui = page._server.gui
    found = {one.label: one._impl.uuid for one in list(gui._gui_input_handle_from_uuid.values())}
    return found | {f"command {one.label}": uuid for uuid, one in list(gui._command_handle_from_uuid.items())}


def _state(view: View, page: Browser) -> dict[str, Any]:
    """Return whether the view runs, and simulates to the last bit what one does that nobody attacked."""
    assert view._thread is not None
    began = time.monotonic()
    # What is read already of a connection that has ended is still heard.
    if not _wait(lambda: not page._server._websock_server._live_connections and view.waiting == 0):
        return {"running": False, "right": False}
    view.post("pause", value=True)
    view.post("let_go")
    view.post("reset")
    _wait(lambda: view.waiting == 0)
    for _ in range(FRAMES):
        view.post("step")
    came = _wait(lambda: view.source.index == FRAMES and view.waiting == 0)
    right = False
    if came:
        fresh = Simulation.from_scene(view.source.scene, device="cpu", fps=view.source.fps)
        fresh.step(FRAMES)
        right = np.array_equal(view.source.frame().position, fresh.frame().position)
    before = view.source
    view.post("scene", number=1 + SHELF.index("cube"))  # another one may be shown
    view.post("parameters", size=SIZE)
    _wait(lambda: view.source is not before and view.source.parameters.get("size") == SIZE)
    view.post("pause", value=False)
    running = came and _wait(lambda: view.source.index > 0) and view._thread.is_alive()
    return {"running": running, "right": right, "took": time.monotonic() - began}


def _wait(holds: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def _say(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)
