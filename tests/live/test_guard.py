"""Who may open the page of a view, and what may come from one: nothing that does ends the simulation."""

import http.client
import math
import socket
import sys
import threading
from contextlib import suppress
from types import SimpleNamespace

import pytest

from msdwarp.live import Browser, View
from msdwarp.live.browser import MOST_WAITING
from msdwarp.live.commands import COMMANDS

viser = pytest.importorskip("viser")
from pages import SETTLES, bouncing, camera, client, connected, runs, send, served, until  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402


@pytest.fixture
def abroad():
    """A view that is served to a network: it has a token."""
    made = served(host="0.0.0.0")
    yield made
    made.close()


def status(page, path="/", **headers):
    """Return what an HTTP request is answered with, and the headers of the answer."""
    asked = http.client.HTTPConnection("127.0.0.1", page.port, timeout=SETTLES)
    asked.request("GET", path, headers=headers)
    answer = asked.getresponse()
    answer.read()
    asked.close()
    return answer.status, answer.headers


def refused(page, **options):
    """Return with which status a web socket is refused; None if it is opened."""
    try:
        connected(page, **options).close()
    except InvalidStatus as error:
        return error.response.status_code
    return None


def via(page):
    """Return a socket to the page, for requests under another name."""
    return socket.create_connection(("127.0.0.1", page.port))


def test_pages_of_other_origins_or_none_open_no_web_socket(view):
    origins = (
        "http://evil.example",
        "https://evil.example:8080",
        "null",
        "http://127.0.0.1",
        "http://127.0.0.1:1",
    )
    for origin in (*origins, "http://127.0.0.1.evil.example", "file://", "", None):
        assert refused(view.screens[0], origin=origin) == 403, origin


def test_the_page_itself_opens_a_web_socket_by_every_name_of_this_machine(view):
    page = view.screens[0]
    assert "token" not in page.address
    assert "frame-ancestors 'self'" in status(page)[1]["Content-Security-Policy"]  # no other page holds it
    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]"):
        assert refused(page, host=name, sock=via(page)) is None, name
    # Forwarded from a port of another machine: the browser knows that one.
    forwarded = "ws://localhost:9/"
    from websockets.sync.client import connect

    name = [f"viser-v{viser.__version__}"]
    with connect(forwarded, sock=via(page), origin="http://localhost:9", subprotocols=name):
        pass


def test_names_that_are_not_its_own_are_refused(view):
    # Another page's name may be led to this machine: then its origin is that of what it asks for.
    page = view.screens[0]
    for name in ("evil.example", "127.0.0.1.evil.example", "192.0.2.1", "localhost.evil.example"):
        assert refused(page, host=name, sock=via(page)) == 403, name
        assert status(page, Host=f"{name}:{page.port}")[0] == 403, name
    assert status(page, Host="")[0] == 403
    assert status(page)[0] == 200
    assert status(page, Origin="http://evil.example")[0] == 403


def test_origins_that_are_named_are_accepted():
    view = served(allow_origin=["https://Lab.Example"])
    page = view.screens[0]
    assert refused(page, origin="https://lab.example") is None
    assert refused(page, origin="https://lab.example", host="lab.example", sock=via(page)) is None
    assert refused(page, origin="https://other.example") == 403
    view.close()
    for wrong in ("lab.example", "ftp://lab.example", "https://lab.example/page", "*", "http://lab.example:x", 3):
        with pytest.raises(ValueError, match="allow_origin"):
            Browser(allow_origin=[wrong])


