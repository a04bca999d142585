"""The live view: pictures a second, how soon a picture shows what was asked for, what it costs the simulation.

    python -m benchmarks.speed.view [--device D] [--quick] [--plot-only]

A sheet of so many triangles waves by a formula, so that nothing is simulated and all time is the view's. The page
is read by a client on the same machine that takes all that is sent and draws nothing: a browser's own drawing
comes on top, and on a machine of few cores the client takes some. "Pictures a second" counts whole frames that
arrived while the view went as fast as it could; "delay" is the median time from a command, in a view that is
paused, to the arrival of the picture that shows it. The window, where one can be opened (on Linux with DISPLAY
set, as by xvfb-run), is drawn by the OpenGL that is there.

What does a view cost the simulation? A cube is simulated as fast as it goes, without a view, with a page that
nobody has opened, and with a client: frames simulated a second, in turn, medians of all rounds.
"""

import os
import threading
import time
from pathlib import Path
from statistics import median
from types import MappingProxyType
from typing import Any

import numpy as np

from msdwarp import Frame, Plane, Scene, Simulation, box, sheet
from msdwarp.live import Browser, Running, Screen, View, Window, within_reach

from ..common import arguments, machine, read_csv, table, write_csv

TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)
EDGE = {"cpu": 20, "cuda": 46}
"""Particles along an edge of the cube that is simulated."""
DELAYS = 15
"""Commands whose delay is measured."""


class Waves:
    """A sheet that waves by a formula, as a source of a view."""

    title, fps, device = "waves", 1e6, "cpu"
    handling = rebuild = frame_count = None
    parameters = MappingProxyType[str, Any]({})

    def __init__(self, triangles: int) -> None:
        n = round((triangles / 2) ** 0.5) + 1
        self.scene = Scene(system=sheet((n, n), 1.0 / n, mass=1.0, stiffness=1.0, damping=0.0))
        self._flat, self.index = np.array(self.scene.system.position, dtype=np.float32), 0

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.index / 60

    def advance(self) -> bool:
        """Go on by a frame."""
        self.index += 1
        return True

    def seek(self, k: int) -> None:
        """Go to frame k."""
        self.index = k

    def reset(self) -> None:
        """Go back to the start."""
        self.index = 0

    def frame(self) -> Frame:
        """Return the present frame."""
        x = self._flat.copy()
        x[:, 1] += 0.1 * np.sin(9 * x[:, 0] + 0.1 * self.index)
        return Frame(self.time, x, np.zeros_like(x))

    def broken_at(self) -> None:
        """Return nothing: none can break."""
        return None

    def reading(self) -> None:
        """Return nothing: it has no energies."""
        return None

    def seen(self) -> np.ndarray:
        """Return what a camera has in view: it stays where it is."""
        return self._flat

    def summary(self) -> str:
        """Return how it moves."""
        return "by a formula"


class Client(threading.Thread):
    """Takes all that a page is sent, and counts what is large enough to be a picture."""

    def __init__(self, page: Browser, least: int) -> None:
        import msgspec
        import viser
        from viser._messages import ViewerCameraMessage
        from websockets.sync.client import connect

        super().__init__(daemon=True)
        self._least, self.pictures, self.bytes, self.arrived = least, 0, 0, threading.Event()
        name = f"viser-v{viser.__version__}"
        address = page.address.replace("http", "ws")
        self._socket = connect(address, subprotocols=[name], origin=page.address, max_size=None)
        zero, one = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        camera = ViewerCameraMessage(one, (3.0, 0.0, 1.0), 0.8, 0.01, 1e3, 720, 1280, zero, (0.0, 0.0, 1.0))
        self._socket.send(msgspec.msgpack.encode(camera.as_serializable_dict()))
        self.start()

    def run(self) -> None:
        """Take all that comes."""
        try:
            for message in self._socket:
                self.bytes += len(message)
                if len(message) >= self._least:
                    self.pictures += 1
                    self.arrived.set()
        except Exception as error:  # the page is gone
            self.ended = error

    def close(self) -> None:
        """End."""
        self._socket.close()


