"""Clients of the page of a view, as a browser is one and as none should be."""

import time

import msgspec
import viser
from viser._messages import ViewerCameraMessage

from msdwarp import Plane, Scene, Simulation, box
from msdwarp.live import Browser, Running, View, within_reach

SETTLES = 180.0
"""How long a loaded machine may take to do what is asked [s]."""
OWN = "its own"


def until(holds, seconds=SETTLES):
    """Wait until something holds, and fail if it never does."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it never did"
        time.sleep(0.02)


def bouncing(size=4):
    # Undamped and without a floor that takes anything: it bounces for as long as a test takes.
    body = box((size, size, size), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.5))
    scene = within_reach(Scene(system=body, colliders=[Plane(restitution=1.0)], duration=1.0))
    return Running(scene, Simulation.from_scene(scene, device="cpu"), "bouncing", parameters={"size": size})


def served(**options):
    """Return a view with a page, which runs in a thread of its own until it is closed."""
    view = View(bouncing(), [Browser(**options)], rebuild=lambda size: bouncing(size))
    view.start()
    return view


def connected(page, *, origin=OWN, host=None, path="", **options):
    """Return a web socket of a page, opened by a page of some origin under some name."""
    from websockets.sync.client import connect

    name = f"viser-v{viser.__version__}"
    address = f"ws://{host or '127.0.0.1'}:{page.port}{path}"
    own = f"http://{host or '127.0.0.1'}:{page.port}"
    options = {"max_size": None, "close_timeout": 0.5} | options  # who has left much unread waits to be closed
    return connect(address, subprotocols=[name], origin=own if origin is OWN else origin, **options)


def client(view, **options):
    """Return a web socket that a view counts as a client, once it has said where its camera stands."""
    opened = connected(view.screens[0], **options)
    send(opened, camera())
    return opened


def send(socket, message):
    """Send what viser would, or what it would not."""
    socket.send(message if isinstance(message, bytes) else msgspec.msgpack.encode(message))


def camera(**other):
    """Return what a client says of its camera."""
    zero, one = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    said = ViewerCameraMessage(one, (3.0, 0.0, 1.0), 0.8, 0.01, 1000.0, 160, 240, zero, (0.0, 0.0, 1.0))
    return {**said.as_serializable_dict(), **other}


def runs(view):
    """Wait until the view has simulated more, whether or not anybody looks."""
    view.post("pause", value=False)
    before = view.source.time
    until(lambda: view.source.time > before)
