"""Draw a trajectory: single frames, a film, and several poses in one picture."""

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.progress import Progress

from ...disk import writing
from ...files import Trajectory
from ...pictures import (
    Camera,
    Renderer,
    exposure,
    framed,
    timelapse,
    visible,
    write_film,
)
from ...world import Scene
from ..picture_options import Pictures, parse_resolution
from ..process import stop_requests
from ..results import overlay_path, pass_path, still_path
from ..signals import Interrupted, word
from .moments import Moment, Moments, exposed
from .passes import PassFiles
from .quantities import arrows, dressed

SMOOTH, BLURRED = 64, 8
"""Number of pictures whose mean is a still, and a picture of a film with motion blur."""
SCATTERED = 4.0
"""The start is small if the camera that sees all is so many times as far away as one that sees the start: it fills
a quarter of the picture's width then. Of the built-in scenes with several bodies none reaches 2.5."""


def draw(
    scene: Scene,
    trajectory: Trajectory,
    folder: Path,
    name: str,
    pictures: Pictures,
    progress: Progress,
    *,
    shown: Sequence[int] | None = None,
    moments: Sequence[float] | None = None,
    fps: float | None = None,
    device: str | None = None,
    still_at: float | None = None,
    replaced: Sequence[Path] = (),
) -> str:
    """Draw the frames `shown` of a trajectory, by default all, into a folder; return a line about the pictures.

    The film and its frames show `moments`, numbers of frames or fractions between them, by default the frames.
    `name` is the film's name, `fps` its pictures per second (by default the trajectory's), and `device` is for the
    ray caster. At `still_at` [s] one picture is drawn from many. Pictures in `replaced` are removed
    before the first is drawn. Raise Interrupted after a signal, between two pictures, and never while VTK is
    imported, which would crash.
    """
    with stop_requests(progress.console) as requests:
        began = time.perf_counter()
        shown = range(len(trajectory)) if shown is None else shown
        moments = shown if moments is None else moments
        fps, count = trajectory.fps if fps is None else fps, len(moments)
        scene, coloring, values = dressed(scene, trajectory, pictures, shown)
        size = parse_resolution(pictures.resolution)
        aspect, still_scene = size[0] / size[1], scene
        scene, seen = framed(scene, trajectory.positions, trajectory.times, shown, aspect)
        forces, longest = arrows(trajectory, shown) if pictures.arrows else (None, None)
        how = {"coloring": coloring, "zoom": pictures.zoom, "arrows": longest, "backend": pictures.renderer}
        how |= {"bodies": pictures.body, "transparent": pictures.transparent}
        renderer = Renderer(scene, seen, resolution=size, device=device, **how)
        _raise_if_stopped(requests)
        for picture in replaced:  # not earlier: the file may lack what colors or arrows show
            picture.unlink()
        positions, times, drawn, results = trajectory.positions, trajectory.times, [], []
        run, open_for = Moments(trajectory, values, forces), 0.0
        if pictures.shutter and count > 1:
            open_for = pictures.shutter * (moments[1] - moments[0])
        files = PassFiles(scene, coloring, renderer.stage, pictures, folder) if pictures.passes else None
        if files is not None or not pictures.frames == pictures.video == "none":

            def images() -> Iterator[NDArray]:
                for k, moment in enumerate(progress.track(moments, count, description="drawing")):
                    _raise_if_stopped(requests)
                    if files is not None:
                        files.write(k, run.at(moment))
                    if open_for:
                        through = exposed(moment, open_for, pictures.samples or BLURRED, shown)
                        yield exposure(renderer, map(run.at, through))
                    else:
                        yield renderer.image(*run.at(moment))

            formats = {"frames": pictures.frames, "video": pictures.video}
            path = write_film(images(), folder, name=name, fps=fps, **formats)
            drawn.append(f"{count} frame{'s' if count > 1 else ''}")
            if pictures.frames == "png":
                others = f" ... frame_{count - 1:04d}.png" if count > 1 else ""
                results.append(f"{folder / 'frame_0000.png'}{others}")
            for kind in pictures.passes:
                results.append(f"{pass_path(folder, kind, 0)} ...")
            if path is not None:
                results.append(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
        if still_at is not None:
            k = shown[int(np.abs(np.asarray(times[shown]) - still_at).argmin())]

            samples, path = pictures.samples or SMOOTH, still_path(folder, name)

            def same() -> Iterator[Moment]:
                for _ in progress.track(range(samples), description="drawing"):
                    _raise_if_stopped(requests)
                    yield run.at(k)

            _save(path, exposure(renderer, same()))
            drawn.append(f"the frame at {times[k]:.4g} s from {samples} sample{'s' if samples > 1 else ''}")
            results.append(str(path))
        if pictures.overlay is not None:
            chosen = np.array(shown)[
                np.unique(np.linspace(0, len(shown) - 1, pictures.overlay).round().astype(int))
            ]
            path = overlay_path(folder, name)
            all_values = None if values is None else np.array([values(k) for k in chosen])
            _raise_if_stopped(requests)
            if scene is not still_scene:  # one camera sees all poses
                renderer = Renderer(still_scene, seen, resolution=size, device=device, **how)
            _save(path, timelapse(renderer, positions[chosen], times[chosen], all_values))
            drawn.append(f"an overlay of {len(chosen)} poses")
            results.append(str(path))
        seconds = time.perf_counter() - began
        closer = closer_view(scene, positions[shown[0]], positions[shown[-1]], seen, aspect)
        return f"drew {' and '.join(drawn)} in {seconds:.2f} s: " + " and ".join(results) + closer


def _save(path: Path, picture: NDArray) -> None:
    with writing(path) as unfinished:
        Image.fromarray(picture).save(unfinished)


def closer_view(scene: Scene, start: NDArray, end: NDArray, seen: NDArray, aspect: float) -> str:
    """Return a line with flags for a camera near the start, if bodies scatter so far that they look small there.

    Return nothing otherwise. `start` and `end` are the first and the last positions, `seen` those that the camera
    keeps in view [m], shape [any, d]. `aspect` is the picture's width over its height.
    """
    look = scene.look
    if look.distance is not None or look.follow is not None or look.path:
        return ""
    near, *far = (Camera.that_sees(visible(scene, x), look, aspect) for x in (start, end, seen))
    distance = near.distance
    if min(one.distance for one in far) < SCATTERED * distance:  # the view may also be of where one body goes
        return ""
    target = np.round(near.target, 1 - math.floor(math.log10(distance))) + 0.0  # + 0.0: no -0
    flags = f"--target {','.join(f'{x:g}' for x in target)} --distance {distance:.2g}"
    width = np.ptp(seen, axis=0).max()
    return f"\nbodies scatter over {width:.2g} m; `msdwarp render` shows where they start with {flags}"


def _raise_if_stopped(requests: list[int]) -> None:
    if requests:
        raise Interrupted(f"{word(requests[0])} while drawing", requests[0])
