"""Entries sorted by particle, as in a sparse matrix in CSR format."""

import numpy as np
from numpy.typing import NDArray


def rows(particle: NDArray[np.integer], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (order, first): entries sorted by particle, and the start of each particle's entries.

    Entries keep their order within a particle. Particle i has the entries order[first[i]] to
    order[first[i + 1] − 1]; `first` has shape [count + 1].
    """
    first = np.append(0, np.cumsum(np.bincount(particle, minlength=count)))
    return np.argsort(particle, kind="stable"), first
