"""Opening: `view`, which shows a scene, a simulation or a trajectory."""

import contextlib
from dataclasses import replace
from pathlib import Path

from .. import checks
from ..files import Trajectory
from ..pictures import no_display
from ..simulation import Simulation
from ..world import Hand, Scene, Touch, scene_from_stored
from .browser import HOST, Browser
from .handling import within_reach
from .sources import Played, Running, Source
from .view import Screen, View
from .window import Window


def view(
    shown: Scene | Simulation | Trajectory | str | Path,
    *,
    browser: bool | None = None,
    block: bool = True,
    host: str = HOST,
    port: int | None = None,
    paused: bool = False,
) -> View:
    """Show a scene or a simulation as it runs, or play a trajectory, in a window or a browser.

    Parameters
    ----------
    shown
        What is shown: a scene, a simulation, a trajectory or its file. Until the view is closed nobody else may
        use a simulation that is shown.
    browser
        Whether a page is served, and no window opened; by default if there is no display.
    block
        Wait until the window is closed, or Ctrl-C; otherwise return at once, and `View.close` ends it. A window
        can only be waited for.
    host
        Address that the page is served at; by default one that only this machine can open.
    port
        Port of the page; by default 8080 or the next that is free.
    paused
        Wait at the first frame.

    Returns
    -------
    View
        What shows it. `View.post("scale", name="stiffness", factor=2.0)`, and so on, do what the page can.

    Raises
    ------
    ValueError
        If `shown` is none of these, viser is not installed, or the port is taken.
    """
    source = _source_of(shown)
    if browser is None:
        browser = not has_display()
    if not browser and not block:
        raise ValueError("block is False; a window must be waited for: add browser=True")
    screen = screen_for(browser, host, port)
    if isinstance(screen, Browser):
        print(screen.address)
    opened = View(source, [screen], paused=paused)
    if not block:
        opened.start()
        return opened
    with contextlib.suppress(KeyboardInterrupt):
        opened.run()
    return opened


def has_display() -> bool:
    """Tell whether a window can be opened here."""
    return no_display() is None


def screen_for(browser: bool, host: str = HOST, port: int | None = None) -> Screen:
    """Return a page or a window."""
    if browser:
        return Browser(host, port)
    return Window()


def scene_of(shown: object) -> tuple[Simulation | Trajectory, Scene]:
    """Return a simulation or a trajectory, which may be given as its file, and what it is of."""
    if isinstance(shown, str | Path):
        path = Path(shown)
        shown = Trajectory(path / "trajectory.vtkhdf" if path.is_dir() else path)
    if isinstance(shown, Trajectory):
        stored = shown.scene
        return shown, Scene(system=shown.system) if stored is None else scene_from_stored(shown.system, *stored)
    checks.instance("shown", shown, Simulation, "Simulation.of(scene), a Scene, a Trajectory or its file")
    assert isinstance(shown, Simulation)
    touch = [one for one in shown.loads if isinstance(one, Touch)]
    around = {"colliders": shown.colliders, "loads": shown.loads, "touch": touch, "gravity": shown.gravity}
    return shown, Scene(system=shown.system, **around)


def _source_of(shown: object) -> Source:
    """Return what shows a scene, a simulation or a trajectory."""
    if isinstance(shown, Scene):
        handled = within_reach(shown)
        return Running(handled, Simulation.of(handled))
    shown, scene = scene_of(shown)
    if isinstance(shown, Trajectory):
        return Played(shown, scene, shown.path.stem)
    if not any(isinstance(one, Hand) for one in shown.loads):
        shown.change(loads=[*shown.loads, Hand()])
        scene = replace(scene, loads=shown.loads)
    return Running(scene, shown)
