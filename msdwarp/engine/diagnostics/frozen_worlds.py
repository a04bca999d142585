"""FrozenWorlds: puts diverged worlds of an ensemble back to the start of their last frame, where they stay."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions import RUNNING, judge, put_back
from ..device.device import view_of
from ..stepping.assemble import Assembly
from .divergence_monitor import Backup, DivergenceMonitor
from .readout import Found

LEAST_THREADS, MOST_THREADS = 8, 2**20
"""On a GPU, least number of threads that restore a world, and most for all worlds: most have nothing to do."""


class WorldStatus(NamedTuple):
    """The status of each world, arrays of shape [worlds]."""

    status: NDArray[np.int32]
    """0 while it runs, 1 if a number is no longer finite, 2 if its energy exceeded the limit and the work done."""
    good_frames: NDArray[np.int32]
    """Frames until it diverged; −1 while it runs."""
    particle: NDArray[np.int32]
    """The first particle that was no longer finite; −1 if all are finite."""


class FrozenWorlds:
    """Judges each world at a frame's end, entirely on the device, by the sums of a `DivergenceMonitor`.

    The status of each world is in `frozen`, the launcher's own array (`Dynamics.frozen`).
    """

    def __init__(self, assembly: Assembly, watch: DivergenceMonitor, frozen: wp.array) -> None:
        model = assembly.model
        self._model, self._contact, self._frozen = model, assembly.body_contact, frozen
        before = np.zeros(model.worlds) if assembly.external_work is None else assembly.external_work.before
        limits: Any = (before, watch.most)
        self._limits = [wp.array(one, dtype=wp.float64, device=model.device) for one in limits]
        self._good_frames, self._particle = (wp.zeros_like(frozen) for _ in range(2))
        most_work = wp.zeros(model.worlds, dtype=wp.float64, device=model.device)
        self._own = [frozen, self._good_frames, self._particle, most_work]
        # Effects' arrays of frozen worlds are restored, except those of contact between bodies.
        each = (one for one in assembly.all if one.by_world and one is not self._contact)
        self._put_back = {id(array) for one in each for array in one.changing}

    @property
    def changing(self) -> list[wp.array]:
        """Arrays to restore if a frame is repeated, which only contact between bodies may require."""
        return self._own if self._contact is not None else []

    def launch(self, found: Found, backup: Backup) -> None:
        """Launch the judgement of worlds by the sums, and the restoration of those that have diverged."""
        device, worlds = self._model.device, self._model.worlds
        wp.launch(judge, worlds, [found.state_out, *self._limits], self._own, device=device)
        arrays = [*zip(backup.live(), backup.kept, strict=True)]
        arrays += [(live, kept) for live, kept in backup.changing if id(live) in self._put_back]
        most = max(MOST_THREADS // worlds, LEAST_THREADS) if device.is_cuda else 1
        for live, kept in arrays:
            if live.size:
                words = _words(live, worlds)
                threads = min(words.shape[1], most)
                inputs = [self._frozen, threads, _words(kept, worlds)]
                wp.launch(put_back, (worlds, threads), inputs, [words], device=device)

    def found(self) -> WorldStatus:
        """Return the status of each world."""
        status: Any
        status, frames, particle = (one.numpy() for one in (self._frozen, self._good_frames, self._particle))
        lost = particle < self._model.particle_count
        return WorldStatus(
            np.array(status),
            np.where(status != RUNNING, frames, -1),
            np.where((status != RUNNING) & lost, particle, -1),
        )

    def tell_contact(self) -> None:
        """Tell contact between bodies which worlds are frozen: their neighbor lists may be invalid."""
        if self._contact is not None:
            self._contact.frozen = self._frozen.numpy() != RUNNING


def _words(array: Any, worlds: int) -> wp.array:
    """Return a view of an array's memory as words of four bytes, shape [worlds, word_count]."""
    shape = (worlds, len(array) * array.strides[0] // (4 * worlds))
    return view_of(array, shape, dtype=wp.uint32)
