"""Overruns: vertices that moved further than their slack, so that a frame was repeated, get more slack."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..model.model import Model


class Overruns:
    """The least slack of vertices that have lately moved further than was foreseen, such as from rest.

    `usual` is the largest slack of fast vertices otherwise, `forgotten` a slack that all have, `largest` the
    largest of all [m].
    """

    def __init__(self, model: Model, count: int, usual: float, forgotten: float, largest: float) -> None:
        self._model, self._usual, self._forgotten, self._largest = model, usual, forgotten, largest
        self.least: Any = wp.zeros((2, count), dtype=float, device=model.device)
        """After other searches, and after one at a frame's start [m]; kernels raise it, see `place_vertices`."""
        self.started = wp.zeros(1, dtype=int, device=model.device)
        """Whether the last search was at a frame's start."""
        self.most = usual
        """How far a fast vertex may at most move before the next search, unless it is half of the skin [m]."""
        self.following = 0
        """In how many frames one after the other vertices moved further than foreseen."""
        self.any = False
        """Whether any vertex has least slack."""

    def learn(self, held: bool, factor: float, valid: NDArray[np.bool_]) -> None:
        """Note after a frame whether all vertices kept within their slack; in `valid` worlds, then see `scale`."""
        self.following = 0 if held else self.following + 1
        self.any |= not held
        self.scale(factor, valid)

    def scale(self, factor: float, valid: NDArray[np.bool_] | None = None) -> None:
        """Multiply the least slack, and forget it where it is small, and in worlds that are not `valid`."""
        if not self.any:
            return
        least = factor * self.least.numpy().reshape(2, self._model.worlds, -1)
        least[least <= self._forgotten] = 0.0
        if valid is not None:
            least[:, ~valid] = 0.0
        self.least.assign(least.reshape(2, -1))
        self.any = bool(least.any())
        most = max(self._usual, min(float(least.max()), self._largest))
        if most != self.most:
            self.most = most
            self._model.generation += 1  # launches have recorded it
