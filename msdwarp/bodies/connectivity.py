"""Pieces: what hangs together by connections."""

import numpy as np
from numpy.typing import NDArray

_BLOCK = 1 << 20  # connections that are looked at together: most of the later ones join what is joined already


def pieces(particle_count: int, connections: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the lowest particle of the piece that each is in, shape [particle_count].

    Every particle points to the lowest that it is known to be joined with. Where connections lead from one such
    lowest to another, the higher is made to point to the lower, and all that point to it follow.
    """
    lowest = np.arange(particle_count, dtype=np.int32)
    for start in range(0, len(connections), _BLOCK):
        first, second = lowest[connections[start : start + _BLOCK].T]
        while (apart := first != second).any():
            first, second = first[apart], second[apart]
            low, high = np.minimum(first, second), np.maximum(first, second)
            lowest[high] = low  # of several, any will do: always downwards, so that nothing goes round
            while not np.array_equal(further := lowest[lowest], lowest):
                lowest = further
            first, second = lowest[low], lowest[high]
    return lowest
