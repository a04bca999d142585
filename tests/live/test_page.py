"""The page of a view in a real browser, by its mouse, its keys and a finger."""

import io
import time
from contextlib import contextmanager
from shutil import which

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("viser")
from pages import SETTLES, runs, until

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := which(name))), None
)
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")


@pytest.fixture(scope="module")
def chromium():
    """A browser for all tests that need a real one."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@contextmanager
def opened(chromium, view, **options):
    """Open a page of a view; yield it, and its camera, which tells where it stands."""
    said = []
    with chromium.new_page(**options) as page:
        page.set_default_timeout(1000 * SETTLES)
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(view.screens[0].address)
        page.wait_for_selector("text=bouncing")
        # Notices, as of slow graphics, lie over a corner of the picture for a while, and take the mouse.
        page.add_style_tag(content=".mantine-Notification-root { display: none !important }")
        until(lambda: view.screens[0].watched)
        (camera,) = (one.camera for one in view.screens[0]._server.get_clients().values())
        yield page, camera
        assert not said, said


@pytest.mark.slow
def test_a_newcomer_finds_the_body_beside_the_panel_at_any_size(chromium, view, capsys):
    time.sleep(0.3)
    assert view.source.time == 0.0  # it waits for somebody who looks
    options = {"viewport": {"width": 780, "height": 480}, "has_touch": True}
    with opened(chromium, view, permissions=["clipboard-read", "clipboard-write"], **options) as (page, camera):
        until(lambda: view.source.time > 0.3)
        view.post("pause", value=True)
        until(lambda: view.paused)
        corners = np.stack(np.meshgrid(*zip(*extent(view), strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
        for width, height in ((780, 480), (390, 640)):  # below 768 the panel is under the picture
            page.set_viewport_size({"width": width, "height": height})

            def is_seen():
                hint, (wide, high) = page.get_by_text("drag the body to pull it").bounding_box(), size(page)
                at = np.array([seen_at(camera, corner, wide, high) for corner in corners])
                beside = hint is not None and (hint["x"] >= wide or hint["y"] >= high)  # None: moved just now
                return beside and (at > 0).all() and (at < (wide, high)).all()

            until(is_seen)
            assert size(page) != (width, height)

        listed = page.get_by_text("pin the particles held")
        page.keyboard.press("h")
        listed.wait_for()
        page.keyboard.press("h")
        listed.wait_for(state="detached")
        page.keyboard.press("w")
        page.get_by_text("−20 %").wait_for()
        page.get_by_text("+20 %").wait_for()
        page.keyboard.press("w")
        told = []
        page.keyboard.press("v")
        until(lambda: told.append(view.notice) or told[-1].startswith("--azimuth"))  # it is shown for a while
        until(lambda: page.evaluate("navigator.clipboard.readText()") == told[-1])
        assert capsys.readouterr().out.strip() == told[-1]

        # A finger on the body pulls it.
        touch = page.context.new_cdp_session(page)

        def finger(phase, *at):
            points = [{"x": x, "y": y} for x, y in at]
            touch.send("Input.dispatchTouchEvent", {"type": phase, "touchPoints": points})
            time.sleep(0.05)

        def pulls():  # again if the camera has left the body meanwhile
            across, down = seen_at(camera, corners.mean(axis=0), *size(page))
            finger("touchStart", (across, down))
            for k in range(1, 8):
                finger("touchMove", (across - 4 * k, down - 8 * k))
            held = holds_soon(page, view)
            if not held:
                finger("touchEnd")
            return held

        until(pulls)
        finger("touchEnd")
        until(lambda: view.hand.grip is None)


def size(page):
    """Return the width and height of the picture of a page, which begins in its upper left corner."""
    box = page.locator("canvas[data-engine]").bounding_box()
    assert (box["x"], box["y"]) == (0, 0)
    return box["width"], box["height"]


def extent(view):
    """Return the least and the largest coordinates of a body, in what moves along with the camera."""
    position = view.source.frame().position - view.following.shift
    return position.min(axis=0), position.max(axis=0)


@pytest.mark.slow
def test_a_browser_shows_the_body_and_handles_it(chromium, view):
    with opened(chromium, view, viewport={"width": 780, "height": 420}) as (page, camera):
        first = page.screenshot()
        runs(view)
        until(lambda: page.screenshot() != first)

        page.keyboard.press("Space")
        until(lambda: view.paused)
        page.keyboard.press("s")
        until(lambda: view.source.handling.factors["stiffness"] == 1.25)
        page.keyboard.press("Shift+S")
        until(lambda: view.source.handling.factors["stiffness"] == 1.0)
        stood = np.concatenate([camera.position, camera.look_at])
        for _ in range(3):  # a key that is held
            page.keyboard.down("d")
        until(lambda: view.source.handling.factors["damping"] == 1.25**3)
        page.wait_for_timeout(500)  # in which viser's camera would go a metre to the right
        page.keyboard.up("d")
        stiffness = page.locator("input[inputmode=decimal]").nth(1)  # of the sliders, beside mass

        def enters():  # again if the panel, told of the damping meanwhile, has written the old number over it
            stiffness.fill("3")
            stiffness.press("Enter")
            page.wait_for_timeout(300)
            return view.source.handling.factors["stiffness"] == 3.0

        until(enters)
        assert np.array_equal(np.concatenate([camera.position, camera.look_at]), stood)

        # Where the camera sees the middle of the body: the client tells where it stands.
        until(lambda: size(page)[0] < 780)  # the panel is beside the picture
        until(lambda: drags(page, camera, view, (-4, -8), 10))
        lowest = view.source.frame().position[:, 2].min()
        page.keyboard.press("Space")
        until(lambda: not view.paused)
        until(lambda: view.source.frame().position[:, 2].min() > lowest + 0.02)
        page.mouse.up()
        until(lambda: view.hand.grip is None)

        # By images the middle of the picture has the body's color, and a drag takes hold of it.
        view.post("send", value="images")
        until(lambda: view.screens[0]._images is not None and view.screens[0]._images._sent)
        view.post("reset")
        view.post("pause", value=True)
        time.sleep(1.0)
        until(lambda: drags(page, camera, view, (0, -8), 5))
        across, down = seen_at(camera, np.mean(extent(view), axis=0), *size(page))
        page.mouse.up()
        until(lambda: view.hand.grip is None)

        def at_the_body():
            shown = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            return shown.getpixel((round(across), round(down)))

        until(lambda: at_the_body()[0] > at_the_body()[2] + 40)  # red jelly on a grey ground


def drags(page, camera, view, way, steps):
    """Drag from the middle of the body, which the camera may have left meanwhile; return whether it is held."""
    page.mouse.up()
    across, down = seen_at(camera, np.mean(extent(view), axis=0), *size(page))
    page.mouse.move(across, down)
    page.mouse.down()
    for k in range(1, steps + 1):
        page.mouse.move(across + way[0] * k, down + way[1] * k)
        time.sleep(0.05)
    return holds_soon(page, view)


def holds_soon(page, view):
    """Return whether the hand holds the body, waiting for a slow page to say so."""
    for _ in range(50):
        if view.hand.grip is not None:
            break
        page.wait_for_timeout(100)
    return view.hand.grip is not None


def seen_at(camera, point, width, height):
    """Return the pixel, across and down, at which a camera of viser's sees a point."""
    forward = camera.look_at - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    offset = point - camera.position
    scale = height / 2 / np.tan(camera.fov / 2) / (offset @ forward)
    return width / 2 + scale * (offset @ right), height / 2 - scale * (offset @ up)
