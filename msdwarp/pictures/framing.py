"""Framing: which positions the camera of a film keeps in view."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import pieces
from ..world import Scene
from .stage import outermost

FAR = 4.0
"""A body is a straggler if it gets further from the middle than this many times the median over all bodies, and
than this many times as far as it was in the first frame."""


def framed(scene: Scene, positions: Any, chosen: Sequence[int], aspect: float) -> NDArray:
    """Return the positions that the camera keeps in view [m], shape [any, d]: the outermost in the chosen frames.

    If there are three bodies or more, a body that goes far away from the others counts only while it is near them,
    and in the first frame. `positions` have the shape [frame_count, particle_count, d], and may be on disk;
    `aspect` is the picture's width over its height.
    """
    body = np.unique(pieces(scene.system.particle_count, scene.system.connections), return_inverse=True)[1]
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
    strays = furthest > FAR * np.maximum(np.median(furthest), reach[0])
    if len(first) < 3 or scene.look.follow is not None or not strays.any():
        return np.concatenate(found)
    gone = strays & (reach > furthest[~strays].max())
    gone[0] = False
    for k in np.flatnonzero(gone.any(axis=1)).tolist():
        found[k] = outermost(np.asarray(positions[chosen[k]])[~gone[k][body]], scene.look, aspect)
    return np.concatenate(found)