def test_a_page_that_a_network_can_open_needs_its_token(abroad):
    page = abroad.screens[0]
    path, _, token = page.address.rpartition("/?token=")
    assert path.startswith("http://")
    assert len(token) >= 32
    for wrong in ("/", "/?token=", "/?token=%C3%A4", f"/?token={token[:-1]}", f"/?token={token}x"):
        assert status(page, wrong)[0] == 403, wrong
        assert refused(page, path=wrong) == 403, wrong
    found, headers = status(page, f"/?token={token}")
    assert found == 200
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    kept = cookie.partition(";")[0]
    assert status(page, Cookie=f"other=1; {kept}")[0] == 200
    assert refused(page, additional_headers={"Cookie": kept}) is None
    assert refused(page, additional_headers={"Cookie": kept + "x"}) == 403
    assert refused(page, path=f"/?token={token}") is None
    assert refused(page, path=f"/?token={token}", origin="http://evil.example") == 403
    # Under a number no page of another name can ask for it; under the machine's own name it is asked for too.
    assert status(page, f"/?token={token}", Host="192.0.2.1:80")[0] == 200
    assert status(page, f"/?token={token}", Host=f"{socket.gethostname()}:80")[0] == 200
    assert status(page, f"/?token={token}", Host="evil.example")[0] == 403


def test_a_viser_that_cannot_be_guarded_is_refused(monkeypatch):
    import websockets
    from websockets.asyncio import server

    from msdwarp.live import guard

    # It has a server of its own, such as one that it has imported under another name.
    own = SimpleNamespace(server=SimpleNamespace(**vars(server)))
    with monkeypatch.context() as patch:
        patch.setattr("viser.infra._infra.websockets", SimpleNamespace(**vars(websockets) | {"asyncio": own}))
        with pytest.raises(ValueError, match=r"viser .* in a way that msdwarp cannot guard"):
            Browser()
    monkeypatch.setitem(guard.RULES, "ViewerCameraMessage", {"unheard_of": lambda value: True})
    with pytest.raises(ValueError, match="ViewerCameraMessage has no field unheard_of"):
        Browser()


def widget(view, label):
    """Return what the panel has under a label."""
    gui, found = view.screens[0]._server.gui, []

    def is_there():
        found[:] = [one for one in list(gui._gui_input_handle_from_uuid.values()) if one.label == label]
        return bool(found)

    until(is_there)
    return found[0]


def uuid(view, label):
    return widget(view, label)._impl.uuid


def survives(view, socket_, messages):
    """Send what no page sends, and see that the view goes on and hears what is sent behind it."""
    for one in messages:
        with suppress(ConnectionClosed):
            send(socket_, one)
    runs(view)
    with client(view) as another:
        factor = 2.0 if view.source.handling.factors["stiffness"] == 1.0 else 1.0
        slider = uuid(view, "stiffness ×")
        send(another, {"type": "GuiUpdateMessage", "uuid": slider, "updates": {"value": factor}})
        until(lambda: view.source.handling.factors["stiffness"] == factor)
    runs(view)


