"""View a scene during its simulation, or a trajectory, in a window or a browser."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from ... import checks
from ...files import Trajectory
from ...live import Browser, Played, Running, Source, View, Window, within_reach
from ...pictures import no_display
from ...world import Scene
from ..options import ViewOptions
from ..picture_options import CameraOptions, Pictures
from ..process import stop_requests
from ..scene_files import Origin, find_scene
from .run import about, simulation_by

_SIMULATED = 64
"""Memory of a simulation per spring, with its part of the particles, in addition to the system [bytes]."""
SHELF = ("mattress", "dice", "worm", "cloth", "ice_cream", "cube", "jelly", "tower", "flag")
"""Scenes on the keys 1 to 9; the first five were in the 2014 program."""


def view_scene(origin: Origin, scene: Scene, options: ViewOptions) -> None:
    """Show a scene during its simulation, until the window is closed or Ctrl-C is pressed."""
    _run(view_of(origin, scene, options))


def view_of(origin: Origin, scene: Scene, options: ViewOptions) -> View:
    """Return a view of a scene during its simulation.

    Raise ValueError if an option is out of range, or there is neither a display nor the package for web pages.
    """
    usual = {one.name: one.default for one in fields(CameraOptions)}
    elsewhere = replace(options, **usual)  # a camera is aimed at one scene only

    def from_shelf(name: str) -> Source:
        other = find_scene(name)
        return running_scene(other, other.scene(), elsewhere)

    shelf = {name: partial(from_shelf, name) for name in SHELF}
    return _view(running_scene(origin, scene, options), options, scenes=shelf)


def _view(source: Source, options: ViewOptions, **more: Any) -> View:
    """Return a view in a window if there is a display, otherwise on a web page."""
    if options.browser and options.window:
        raise ValueError("browser and window are both given; choose one")
    Pictures(renderer=options.renderer).check(1)
    why = None if options.browser else no_display()
    if options.window and why is not None:
        raise ValueError(f"{why}; use --browser")
    on_page = options.browser or why is not None
    screen = Browser(options.host, options.port, options.allow_origin) if on_page else Window()
    return View(source, [screen], paused=options.paused, renderer=options.renderer, zoom=options.zoom, **more)


def view_trajectory(trajectory: Trajectory, scene: Scene, name: str, options: ViewOptions) -> None:
    """Play a trajectory, until the window is closed or Ctrl-C is pressed."""
    scene = replace(scene, look=options.aimed(scene.look))
    _run(_view(Played(trajectory, scene, name), options))


def running_scene(origin: Origin, scene: Scene, options: ViewOptions) -> Running:
    """Return the source of a view of a scene during its simulation."""
    run_options = options.run_options
    scene = replace(scene, look=options.aimed(scene.look))
    handled = within_reach(scene)
    simulation = simulation_by(handled, run_options)
    made_by = about(origin, scene, simulation, run_options)
    source = Running(handled, simulation, origin.name, parameters=made_by["parameters"], attributes=made_by)

    def rebuilt(**parameters: Any) -> Running:
        other = origin._replace(parameters={**origin.parameters, **rounded_like(source.parameters, parameters)})
        with memory_limit():  # limits the host's memory; a GPU's driver reports its own errors
            scene = other.scene()
        count = scene.system.connection_count
        checks.fits(f"the scene has {count} connections", "its simulation and drawing", _SIMULATED * count)
        return running_scene(other, scene, options)

    source.rebuild = rebuilt
    return source


def rounded_like(before: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters, rounded to integers if the value in `before` is an integer."""
    return {
        name: round(value) if isinstance(before.get(name), int) and isinstance(value, float) else value
        for name, value in parameters.items()
    }


def _run(view: View) -> None:
    """Run a view until it is closed or a signal arrives; print the page's address, and who can open the page."""
    with stop_requests(Console(stderr=True)) as requests:
        for page in view.screens:
            if not isinstance(page, Browser):
                continue
            print(f"{page.address}  (Ctrl-C stops)", flush=True)
            if "token" in page.address:
                print("anyone who has this address can see and control it", flush=True)
            else:
                print(
                    f"from another machine: ssh -L {page.port}:127.0.0.1:{page.port} USER@THIS-MACHINE", flush=True
                )
        try:
            view.run(until=lambda: bool(requests))
        except KeyboardInterrupt:
            if len(requests) != 1:  # the first is of a signal within a long frame
                raise
        requests.clear()


@contextmanager
def memory_limit() -> Iterator[None]:
    """Raise MemoryError if more memory is requested than is free; otherwise Linux would end the process.

    The limit holds for the whole process.
    """
    there = checks.free_memory()
    try:
        import resource

        now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    except (ImportError, OSError, ValueError):  # Windows and macOS have no such limit
        yield
        return
    least = [one for one in (soft, hard) if one != resource.RLIM_INFINITY]
    if there is not None:
        least.append(now + there)
    try:
        if least:
            resource.setrlimit(resource.RLIMIT_AS, (min(least), hard))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
