"""Tracks: what a frame keeps and tells, so that the next one can be launched before it is judged."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from ..engine import Assembly, Backup, Effect, Found, State

_ASKED = ("energies_and_powers", "is_void", "warnings")
"""What the host asks effects about the present state, or the frame that was advanced by last."""


class Track:
    """What a frame keeps and tells. Of two that follow each other closely each has a track of its own."""

    def __init__(self, assembly: Assembly, state: State, others: Sequence[wp.array] = ()) -> None:
        self.backup = Backup(assembly, state, others)  # the state where the frame began
        self.found = Found(state.model)  # what is told of the state where it ends
        self.graphs: dict[bool, Any] = {}  # the frame as it was recorded, by whether it tells its balance
        self.tells = False  # whether the frame that was launched last does


class Tracks:
    """The tracks of a run, two at most: of frames before which none was launched ahead it is the `first`.

    `now` is that of the frame that was advanced by last; `ahead` that of the next one, if it has been launched.
    """

    def __init__(self, assembly: Assembly, state: State, others: Sequence[wp.array] = ()) -> None:
        self._assembly, self._state, self._second = assembly, state, list[Track]()
        self.first = self.now = Track(assembly, state, others)
        self.ahead: Track | None = None

    def go_on(self) -> bool:
        """Go on to the next frame; return whether it has been launched already."""
        launched = self.ahead is not None
        self.now, self.ahead = self.ahead or self.first, None
        return launched

    def other(self) -> Track:
        """Return the track for a frame behind the present one."""
        if not self._second:
            self._second.append(Track(self._assembly, self._state))
        return self._second[0] if self.now is self.first else self.first

    def forget_graphs(self) -> None:
        """Have frames recorded anew."""
        for track in (self.first, *self._second):
            track.graphs.clear()


def tells_all(assembly: Assembly, *looks: Any) -> bool:
    """Tell whether frames are judged by what they tell alone: no effect, and none of `looks`, is asked more."""
    asked = (getattr(type(one), name) is not getattr(Effect, name) for one in assembly.all for name in _ASKED)
    return not any(asked) and all(one is None for one in looks)