def test_a_client_sets_values_and_nothing_else(view):
    with client(view) as hostile:
        slider = widget(view, "mass ×")
        before = dict(vars(slider._impl))
        names = [*before, "__class__", "__dict__", "unheard_of"]
        sent = [
            {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {name: 5}}
            for name in names
            if name != "value"
        ]
        sent += [
            {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": 2.0, "update_cb": 5}}
        ]
        survives(view, hostile, sent)
        after = vars(slider._impl)
        assert all(after[name] is before[name] for name in before if name not in ("value", "update_timestamp"))
        assert after["value"] == 1.0
        assert view._thread.is_alive()


def test_values_that_no_widget_shows_are_not_taken(view):
    with client(view) as hostile:
        slider, text = uuid(view, "mass ×"), uuid(view, "colors")
        odd = [math.nan, math.inf, 1e300, -1, 0, "x", None, [], [1.0] * 3, {}, "x" * 10_000, 2**64 - 1, True]
        sent = [
            {"type": "GuiUpdateMessage", "uuid": one, "updates": {"value": value}}
            for one in (slider, text)
            for value in odd
        ]
        survives(view, hostile, sent)
        assert 0.1 <= view.source.handling.factors["mass"] <= 10.0


def test_messages_of_other_kinds_are_not_heard(view):
    kinds = [one.__name__ for one in viser._messages.Message.get_subclasses()]
    assert {"ShareUrlRequest", "FileTransferStartUpload"} <= set(kinds)
    with client(view) as hostile:
        sent = [{"type": kind} for kind in kinds] + [{"type": kind, "uuid": "x", "name": "x"} for kind in kinds]
        sent += [b"", b"\xc1", b"\x81", [], 3, None, {}, {"type": 3}, {"type": []}, {"type": "x" * 1000}]
        sent += [b"\x91" * 5000, camera(unheard_of=1), camera(position=[math.nan] * 3), camera(wxyz=[0.0] * 4)]
        sent += [camera(image_width=10**9), camera(image_height=0), camera(fov=-1.0), camera(position="xyz")]
        survives(view, hostile, sent)
        hostile.send("text")
        survives(view, hostile, [])


def test_a_message_that_is_too_long_ends_its_connection(view):
    hostile = client(view)
    until(lambda: view.screens[0].watched)
    with suppress(ConnectionClosed):
        hostile.send(bytes(1 << 20))
        while True:
            hostile.recv(timeout=SETTLES)
    assert hostile.close_code == 1009  # "message too big"
    runs(view)


def test_what_is_asked_for_faster_than_it_is_done_waits_outside(monkeypatch):
    done = []
    monkeypatch.setitem(COMMANDS, "reset", lambda view: done.append(view.waiting))
    view = View(bouncing(), [Browser()])  # nobody runs its loop: nothing is done until the test has it done
    page = view.screens[0]
    page.open(view)
    page.stage()
    restart = next(k for k, one in page._server.gui._command_handle_from_uuid.items() if one.label == "restart")
    with client(view) as hostile:
        for _ in range(1000):
            send(hostile, {"type": "CommandTriggerMessage", "uuid": restart})
        until(lambda: view.waiting >= MOST_WAITING)
        until(lambda: view._execute_commands() or len(done) == 1000)
    # A connection has sixteen messages that are read already, and a few may be on the way to the view.
    assert max(done) < 10 * MOST_WAITING
    view.close()
    page.close()


def test_a_scene_that_cannot_be_built_leaves_the_other_one():
    class Odd(BaseException):
        pass

    raised = iter([RuntimeError("odd"), MemoryError("out of it"), ZeroDivisionError("zero"), SystemExit("left")])

    def rebuild(size):
        raise next(raised)

    view = View(bouncing(), [], rebuild=rebuild)
    first = view.source
    for word in ("odd", "out of it", "zero", "left"):
        view.post("parameters", size=3)
        view._execute_commands()
        assert word in view.notice
        assert view.source is first
        view._advance()


def test_a_scene_that_cannot_be_drawn_leaves_the_other_one(monkeypatch):
    view = View(bouncing(), [], rebuild=bouncing)
    first, shown = view.source, view.shown
    draw = View._draw

    def fails(self, *words, **options):
        if self.source is not first:
            raise MemoryError("no room for a picture")
        draw(self, *words, **options)

    monkeypatch.setattr(View, "_draw", fails)
    view.post("parameters", size=3)
    view._execute_commands()
    assert "no room for a picture" in view.notice
    assert view.source is first
    assert len(view.shown.drawing.points) == len(shown.drawing.points)


def interrupt():
    raise KeyboardInterrupt


def in_a_thread(function):
    thread = threading.Thread(target=function)
    thread.start()
    thread.join()


@pytest.mark.parametrize(
    ("fails", "name"),
    [(lambda: 1 / 0, "ZeroDivisionError"), (sys.exit, "SystemExit"), (interrupt, "KeyboardInterrupt")],
)
def test_what_fails_in_a_view_s_thread_does_not_end_it(monkeypatch, fails, name):
    view = View(bouncing(), [])
    monkeypatch.setattr(view.source, "advance", fails)
    view._clock -= 1.0
    in_a_thread(view._advance)
    assert view.paused
    assert name in view.notice
    monkeypatch.setitem(COMMANDS, "failing", lambda _: fails())
    view = View(bouncing(), [])
    view.post("failing")
    in_a_thread(view._execute_commands)
    assert name in view.notice


def test_ctrl_c_ends_a_view_in_the_main_thread(monkeypatch):
    view = View(bouncing(), [])
    monkeypatch.setattr(view.source, "advance", interrupt)
    view._clock -= 1.0
    with pytest.raises(KeyboardInterrupt):
        view._advance()
