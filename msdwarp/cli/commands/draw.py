"""Draw a trajectory: single frames, a film, and several poses in one picture."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.progress import Progress

from ...bodies import lengths, stress, von_mises
from ...disk import writing
from ...files import FrameArray, Trajectory
from ...pictures import (
    Camera,
    ColorScale,
    Renderer,
    exposure,
    framed,
    timelapse,
    visible,
    write_film,
)
from ...studies import particle_energies, system_in
from ...world import Scene
from ..options import Pictures, parse_resolution
from ..process import stop_requests
from ..results import overlay_path, still_path
from ..signals import Interrupted, word
from .moments import Moment, Moments, exposed

Values = Callable[[int], NDArray[np.float64]]
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
        seen = framed(scene, trajectory.positions, shown, size[0] / size[1])
        forces, longest = _arrows(trajectory, shown) if pictures.arrows else (None, None)
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
        if not pictures.frames == pictures.video == "none":

            def images() -> Iterator[NDArray]:
                for moment in progress.track(moments, count, description="drawing"):
                    _raise_if_stopped(requests)
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
            _save(path, timelapse(renderer, positions[chosen], times[chosen], all_values))
            drawn.append(f"an overlay of {len(chosen)} poses")
            results.append(str(path))
        seconds = time.perf_counter() - began
        closer = closer_view(scene, positions[shown[0]], positions[shown[-1]], seen, size[0] / size[1])
        return f"drew {' and '.join(drawn)} in {seconds:.2f} s: " + " and ".join(results) + closer


def _save(path: Path, picture: NDArray) -> None:
    with writing(path) as unfinished:
        Image.fromarray(picture).save(unfinished)


def closer_view(scene: Scene, start: NDArray, end: NDArray, seen: NDArray, aspect: float) -> str:
    """Return a line with the camera's flags for the start, if bodies scatter so that it is small; else nothing.

    `start` and `end` are the positions then, `seen` those that the camera keeps in view [m], shape [any, d].
    `aspect` is the picture's width over its height.
    """
    look = scene.look
    if look.distance is not None or look.follow is not None or look.path:
        return ""
    near, *far = (Camera.that_sees(visible(scene, x), look, aspect) for x in (start, end, seen))
    distance, *wide = (float(np.linalg.norm(one.eye - one.target)) for one in (near, *far))
    if min(wide) < SCATTERED * distance:  # the view may also be of where one body goes
        return ""
    target = np.round(near.target, 1 - math.floor(math.log10(distance))) + 0.0  # + 0.0: no -0
    flags = f"--target {','.join(f'{x:g}' for x in target)} --distance {distance:.2g}"
    width = np.ptp(seen, axis=0).max()
    return f"\nbodies scatter over {width:.2g} m; `msdwarp render` shows where they start with {flags}"


def dressed(
    scene: Scene, trajectory: Trajectory, pictures: Pictures, shown: Sequence[int]
) -> tuple[Scene, str | ColorScale, Values | None]:
    """Return the scene as pictures show it: torn, and with their camera; and `_coloring`."""
    look = pictures.aimed(scene.look)
    look = look if pictures.floor is None else replace(look, floor=pictures.floor)
    if scene.system.tears:
        scene = replace(scene, system=scene.system.replace(broken_at=trajectory.broken_at))
    color = pictures.color or ("strain" if look.strain else "texture")
    if color == "strain":
        look = replace(look, full_strain=_full_strain(scene, trajectory, pictures, shown))
    scene = replace(scene, look=look)
    return scene, *_coloring(scene, trajectory, color, shown)


def _raise_if_stopped(requests: list[int]) -> None:
    if requests:
        raise Interrupted(f"{word(requests[0])} while drawing", requests[0])


def _coloring(
    scene: Scene, trajectory: Trajectory, color: str, shown: Sequence[int]
) -> tuple[str | ColorScale, Values | None]:
    """Return (coloring of the body, function (k) -> particles' values in frame k); None if it has no values.

    The scale ends at the largest 99th percentile of a frame.
    """
    if color not in _QUANTITIES:
        return color, None
    label, values_of = _QUANTITIES[color]
    values = partial(values_of, scene, trajectory)
    largest = max(float(np.quantile(values(k), 0.99)) for k in shown)
    return ColorScale(label, round_up(largest)), values


def _full_strain(scene: Scene, trajectory: Trajectory, pictures: Pictures, shown: Sequence[int]) -> float:
    """Return the strain at the scale's ends: the given one, or the 99th percentile over springs and frames.

    If there are many springs and frames, only some are evaluated.
    """
    if (given := pictures.full_strain or scene.look.full_strain) is not None:
        return given
    system = scene.system
    some = slice(None, None, max(1, system.connection_count // 5000))
    pairs, rest_length = system.connections[some], system.rest_length[some]
    sizes = []
    for k in list(shown)[:: max(1, len(shown) // 100)]:
        strain = np.abs(lengths(trajectory.positions[k].astype(np.float64), pairs) / rest_length - 1)
        # Broken springs are not drawn.
        sizes.append(strain[system.broken_at[some] > trajectory.times[k]] if system.tears else strain)
    return round_up(float(np.quantile(np.concatenate(sizes), 0.99)) if sizes else 0.0)


def _arrows(trajectory: Trajectory, shown: Sequence[int]) -> tuple[FrameArray, float]:
    """Return (contact forces in the frames, force of the longest arrow [N]).

    This force is the median over frames of the 90th percentile. Relative to a short impact's force, all other
    arrows would be invisibly short.
    """
    forces, large = trajectory.contact_forces, list[float]()
    for k in shown:
        sizes = _lengths(forces[k])
        if sizes.any():
            large.append(float(np.quantile(sizes[sizes > 0], 0.9)))
    return forces, round_up(float(np.median(large)) if large else 0.0)


def _lengths(vectors: NDArray) -> NDArray[np.float64]:
    return np.linalg.norm(vectors.astype(np.float64), axis=1)


_QUANTITIES: dict[str, tuple[str, Callable[[Scene, Trajectory, int], NDArray[np.float64]]]] = {
    "velocity": ("speed [m/s]", lambda scene, trajectory, k: _lengths(trajectory.velocities[k])),
    "energy": (
        "energy of a particle and half its connections [J]",
        lambda scene, trajectory, k: particle_energies(system_in(trajectory, k, scene.schedule)),
    ),
    "stress": (
        "von Mises stress [Pa]",
        lambda scene, trajectory, k: von_mises(stress(system_in(trajectory, k, scene.schedule))),
    ),
    "contact": (
        "contact force on a particle [N]",
        lambda scene, trajectory, k: _lengths(trajectory.contact_forces[k]),
    ),
}
"""Quantities of particles that colors can show, by name: the label, and a function for the values in a frame."""


def round_up(value: float) -> float:
    """Return a value rounded up to one or two digits; 1 if it is not above 0."""
    if value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value * (1 - 1e-9))
