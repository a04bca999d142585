"""Pieces: sets of particles joined by connections."""

import numpy as np
from numpy.typing import NDArray

_BLOCK = 1 << 20  # connections per step: most later ones join particles that are already in one piece


def pieces(particle_count: int, connections: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the lowest particle index in each particle's piece, shape [particle_count].

    Every particle points to the lowest known particle of its piece. If a connection joins two pieces, the higher
    of their two lowest particles is made to point to the lower.
    """
    lowest = np.arange(particle_count, dtype=np.int32)
    for start in range(0, len(connections), _BLOCK):
        first, second = lowest[connections[start : start + _BLOCK].T]
        while (apart := first != second).any():
            first, second = first[apart], second[apart]
            low, high = np.minimum(first, second), np.maximum(first, second)
            lowest[high] = low  # of several writes any may win: pointers only go down, so they form no loops
            while not np.array_equal(further := lowest[lowest], lowest):
                lowest = further
            first, second = lowest[low], lowest[high]
    return lowest
