"""The page of a view: a browser that opens it, clients that misbehave, and what is left behind."""

import gc
import io
import os
import socket
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from msdwarp.live import Browser, panel

viser = pytest.importorskip("viser")
import msgspec  # noqa: E402
import zstandard  # noqa: E402
from pages import SETTLES, client, runs, served, until  # noqa: E402


@pytest.mark.slow
def test_it_listens_to_this_machine_alone(view):
    page = view.screens[0]
    assert page.address.startswith("http://127.0.0.1:")
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:] if Path("/proc/net/tcp").exists() else []
    listening = [line.split()[1] for line in lines if line.split()[3] == "0A"]
    mine = [one for one in listening if int(one.split(":")[1], 16) == page.port]
    assert all(one.startswith("0100007F") for one in mine)
    assert page._server.request_share_url() is None  # viser could make it public


def test_a_port_that_is_taken_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(ValueError, match=f"port is {taken.getsockname()[1]}"):
            Browser(port=taken.getsockname()[1])
    with pytest.raises(ValueError, match="port is 70000"):
        Browser(port=70000)
    pages = [Browser(), Browser()]  # without one, each finds one that is free
    assert pages[0].port != pages[1].port
    for page in pages:
        page.close()


def pictures(socket_, count):
    """Return that many of the images that a client is sent."""
    found = []
    end = time.monotonic() + SETTLES
    while len(found) < count and time.monotonic() < end:
        data = socket_.recv(timeout=SETTLES)
        size = int.from_bytes(data[8:16], "little")
        content = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
        messages = msgspec.msgpack.decode(content)["messages"]
        images = [one["rgb_data"] for one in messages if one["type"] == "BackgroundImageMessage"]
        found += [one for one in images if one is not None]  # None: there is no image yet
    return found


@pytest.mark.slow
def test_a_client_is_sent_images_of_what_moves(view):
    # How many are on the way, and whose turn it is, is tested without sockets (test_images.py): how much of them
    # a client reads by itself, and when, is its own affair.
    view.post("send", value="images")
    with client(view) as socket_:
        shown = pictures(socket_, 3)
        while len(set(shown)) < 3:  # the body moves, if not by a pixel each time
            shown += pictures(socket_, 1)
        assert all(Image.open(io.BytesIO(one)).size[1] >= 144 for one in shown)
    view.post("send", value="triangles")
    until(lambda: not view.images)


def test_the_view_wakes_the_thread_that_sends(view):
    # In debug mode asyncio refuses each time what else fails now and then: another thread that wakes its own.
    page = view.screens[0]
    page._server.get_event_loop().set_debug(True)
    with client(view) as socket_:
        until(lambda: page.watched)
        assert sum(len(socket_.recv(timeout=SETTLES)) for _ in range(10)) > 1000  # what all clients are sent
        view.post("send", value="images")
        assert len(pictures(socket_, 3)) >= 3  # what one client is sent


def test_a_client_may_leave_while_it_is_sent_something(view):
    # viser warns of it in the view's thread, and here warnings are errors.
    with client(view):
        until(lambda: view.screens[0].watched)
        (gone,) = view.screens[0]._server.get_clients().values()
    until(lambda: not view.screens[0].watched)
    gone.scene.set_background_image(None)
    gone.add_notification("too late", "")
    runs(view)


@pytest.mark.slow
def test_controls_follow_what_keys_and_clients_do(view):
    gui = view.screens[0]._server.gui

    def widget(label):
        return next((one for one in list(gui._gui_input_handle_from_uuid.values()) if one.label == label), None)

    with client(view):
        until(lambda: widget("gravity [m/s²]") is not None)
        view.press("up")
        view.post("gravity", value=[0.0, 0.0, -3.0])
        view.post("wires", value=True)
        until(lambda: widget("speed (1 is real time)").value == "2")
        until(lambda: widget("gravity [m/s²]").value == 3.0)
        until(lambda: widget("connections").value)
        view.press("r")
        until(lambda: widget("gravity [m/s²]").value == 9.82)


def test_nothing_of_the_disk_is_served(view):
    import http.client

    page = view.screens[0]
    for path in (
        "/../../../../etc/passwd",
        "/..%2f..%2f..%2fetc/passwd",
        "//etc/passwd",
        "/%2e%2e/%2e%2e/pyproject.toml",
    ):
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=SETTLES)
        connection.request("GET", path)
        answer = connection.getresponse()
        text = answer.read()
        assert answer.status != 200 or b"root:" not in text, path
        assert b"[build-system]" not in text
        connection.close()


@pytest.mark.slow
def test_clients_that_misbehave_do_not_stop_the_view(view):
    page = view.screens[0]
    random = np.random.default_rng(3)
    with socket.create_connection(("127.0.0.1", page.port)) as raw:  # no HTTP at all
        raw.sendall(random.bytes(5000))
    with client(view) as garbage:  # a websocket, and what no viser sends
        garbage.send(random.bytes(500))
        garbage.send(b"\x81\xa4type\xa5Share")
    lazy = client(view, max_queue=1)  # never reads
    until(lambda: page.watched)
    runs(view)
    lazy.close()
    many = [client(view) for _ in range(8)]
    runs(view)
    for one in many:
        one.socket.close()  # gone without a word
    runs(view)
    until(lambda: not page.watched)


@pytest.mark.slow
def test_a_client_that_does_not_read_costs_no_memory(view):
    lazy = client(view, max_queue=1)
    until(lambda: view.screens[0].watched)
    runs(view)
    buffer = view.screens[0]._server._websock_server._broadcast_buffer
    counts = []
    for _ in range(3):
        simulated = view.source.index
        until(lambda simulated=simulated: view.source.index > simulated + 30)
        counts.append(len(buffer.message_from_id))
    # Of each property only the newest waits.
    assert max(counts) - min(counts) <= 20
    lazy.close()


@pytest.mark.slow
def test_opening_and_closing_leaves_nothing_behind():
    def once():
        view = served()
        with client(view) as one:
            one.recv(timeout=SETTLES)
        view.close()

    once()
    gc.collect()
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd")) if Path("/proc").exists() else 0
    for _ in range(4):
        once()
    gc.collect()
    until(lambda: threading.active_count() <= threads)
    if files:  # the socket of the page among them
        until(lambda: len(os.listdir("/proc/self/fd")) <= files + 2)  # Python's own, such as an epoll, may stay


def test_what_is_entered_stays_until_it_is_taken_up(monkeypatch):
    # The panel is told again and again where the simulation stands: an entry on its way must not be undone.
    now = [10.0]
    monkeypatch.setattr(panel.time, "monotonic", lambda: now[0])
    slider, stands = SimpleNamespace(value=1.0), [1.0]
    control = panel.Control(slider, lambda: stands[0])

    def updated(value):
        stands[0] = value
        control.update()
        return slider.value

    assert updated(1.0) == 1.0
    slider.value = 0.4  # entered
    now[0] += 0.5 * panel.PATIENCE
    assert updated(1.0) == 0.4
    assert updated(0.4) == 0.4  # taken up
    now[0] += 3 * panel.PATIENCE
    assert updated(0.4) == 0.4
    assert updated(2.0) == 2.0  # changed by another page: at once
    slider.value = 7.0  # entered, and refused
    assert updated(2.0) == 7.0
    now[0] += 1.1 * panel.PATIENCE
    assert updated(2.0) == 2.0
