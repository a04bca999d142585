"""Tracks: memory for two frames, so that the next frame can be launched before the current one is checked."""

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from ..engine import Assembly, Backup, Effect, Found, State, Velocities

_READ_AFTER_FRAME = ("energies_and_powers", "is_void")
"""Methods of effects with which the host reads the current state or the last frame."""

LONG = 5.0
"""A frame that takes so long, as it is repeated or refined, is warned of [s]."""


class Track:
    """Data of a frame: backup, sums and recorded graphs. Consecutive frames alternate between two tracks."""

    def __init__(
        self, assembly: Assembly, state: State, velocities: Velocities, others: Sequence[wp.array] = ()
    ) -> None:
        self._velocities, self._given = velocities, None
        self.backup = Backup(assembly, state, others)  # a copy of the state at the frame's start
        self.found = Found(state.model)  # sums over the state at the frame's end
        # Replay graphs, by whether they sum the energy balance, by search intervals, and by threads and substeps:
        self.graphs: dict[tuple, Callable[[], None]] = {}
        self.sums_balance = False  # whether the last launched frame did
        self.time: float | None = None  # when the last launched frame began [s]; None once it is undone

    def keep(self) -> None:
        """Keep the present state, outside of a frame."""
        self.backup.save()
        self._given = self._velocities.kept()

    def leave(self) -> None:
        """Keep what velocities are given now; the frame to be launched keeps the state."""
        self._given, self._velocities.given = self._velocities.kept(), False

    def restore(self) -> None:
        """Restore the state at the frame's start."""
        self.backup.restore()
        self._velocities.give(self._given)
        self.time = None


class Tracks:
    """The tracks of a run. Frames that are not launched ahead use the track `first`.

    `current` is the track of the last frame; `ahead` is the next frame's track, if it has been launched.
    """

    def __init__(self, *data: Any, others: Sequence[wp.array] = ()) -> None:
        self._data, self._second = data, list[Track]()
        self.first = self.current = Track(*data, others=others)
        self.ahead: Track | None = None

    def advance(self) -> bool:
        """Go to the next frame; return whether it has been launched."""
        launched = self.ahead is not None
        self.current, self.ahead = self.ahead or self.first, None
        return launched

    def other(self) -> Track:
        """Return the track of the frame after the current one."""
        if not self._second:
            self._second.append(Track(*self._data))
        return self._second[0] if self.current is self.first else self.first

    def forget_graphs(self) -> None:
        """Drop all recorded graphs."""
        for track in (self.first, *self._second):
            track.graphs.clear()


def can_judge_late(assembly: Assembly, *measurements: Any) -> bool:
    """Return whether the host tests a frame by `Found` alone, so that the next frame can be launched first."""
    kinds = {type(one) for one in assembly.all}
    read = (getattr(kind, name) is not getattr(Effect, name) for kind in kinds for name in _READ_AFTER_FRAME)
    return not any(read) and all(one is None for one in measurements)
