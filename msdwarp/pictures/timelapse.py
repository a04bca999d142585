"""Pictures made of several: poses of a moving body, the first faint and the last opaque; stills for print."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .renderer import Renderer, finite_array, from_premultiplied, premultiplied

FAINTEST = 0.22
"""Opacity of the first of several poses."""

STEPS = np.array([0.7548776662466927, 0.5698402909980532])
"""Shift of the camera from one sample to the next [pixels], modulo 1: any number of samples is spread evenly
(M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018)."""


def timelapse(
    renderer: Renderer,
    positions: Sequence[NDArray] | NDArray,
    times: ArrayLike,
    values: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """Return one picture of several poses, laid over each other in order, each more opaque than the previous one.

    A pose's pixels are those that differ from a picture without the body; earlier poses show through it. Shadows
    are as dark as their bodies are opaque, and fall on the ground and obstacles, not on poses. Colliders are drawn
    at the last time.

    The camera of the `renderer` should see all poses. `positions` [m] have the shape
    [pose_count, particle_count, d], and `times` [s] are those of the poses. `values` are as for `Renderer.image`,
    shape [pose_count, particle_count]. ValueError is raised if there is no pose, a pose lacks its time or the
    values that the coloring needs, or an array is not finite or not of the right shape.
    """
    count = len(positions)
    if not count:
        raise ValueError("positions has no pose; it must have at least one")
    if renderer.transparent:
        raise ValueError("renderer is transparent; for several poses in one picture it must not be")
    moments = checks.broadcast("times", times, (count,))
    checks.every("times", moments, np.isfinite(moments), "finite")
    values_of: Iterable[NDArray | None] = [None] * count
    if values is not None:
        values_of = finite_array("values", values, (count, len(positions[0])))
    opacities = np.linspace(FAINTEST, 1.0, count) if count > 1 else [1.0]
    renderer.aim(None)  # all poses are seen by one camera
    shape = (renderer.stage.height, renderer.stage.width)
    bodies, clear, light = np.zeros((*shape, 3)), np.ones((*shape, 1)), np.ones((*shape, 1))
    stage = np.zeros(())
    for position, time, own, opacity in zip(positions, moments.tolist(), values_of, opacities, strict=True):
        image, stage = renderer.bare(position, time, values=own), renderer.bare(None, time)
        shadowless = renderer.bare(position, time, shadows=False, values=own)
        color, cover = _body(shadowless, renderer.bare(None, time, shadows=False))
        bodies += opacity * cover * (color - bodies)
        clear *= 1 - opacity * cover
        # The remaining light on the ground; overlapping shadows are no darker than one.
        after, before = (each.sum(axis=2, keepdims=True, dtype=np.int32) for each in (image, stage))
        left = np.where(cover > 0, 1.0, np.minimum(after / np.maximum(before, 1), 1.0))
        light = np.minimum(light, 1 - opacity * (1 - left))
    return renderer.with_legend(np.round(bodies + clear * light * stage).astype(np.uint8))


def exposure(renderer: Renderer, moments: Iterable[tuple[NDArray, float, Any, Any]]) -> NDArray[np.uint8]:
    """Return the mean of pictures of some moments, as they come: a still if all are one, else motion blur.

    The view of each is shifted by other fractions of a pixel, at most half a pixel. A moment is (position, time,
    values, forces), the arguments of `Renderer.image`.
    """
    stage, count, total, camera = renderer.stage, 0, np.zeros(()), renderer.stage.camera
    for position, time, values, forces in moments:
        camera = stage.camera_at(time, position)
        right, up = (count + 1) * STEPS % 1 - 0.5
        renderer.look_from(camera.shifted_by_pixels(right, up, stage.height))
        total = total + premultiplied(renderer.bare(position, time, values=values, forces=forces))
        count += 1
    renderer.look_from(camera)
    return renderer.with_legend(from_premultiplied(total / count))


def _body(image: NDArray[np.uint8], stage: NDArray[np.uint8]) -> tuple[NDArray, NDArray]:
    """Return the body's color in a picture, and its opacity in each pixel, given the picture without it.

    A pixel on the body's outline is a blend of both pictures; there the body is assumed to have the color of the
    pixels beside it.
    """
    body = (image != stage).any(axis=2, keepdims=True)
    inside = _sum_around(body) == 9
    beside = _sum_around(inside)
    outline = body & ~inside & (beside > 0)
    color = np.where(outline, _sum_around(inside * image.astype(np.int32)) / np.maximum(beside, 1), image)
    whole, seen = color - stage, image - stage.astype(float)
    opacity = (whole * seen).sum(axis=2, keepdims=True) / np.maximum((whole**2).sum(axis=2, keepdims=True), 1.0)
    return color, np.where(outline, np.clip(opacity, 0.0, 1.0), body)


def _sum_around(values: NDArray) -> NDArray[np.int64]:
    """Return the sums over each pixel and its eight neighbours; the outermost pixels repeat beyond the edges."""
    rows, columns = values.shape[:2]
    framed = np.pad(values.astype(np.int32), ((1, 1), (1, 1), (0, 0)), mode="edge")
    return np.sum([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
