"""Entries sorted by particle, as in a sparse matrix in CSR format."""

import numpy as np
from numpy.typing import NDArray


def rows(particle: NDArray[np.integer], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (order, first): entries sorted by the particle of each, and where those of each particle begin.

    Entries keep their order within a particle. Those of particle i are order[first[i]] to order[first[i + 1] − 1];
    `first` has shape [count + 1].
    """
    first = np.append(0, np.cumsum(np.bincount(particle, minlength=count)))
    return np.argsort(particle, kind="stable"), first
