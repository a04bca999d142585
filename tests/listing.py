"""Neighbor lists in tests."""

import pytest

from msdwarp.engine.collision.neighbor_list import NeighborList


def search_always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make lists each time that forces are evaluated."""

    def search(self, x, v, compensation, after, begins, frame_begins) -> None:
        self.place(x, v, compensation, after, begins, begins)
        self._find(after, frame_begins)

    monkeypatch.setattr(NeighborList, "search", search)
