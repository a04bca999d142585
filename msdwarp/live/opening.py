"""Opening: `view`, which shows a scene, a simulation or a trajectory."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from .. import checks
from ..files import Trajectory
from ..pictures import no_display
from ..simulation import Simulation
from ..world import Contact, MouseSpring, Scene, scene_from_stored
from .browser import HOST, Browser
from .handling import within_reach
from .sources import Played, Running, Source
from .view import View
from .window import Window


def view(
    shown: Scene | Simulation | Trajectory | str | Path,
    *,
    browser: bool | None = None,
    block: bool = True,
    host: str = HOST,
    port: int | None = None,
    allow_origin: Sequence[str] = (),
    paused: bool = False,
) -> View:
    """Show a scene or simulation live, or play a trajectory, in a window or a browser.

    A page starts when it is first opened, or after `View.post("pause", value=False)`.

    Parameters
    ----------
    shown
        A scene, a simulation, a trajectory, or a trajectory's file. Do not use a simulation elsewhere until the
        view is closed.
    browser
        Serve a web page instead of opening a window; by default if there is no display.
    block
        Wait until the window is closed, or Ctrl-C. Otherwise return at once; `View.close` ends the view. A window
        always waits.
    host
        Network address of the page; by default only this machine can open it. Otherwise the printed address has a
        token, without which nobody can open the page.
    port
        Port of the page; by default 8080 or the next free one.
    allow_origin
        Origins of other pages that may control this page, such as a proxy, "https://lab.example".
    paused
        Start paused.

    Returns
    -------
    View
        The view. Calls such as `View.post("scale", name="stiffness", factor=2.0)` do the same as the page's
        controls.

    Raises
    ------
    ValueError
        If `shown` or an origin is invalid, viser is not installed, or the port is in use.
    """
    if isinstance(shown, Scene):
        handled = within_reach(shown)
        source: Source = Running(handled, Simulation.from_scene(handled))
    else:
        shown, scene = scene_of(shown)
        if isinstance(shown, Trajectory):
            source = Played(shown, scene, shown.path.stem)
        else:
            if not any(isinstance(one, MouseSpring) for one in shown.loads):
                shown.change(loads=[*shown.loads, MouseSpring()])
                scene = replace(scene, loads=shown.loads)
            source = Running(scene, shown)
    if browser is None:
        browser = no_display() is not None
    if not browser and not block:
        raise ValueError("block is False; a window must be waited for: add browser=True")
    screen = Browser(host, port, allow_origin) if browser else Window()
    if isinstance(screen, Browser):
        print(screen.address)
    opened = View(source, [screen], paused=paused)
    if not block:
        opened.start()
        return opened
    with contextlib.suppress(KeyboardInterrupt):
        opened.run()
    return opened


def scene_of(shown: object) -> tuple[Simulation | Trajectory, Scene]:
    """Return (simulation or trajectory, its scene); `shown` may be a trajectory's file."""
    if isinstance(shown, str | Path):
        shown = Trajectory(shown)
    if isinstance(shown, Trajectory):
        stored = shown.scene
        return shown, Scene(system=shown.system) if stored is None else scene_from_stored(shown.system, *stored)
    such_as = "Simulation.from_scene(scene), ensemble.simulation_of(0), a Scene, a Trajectory or its file"
    checks.instance("shown", shown, Simulation, such_as)
    assert isinstance(shown, Simulation)
    contact = [one for one in shown.loads if isinstance(one, Contact)]
    around = {"colliders": shown.colliders, "loads": shown.loads, "contact": contact, "gravity": shown.gravity}
    return shown, Scene(system=shown.system, **around)
