"""Room for the lists of contact, whose lengths are known only while they are made."""

import math
from typing import Any

from ... import checks

ROOM_TO_SPARE = 0.8
"""Fraction of the room that may be in use before it grows."""
MOST_ROOM = 2**30
"""Maximal number of entries of a list: threads count them in int32, and count on where there is no room."""
QUICKLY = 2**18
"""Up to this number of entries lists of pairs grow by a factor of 4, else of 2: a frame is repeated each time."""


def room_for(many: int) -> int:
    """Return how many entries to allocate for `many` entries: a power of 2, with some to spare."""
    return 1 << max(math.ceil(many / ROOM_TO_SPARE) - 1, 0).bit_length()


def room_for_pairs(many: int) -> int:
    """Return how many entries to allocate where `many` were too many: most pairs are far apart, more are rare."""
    return (4 if many <= QUICKLY else 2) * many


def check_room(found: str, entries: int, size: int, device: Any) -> None:
    """Raise MemoryError if a list has no room for so many entries of `size` bytes; `found` says of what."""
    needed, fits = entries * size, entries <= MOST_ROOM
    if fits and needed < 1e8:  # looking how much is free would take longer than allocating
        return
    free = device.free_memory if device.is_cuda else checks.free_memory()
    if fits and (free is None or needed < free):
        return
    least = "" if free is None else f" of {free / 1e9:.3g} GB that are free"
    raise MemoryError(
        f"{found}: {entries} entries of a list would take {needed / 1e9:.3g} GB{least}; there can be at most "
        f"{MOST_ROOM} entries; surfaces must be coarser, slower or further apart, or Contact(thickness=...) less"
    )
