"""Notebook: `show`, which displays a film, or a still that the mouse turns, in the output of a cell."""

import base64
import io
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..files import Trajectory
from ..pictures import Renderer, framed, picture_size, write_film
from ..runtime import renamed
from ..simulation import Simulation
from ..world import Scene
from .opening import scene_of

VIEWS = 12
"""Number of pictures around a still; the mouse selects one."""
TURNED = """<img id="{name}" src="data:image/webp;base64,{first}" style="cursor: grab" draggable="false">
<script>{{
  const views = [{views}], image = document.getElementById("{name}"), width = {width};
  let at = 0, from = null;
  image.onpointerdown = event => {{ from = event.clientX + at * width / views.length;
                                    image.setPointerCapture(event.pointerId); }};
  image.onpointerup = () => {{ from = null; }};
  image.onpointermove = event => {{
    if (from === null) return;
    at = Math.round((from - event.clientX) * views.length / width);
    image.src = "data:image/webp;base64," + views[((at % views.length) + views.length) % views.length];
  }};
}}</script>"""
"""Page of a still: moving the mouse across its width turns it once around."""


@renamed(colouring="coloring")
def show(
    shown: Simulation | Scene | Trajectory | str | Path,
    *,
    seconds: float | None = None,
    resolution: tuple[int, int] = (640, 360),
    coloring: str | None = None,
) -> None:
    """Show a film, or a still that you can rotate with the mouse, in a notebook.

    Parameters
    ----------
    shown
        A trajectory or its file, shown as a film; or a scene or a simulation, which is simulated and shown.
    seconds
        Simulated time [s]. By default a scene is simulated for its duration, and the current state of a simulation
        is shown as a still.
    resolution
        Width and height in pixels.
    coloring
        "texture" or "strain". Default: set by the scene's look.

    Raises
    ------
    RuntimeError
        If IPython is not installed, or the film is not in a notebook.
    ValueError
        If `shown` is invalid, or an argument is out of range.
    """
    try:
        from IPython import display, get_ipython  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise RuntimeError("show draws in a notebook, which needs IPython: pip install jupyterlab") from None
    if get_ipython() is None:
        raise RuntimeError("show draws in a notebook, and here is none; msdwarp.view shows a scene in a window")
    width, height = resolution = picture_size(resolution)
    if seconds is not None:
        checks.positive("seconds", seconds)
    if isinstance(shown, Scene):
        seconds, scene = shown.duration if seconds is None else seconds, shown
        shown = Simulation.from_scene(shown)
    else:
        shown, scene = scene_of(shown)
    if isinstance(shown, Simulation) and seconds is None:
        scene = replace(scene, system=shown.snapshot())  # without what has torn
        display.display(display.HTML(_still(scene, scene.system.position, shown.time, resolution, coloring)))
        return
    bar: Any = display.display(display.HTML(""), display_id=True)

    def progress(doing: str, done: int, count: int) -> None:
        if done % max(1, count // 50) == 0:
            bar.update(display.HTML(f'{doing} <progress max="{count}" value="{done}"></progress>'))

    if isinstance(shown, Trajectory):
        positions: Sequence[NDArray] = shown.positions  # pyright: ignore[reportAssignmentType]
        times, fps, broken_at = list(shown.times), shown.fps, shown.broken_at if scene.system.tears else None
    else:
        positions, times, fps = [], [], shown.fps
        count = max(1, round((seconds or 0.0) * fps))
        # The first frame is the current one.
        for k, frame in zip(range(count), shown.frames(count / fps), strict=False):
            progress("simulating", k, count)
            positions.append(frame.position)
            times.append(frame.time)
        broken_at = shown.snapshot().broken_at if scene.system.tears else None
    if broken_at is not None:
        scene = replace(scene, system=scene.system.replace(broken_at=broken_at))
    seen = framed(scene, positions, range(len(positions)), width / height)
    renderer = Renderer(scene, seen, resolution=resolution, coloring=coloring)

    def images() -> Iterator[NDArray[np.uint8]]:
        for k, (position, time) in enumerate(zip(positions, times, strict=True)):
            progress("drawing", k, len(times))
            yield renderer.image(position, float(time))

    with tempfile.TemporaryDirectory() as folder:
        path = write_film(images(), Path(folder), name="film", fps=fps, frames="none")
        assert path is not None
        film = base64.b64encode(path.read_bytes()).decode()
    bar.update(display.HTML(f'<img src="data:image/webp;base64,{film}">'))


def _still(scene: Scene, position: NDArray, time: float, resolution: tuple[int, int], coloring: str | None) -> str:
    """Return the page of a still, as HTML."""
    views = []
    for k in range(VIEWS):
        look = scene.look.views[0]
        turned = replace(scene, look=replace(look, azimuth=(look.azimuth + 360.0 * k / VIEWS) % 360.0))
        image = Renderer(turned, position, resolution=resolution, coloring=coloring).image(position, time)
        file = io.BytesIO()
        Image.fromarray(image).save(file, "webp", quality=80)
        views.append(base64.b64encode(file.getvalue()).decode())
    name, listed = f"still-{id(views)}", ", ".join(f'"{view}"' for view in views)
    return TURNED.format(name=name, first=views[0], views=listed, width=resolution[0])
