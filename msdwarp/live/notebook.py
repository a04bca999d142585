"""Films from Python: `film` writes one; `show` displays one, or a still that the mouse turns, in a notebook."""

import base64
import io
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from ..bodies import Frame
from ..disk import writable_folder
from ..files import Trajectory
from ..pictures import FILM_FORMATS, Renderer, check_formats, framed, picture_size, write_film
from ..simulation import Simulation
from ..world import Look, Plane, Scene
from .opening import scene_of

Progress = Callable[[str, int, int], None]
"""A function (what is done, how many frames are, of how many) that shows progress."""
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


def show(
    shown: Simulation | Scene | Trajectory | str | Path,
    *,
    duration: float | None = None,
    resolution: tuple[int, int] = (640, 360),
    coloring: str | None = None,
) -> None:
    """Show a film, or a still that you can rotate with the mouse, in a notebook.

    Parameters
    ----------
    shown
        A trajectory or its file, shown as a film; or a scene or a simulation, which is simulated and shown.
    duration
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
        raise RuntimeError(
            "show draws in a notebook, which needs IPython: pip install 'msdwarp[notebook]'"
        ) from None
    if get_ipython() is None:
        raise RuntimeError("show draws in a notebook, and here is none; msdwarp.view shows a scene in a window")
    resolution = picture_size(resolution)
    if isinstance(shown, Simulation) and duration is None:
        scene = replace(scene_of(shown)[1], system=shown.snapshot())  # without what has torn
        display.display(display.HTML(_still(scene, scene.system.position, shown.time, resolution, coloring)))
        return
    bar: Any = display.display(display.HTML(""), display_id=True)

    def progress(doing: str, done: int, count: int) -> None:
        if done % max(1, count // 50) == 0:
            bar.update(display.HTML(f'{doing} <progress max="{count}" value="{done}"></progress>'))

    with tempfile.TemporaryDirectory() as folder:
        played = _played(shown, None, duration, progress)
        path = _written(played, Path(folder) / "film.webp", None, resolution, coloring, progress)
        encoded = base64.b64encode(path.read_bytes()).decode()
    bar.update(display.HTML(f'<img src="data:image/webp;base64,{encoded}">'))


def film(
    shown: Simulation | Scene | Trajectory | str | Path | Iterable[Frame],
    path: str | Path,
    *,
    scene: Scene | None = None,
    duration: float | None = None,
    fps: float | None = None,
    resolution: tuple[int, int] = (1280, 720),
    coloring: str | None = None,
    cut: Plane | None = None,
) -> Path:
    """Write a film of frames, a trajectory, a scene or a simulation; return its path. A film there is replaced.

    `msdwarp.run` also stores the frames, and shows more by colors.

    Parameters
    ----------
    shown
        Frames, such as `list(simulation.frames(2.0))`, with their `scene`; a trajectory or its file; or a scene or
        a simulation, which is simulated.
    path
        The film: "fall.mp4", "fall.webp" or "fall.gif". MP4 needs `pip install 'msdwarp[video]'`.
    scene
        The scene of frames, whose look and obstacles are drawn.
    duration
        Simulated time [s]; for a scene by default its duration.
    fps
        Pictures a second; by default those of simulated time, for real time.
    resolution
        Width and height in pixels.
    coloring
        "texture" or "strain". Default: set by the scene's look.
    cut
        A plane that cuts the bodies, as in a `Look`. Default: set by the scene's look.

    Returns
    -------
    Path
        The path of the film.

    Raises
    ------
    ValueError
        If `shown` is invalid, `path` ends otherwise, or an argument is out of range or missing.
    OSError
        If the folder of `path` cannot be made or written to.
    """
    path = Path(path)
    checks.one_of("the end of path", path.suffix, [f".{end}" for end in FILM_FORMATS if end != "none"])
    check_formats("none", path.suffix[1:])
    if fps is not None:
        checks.positive("fps", fps)
    resolution = picture_size(resolution)
    if cut is not None:
        Look(cut=cut)  # checks it
    writable_folder("path", path.parent, path.parent)
    return _written(_played(shown, scene, duration, _silent, cut), path, fps, resolution, coloring, _silent)


def _silent(doing: str, done: int, count: int) -> None:
    """Show no progress."""


class _Played(NamedTuple):
    """What a film shows."""

    scene: Scene
    """The scene, with what has torn."""
    positions: Sequence[NDArray]
    """Positions in each frame [m], shape [particle_count, d]."""
    times: Sequence[float]
    """Times of the frames [s]."""
    fps: float
    """Frames per second of simulated time."""


def _played(
    shown: Any, scene: Scene | None, duration: float | None, progress: Progress, cut: Plane | None = None
) -> _Played:
    """Return what a film shows, simulated if need be; raise ValueError if that is nothing."""
    if duration is not None:
        checks.positive("duration", duration)
    simulates = isinstance(shown, Scene | Simulation)
    if not simulates and duration is not None:
        raise ValueError(f"duration is {duration:g}; it must be None where nothing is simulated")
    if isinstance(shown, Iterable) and not isinstance(shown, str | Trajectory):
        frames = checks.sequence("shown", shown, Frame, "simulation.frame()")
        checks.instance("scene", scene, Scene, "the one that was simulated, to draw frames")
        if not frames:
            raise ValueError("shown has no frames; there must be one at least")
        times = [frame.time for frame in frames]
        fps = (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else 60.0
        assert scene is not None
        return _Played(_cut(scene, cut), [frame.position for frame in frames], times, fps)
    if scene is not None:
        raise ValueError("scene is given; it must be None where it is known, as it is not of a list of frames")
    if isinstance(shown, Scene):
        duration, scene = shown.duration if duration is None else duration, shown
        shown = Simulation.from_scene(shown)
    else:
        shown, scene = scene_of(shown)
    scene = _cut(scene, cut)
    if isinstance(shown, Trajectory):
        if scene.system.tears:
            scene = replace(scene, system=scene.system.replace(broken_at=shown.broken_at))
        return _Played(scene, shown.positions, list(shown.times), shown.fps)  # pyright: ignore[reportArgumentType]
    if duration is None:
        raise ValueError("duration is None; a simulation keeps no frames, so it must be how long to go on [s]")
    positions, times, fps = list[NDArray](), list[float](), shown.fps
    count = max(1, round(duration * fps))
    # The first frame is the current one.
    for k, frame in zip(range(count), shown.frames(count / fps), strict=False):
        progress("simulating", k, count)
        positions.append(frame.position)
        times.append(frame.time)
    if scene.system.tears:
        scene = replace(scene, system=scene.system.replace(broken_at=shown.snapshot().broken_at))
    return _Played(scene, positions, times, fps)


def _cut(scene: Scene, plane: Plane | None) -> Scene:
    """Return a scene whose bodies a plane cuts, if one is given."""
    return scene if plane is None else replace(scene, look=replace(scene.look, cut=plane))


def _written(
    played: _Played,
    path: Path,
    fps: float | None,
    resolution: tuple[int, int],
    coloring: str | None,
    progress: Progress,
) -> Path:
    """Draw frames and write a film, whose format is the path's end; return its path."""
    scene, positions, times, own = played
    scene, seen = framed(scene, positions, times, range(len(positions)), resolution[0] / resolution[1])
    renderer = Renderer(scene, seen, resolution=resolution, coloring=coloring)

    def images() -> Iterator[NDArray[np.uint8]]:
        for k, (position, time) in enumerate(zip(positions, times, strict=True)):
            progress("drawing", k, len(times))
            yield renderer.image(position, float(time))

    how: Any = {"fps": fps or own, "frames": "none", "video": path.suffix[1:]}
    written = write_film(images(), path.parent, name=path.stem, **how)
    assert written is not None
    return written


def _still(scene: Scene, position: NDArray, time: float, resolution: tuple[int, int], coloring: str | None) -> str:
    """Return the page of a still, as HTML."""
    views = []
    for k in range(VIEWS):
        look = scene.look.views[0]
        turned = replace(scene, look=replace(look, azimuth=(look.angles()[0] + 360.0 * k / VIEWS) % 360.0))
        image = Renderer(turned, position, resolution=resolution, coloring=coloring).image(position, time)
        file = io.BytesIO()
        Image.fromarray(image).save(file, "webp", quality=80)
        views.append(base64.b64encode(file.getvalue()).decode())
    name, listed = f"still-{id(views)}", ", ".join(f'"{view}"' for view in views)
    return TURNED.format(name=name, first=views[0], views=listed, width=resolution[0])
