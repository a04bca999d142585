"""Stored tapes: the states of all substeps of a run, if they fit into device memory."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from .tape import Tape

LEAST_AHEAD = 100_000
"""Number of particles from which on a copy takes longer than the host needs to launch it aside (on an H200)."""


class StoredTapes:
    """The tapes of all frames, and the copies of them that recorded launches read.

    For a large body there are two copies: while a GPU reads that of one frame, it fills the other with the frame
    before. A method that repeats the stages of a substep on `tape` reads them there.

    Parameters
    ----------
    tape
        The tape on which each frame is simulated.
    frames
        Number of frames.
    ahead
        Whether the states may be read elsewhere than on `tape`.
    """

    def __init__(self, tape: Tape, frames: int, *, ahead: bool) -> None:
        self._tape, model = tape, tape.state.model
        self._stored = [wp.empty_like(tape.storage) for _ in range(frames)]
        large = ahead and model.device.is_cuda and model.worlds * model.stride >= LEAST_AHEAD
        self._aside = wp.Stream(model.device) if large else None
        self._copies = [tape.another(), tape.another()] if large else [(tape.storage, tape.states)]
        self._filled: dict[int, Any] = {}
        """The frames that copies have or get, each with the event after which it is there."""

    def store(self, k: int) -> None:
        """Store frame k, which is on the tape."""
        while self._filled:  # copies that have not been read
            wp.get_stream(self._tape.storage.device).wait_event(self._filled.popitem()[1])
        wp.copy(self._stored[k], self._tape.storage)

    def read(self, k: int) -> tuple[int, Sequence[Any]]:
        """Return the number of the copy that has frame k, and its states; copy the frame before it meanwhile.

        Call it before the launches that read these states, from the last frame to the first.
        """
        which = k % len(self._copies)
        if self._aside is None:
            wp.copy(self._copies[which][0], self._stored[k])
        else:
            stream = wp.get_stream(self._aside.device)
            for frame in (k, k - 1):  # launches before this call may still read what they replace
                if frame >= 0 and frame not in self._filled:
                    self._aside.wait_event(stream.record_event())
                    with wp.ScopedStream(self._aside, sync_enter=False):
                        wp.copy(self._copies[frame % 2][0], self._stored[frame])
                    self._filled[frame] = self._aside.record_event()
            stream.wait_event(self._filled.pop(k))
        return which, self._copies[which][1]
