"""Images that a page is sent: what they show, how many are on the way, and when triangles give way to them."""

import importlib
from types import SimpleNamespace

import numpy as np
import pytest
from test_view import Listener, running

from msdwarp import Plane, Scene, box
from msdwarp.live import View
from msdwarp.live.images import LEAST_ROWS, PATIENCE, Images
from msdwarp.pictures import Drawing, Renderer, Stage

CUBE = box((4, 4, 4), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.2))
SCENE = Scene(system=CUBE, colliders=[Plane()], duration=1.0)


class Client:
    """A client whose camera stands where a stage's does, and which keeps the images that it is sent."""

    def __init__(self, camera, width=320, height=180):
        # Rotations of viser's take x, y, z to what is right, down and ahead.
        turn = np.stack([camera.right, -camera.up, camera.forward], axis=1)
        self.camera = SimpleNamespace(
            position=camera.eye,
            look_at=camera.target,
            wxyz=quaternion(turn),
            image_width=width,
            image_height=height,
        )
        self.images = []
        self.scene = SimpleNamespace(set_background_image=lambda image, **options: self.images.append(image))

    def flush(self):
        pass


class Wire:
    """A link on which what is sent arrives when a test says so."""

    def __init__(self):
        self.busy = False

    def ask(self):
        self.busy = True


def quaternion(turn):
    """Return the quaternion (w, x, y, z) of a rotation whose angle is not π."""
    w = np.sqrt(1 + np.trace(turn)) / 2
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.array([w, *axis / (4 * w)])


def drawn(device="cpu"):
    """Return images of the cube, their drawing, and a client who looks at it."""
    drawing = Drawing(SCENE, "texture", device)
    drawing.follow(CUBE.position, 0.0)
    stage = Stage(SCENE, CUBE.position[np.newaxis], (320, 180))
    images = Images(drawing, stage)
    images.follow()
    return images, drawing, Client(stage.camera)


def test_a_client_is_shown_what_pictures_show_from_there(device):
    pytest.importorskip("viser")
    images, _, client = drawn(device)
    images._on_cpu = False  # with shadows, as pictures have
    client.camera.image_height, client.camera.image_width = LEAST_ROWS, 256
    images.send([(0, client, Wire())])
    renderer = Renderer(SCENE, CUBE.position[np.newaxis], resolution=(256, 144), backend="raycast", device=device)
    expected = renderer.image(CUBE.position)
    # The stage was laid out for the same aspect. A rotation rounded to 1e-16 may let a ray at an edge pass it.
    differs = (np.abs(client.images[0].astype(int) - expected) > 2).any(axis=2)
    assert differs.mean() < 0.01


@pytest.mark.slow
def test_one_image_is_on_the_way_at_a_time():
    images, _, client = drawn()
    images._on_cpu = False  # no pause between images
    quick, slow, other = Wire(), Wire(), Client(at())
    for _ in range(5):
        images.follow()
        images.send([(0, client, quick), (1, other, slow)])
        quick.busy = False
    assert len(client.images) == 5
    assert len(other.images) == 1


def test_each_client_has_its_turn_where_drawing_takes_its_share_of_the_time():
    images, _, client = drawn()
    clients = [client, *(Client(at()) for _ in range(2))]
    for _ in range(6):  # an image each time: then the processor is left to the simulation for a while
        images.follow()
        images._free_at = 0.0
        images.send([(k, one, Wire()) for k, one in enumerate(clients)])
    assert [len(one.images) for one in clients] == [2, 2, 2]


def at():
    """Return the camera of pictures."""
    return Stage(SCENE, CUBE.position[np.newaxis], (320, 180)).camera


def test_nothing_is_drawn_twice_but_what_rests_is_drawn_fine():
    images, _, client = drawn()
    wire = Wire()
    for _ in range(3):
        wire.busy, images._free_at = False, 0.0
        images.send([(0, client, wire)])
    assert len(client.images) == 1
    images._seconds_a_row = 1.0 / LEAST_ROWS**2  # so slow that what moves is coarse
    images.follow()
    wire.busy, images._free_at = False, 0.0
    images.send([(0, client, wire)])
    assert len(client.images[-1]) == LEAST_ROWS
    images._seconds_a_row, images._moved = 1e-9, images._moved - 2 * PATIENCE
    images._sent = {k: (*what[:3], what[3] - 2 * PATIENCE) for k, what in images._sent.items()}
    for _ in range(3):
        wire.busy, images._free_at = False, 0.0
        images.send([(0, client, wire)])
    assert len(client.images) == 3
    assert len(client.images[-1]) == 180


class Page(Listener):
    """A listener that takes images."""

    takes_images = True


@pytest.mark.parametrize(
    ("kind", "sends", "given"), [(Page, "auto", True), (Page, "triangles", False), (Listener, "images", False)]
)
def test_a_slow_link_turns_to_images_where_they_are_taken_and_not_refused(kind, sends, given):
    screen = kind(lambda v: v.post("send", value=sends), 0, lambda v: v.post("slow"), 0, 0)
    view = View(running(), [screen])
    view.run()
    assert view.images is given


def test_many_triangles_are_drawn_where_a_gpu_simulates(device, monkeypatch):
    if device == "cpu":
        pytest.skip("a CPU draws more slowly than triangles are sent")
    module = importlib.import_module("msdwarp.live.state")
    monkeypatch.setattr(module, "MOST_TRIANGLES", 10)
    source = running()
    source.device = device
    view = View(source, [Page()])
    assert view.images
    assert view.shown.drawing.device == device
