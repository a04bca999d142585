"""Pictures of the page of the live view, in a wide and a narrow window and on a phone.

    python -m benchmarks.report.live_pictures

opens it in Chromium (pip install playwright), pulls the cube, and writes docs/images/live/page*.png.
"""

import time
from shutil import which

import numpy as np

from msdwarp.cli.commands.view import view_of
from msdwarp.cli.options import ViewOptions
from msdwarp.cli.scene_files import find_scene
from msdwarp.live import Browser

from ..common import IMAGES

SIZES = {"page": (1400, 800), "page_narrow": (700, 600), "page_phone": (390, 844)}
FRAMES = 24
"""Number of frames for which the cube is pulled."""
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
"""How Chromium draws without a graphics card."""


def main() -> None:
    """Draw all."""
    from playwright.sync_api import sync_playwright

    origin = find_scene("cube")
    view = view_of(origin, origin.scene(), ViewOptions(browser=True, device="cpu", paused=True))
    (browser_page,) = view.screens
    assert isinstance(browser_page, Browser)
    position = view.source.frame().position
    corner = position[np.argmax(position @ (1.0, -1.0, 1.0))]
    view.post("grab", holder=0, point=corner)
    view.post("drag", holder=0, point=corner + np.array([-0.7, -0.2, 0.9]))
    for _ in range(FRAMES):
        view.post("step")
    view.start()
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=which("chromium"), args=SOFTWARE)
        for name, (width, height) in SIZES.items():
            page = browser.new_page(viewport={"width": width, "height": height})
            page.set_default_timeout(120_000)
            page.goto(browser_page.address)
            page.wait_for_selector("text=drag the body")
            page.add_style_tag(content=".mantine-Notification-root { display: none }")  # of slow graphics
            page.wait_for_function("getComputedStyle(document.querySelector('canvas[data-engine]')).opacity == 1")
            time.sleep(8.0)  # surroundings, which light it, come last
            page.screenshot(path=IMAGES / "live" / f"{name}.png")
            page.close()
        browser.close()
    view.close()


if __name__ == "__main__":
    main()