def of_page(triangles: int, seconds: float) -> dict[str, Any]:
    """Measure the page."""
    page = Browser()
    view = View(Waves(triangles), [page])
    view.start()
    client = Client(page, 6 * triangles)  # 12 bytes a vertex, and half as many as triangles; compressed a little
    _wait(lambda: client.pictures > 3)
    pictures, sent, start = client.pictures, client.bytes, time.perf_counter()
    time.sleep(seconds)
    elapsed = time.perf_counter() - start
    rate, size = (client.pictures - pictures) / elapsed, (client.bytes - sent) / elapsed
    view.post("pause", value=True)
    time.sleep(0.5)
    delays = []
    for k in range(DELAYS):
        time.sleep(0.2)
        client.arrived.clear()
        start = time.perf_counter()
        view.post("seek", k=1000 + k)
        if client.arrived.wait(10):
            delays.append(time.perf_counter() - start)
    client.close()
    view.close()
    return {"pictures_per_s": rate, "delay_ms": 1e3 * median(delays), "mb_per_s": size / 1e6}


class Counted:
    """A window that counts what it shows, and ends after some seconds."""

    def __init__(self, window: Any, seconds: float) -> None:
        self._window, self._seconds, self.times = window, seconds, list[float]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._window, name)

    def show(self) -> None:
        """Show a picture, and note when."""
        self._window.show()
        self.times.append(time.perf_counter())

    def poll(self) -> bool:
        """Tell whether it is still open."""
        return self._window.poll() and not (self.times and time.perf_counter() - self.times[0] > self._seconds)


def of_window(triangles: int, seconds: float) -> dict[str, Any]:
    """Measure the window."""
    screen = Counted(Window(), seconds)
    as_screen: Screen = screen  # type: ignore[assignment]
    View(Waves(triangles), [as_screen]).run()
    spacing = median(np.diff(screen.times)) if len(screen.times) > 1 else float("nan")
    return {"pictures_per_s": 1 / spacing, "delay_ms": 1e3 * spacing, "mb_per_s": float("nan")}


def of_simulation(device: str, seconds: float, rounds: int) -> dict[str, float]:
    """Return how many frames are simulated a second, by who looks on."""
    n = EDGE["cpu" if device == "cpu" else "cuda"]
    body = box((n, n, n), 1.0 / n, mass=0.01, stiffness=1000.0, damping=0.5).translate((0, 0, 1.0))
    scene = within_reach(Scene(system=body, colliders=[Plane(restitution=1.0)]))
    found: dict[str, list[float]] = {"no view": [], "a page that nobody opened": [], "a client": []}
    for _ in range(rounds):
        for way, rates in found.items():
            simulation = Simulation.from_scene(scene, device=device)
            simulation.step(20)
            if way == "no view":
                start = simulation.frame_index
                end = time.perf_counter() + seconds
                while time.perf_counter() < end:
                    simulation.step()
                rates.append((simulation.frame_index - start) / seconds)
                continue
            page = Browser()
            source = Running(scene, simulation)
            source.fps = 1e6  # as fast as it goes
            view = View(source, [page])
            view.start()
            view.post("pause", value=False)  # it would wait for somebody who looks
            client = Client(page, 1000) if way == "a client" else None
            time.sleep(2.0)
            start, began = simulation.frame_index, time.perf_counter()
            time.sleep(seconds)
            rates.append((simulation.frame_index - start) / (time.perf_counter() - began))
            if client is not None:
                client.close()
            view.close()
    return {way: median(rates) for way, rates in found.items()}


def _wait(holds: Any, seconds: float = 120.0) -> None:
    end = time.perf_counter() + seconds
    while not holds():
        if time.perf_counter() > end:
            raise TimeoutError("no picture came")
        time.sleep(0.02)


def main() -> None:
    """Measure all, write and print it."""
    options = arguments(__doc__.split("\n")[0])
    path: Path = options.folder / "view.csv"
    if not options.plot_only:
        seconds, sizes = (1.0, TRIANGLES[:2]) if options.quick else (5.0, TRIANGLES)
        ways = {"page": of_page} | ({"window": of_window} if os.environ.get("DISPLAY") else {})
        rows: list[dict[str, Any]] = []
        for triangles in sizes:
            for screen, measured in ways.items():
                rows.append({"what": screen, "triangles": triangles, **measured(triangles, seconds)})
        for way, rate in of_simulation(options.device, seconds, 1 if options.quick else 3).items():
            rows.append({"what": f"frames simulated, {way}", "triangles": "", "pictures_per_s": rate})
        columns = ["what", "triangles", "pictures_per_s", "delay_ms", "mb_per_s"]
        shown = [{name: row.get(name, "") for name in columns} for row in rows]
        write_csv(path, shown, machine(options.device))
    line, kept = read_csv(path)
    columns = ["what", "triangles", "pictures_per_s", "delay_ms", "mb_per_s"]
    table(f"the live view, {line}", columns, [[row[name] for name in columns] for row in kept])


if __name__ == "__main__":
    main()
