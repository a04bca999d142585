"""Framing: which positions the camera of a film keeps in view, and when it follows the bodies."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies import in_space, pieces
from ..world import Look, Scene, Viewpoint
from .stage import Camera, outermost

FAR, FAR_OF_TWO = 4.0, 10.0
"""A body is a straggler if it gets further from the middle than this many times the median over all bodies, and
than this many times as far as it was in the first frame. Of two bodies the nearer one takes the median's place."""
TRAVELS = 3.0
"""The camera follows if it would otherwise be so many times as far away as one that sees any single frame. Of the
built-in scenes `robot` reaches 5, all others at most 2.1."""
AWAY = 1.2
"""Distance of a camera that follows, over the least one at which the bodies are in view in all frames."""
EVEN_OUT, FRACTION = 0.3, 0.05
"""Standard deviation of the times over which the path of such a camera is a mean [s], and the largest one as a
fraction of the whole time. Two viewpoints lie within it."""


def framed(
    scene: Scene, positions: Any, times: ArrayLike, chosen: Sequence[int], aspect: float
) -> tuple[Scene, NDArray]:
    """Return the scene, with a camera that follows bodies that travel, and the positions [m] that it sees.

    These are the outermost in the chosen frames, shape [any, d]. A body, or a piece that has torn off, that goes
    far away from the others counts only while it is near them, and in the first frame. `positions` have the
    shape [frame_count, particle_count, d], and may be on disk; `times` are those of the frames [s]; `aspect` is
    the picture's width over its height.
    """
    system = scene.system
    whole = system.connections[~system.broken]
    body = np.unique(pieces(system.particle_count, whole), return_inverse=True)[1]
    order = np.argsort(body, kind="stable")
    first = np.searchsorted(body[order], np.arange(body.max() + 1))
    found, reach, middle = [], np.zeros((len(chosen), len(first))), None
    for k, frame in enumerate(chosen):
        x = np.asarray(positions[frame])
        found.append(outermost(x, scene.look, aspect))
        if middle is None:
            middle = np.median(np.add.reduceat(x[order], first) / np.bincount(body)[:, None], axis=0)
        reach[k] = np.maximum.reduceat(np.linalg.norm(x - middle, axis=1)[order], first)
    furthest = reach.max(axis=0)
    others, far = (np.median(furthest), FAR) if len(first) > 2 else (furthest.min(), FAR_OF_TWO)
    strays = furthest > far * np.maximum(others, reach[0])
    look = following(scene.look, found, np.asarray(times)[chosen], aspect)
    if look is not scene.look:
        return replace(scene, look=look), np.concatenate(found)
    if scene.look.follow is not None or not strays.any():
        return scene, np.concatenate(found)
    gone = strays & (reach > furthest[~strays].max())
    gone[0] = False
    for k in np.flatnonzero(gone.any(axis=1)).tolist():
        found[k] = outermost(np.asarray(positions[chosen[k]])[~gone[k][body]], scene.look, aspect)
    return scene, np.concatenate(found)


def following(look: Look, outermost: Sequence[NDArray], times: NDArray, aspect: float) -> Look:
    """Return a look whose camera follows the bodies along a path, or the look itself.

    It is the look itself if it aims the camera, or the bodies do not travel (TRAVELS). `outermost` are the
    outermost particles of frames [m], shape [any, d] each, `times` those of the frames [s].
    """
    if look.path or look.follow is not None or (look.target, look.distance) != (None, None):
        return look
    if len(times) < 2 or np.diff(times).min() <= 0:
        return look
    frames = [in_space(one, np.float64) for one in outermost]
    near = max(Camera.that_sees(one, look, aspect).distance for one in frames)
    if Camera.that_sees(np.concatenate(frames), look, aspect).distance < TRAVELS * near:
        return look
    low, high = (np.array([end(one, axis=0) for one in frames]) for end in (np.min, np.max))
    middle, size = (low + high) / 2, (high - low).max(axis=0)
    # Where the body moves to and fro by less than its size, the camera stands still.
    rests = np.ptp(middle, axis=0) <= size
    middle[:, rests] = (middle[:, rests].min(axis=0) + middle[:, rests].max(axis=0)) / 2
    passed, last = float(times[-1] - times[0]), len(times) - 1
    wide = min(EVEN_OUT, FRACTION * passed) / passed * last  # in frames
    step, reach = max(1, round(wide / 2)), int(3 * wide)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / wide) ** 2)
    # One viewpoint before the first frame and one behind the last: the camera would be at rest there.
    beyond: Any = {"mode": "reflect", "reflect_type": "odd"}
    around = np.pad(middle, ((reach + step, reach + 2 * step), (0, 0)), **beyond)
    moments = np.pad(np.asarray(times, dtype=float), (step, 2 * step), **beyond)
    path = np.stack([np.convolve(one, weight / weight.sum(), "valid") for one in around.T], axis=1)
    camera, targets = Camera.that_sees(frames[0], look, aspect), path[step : step + last + 1]
    distance = AWAY * max(
        camera.aimed(target, None, points, aspect).distance for target, points in zip(targets, frames, strict=True)
    )
    seen_from = [
        Viewpoint(time=float(moments[k]), target=tuple(path[k].tolist()))
        for k in range(0, last + 2 * step + 1, step)
    ]
    return replace(look, distance=distance, path=seen_from)
