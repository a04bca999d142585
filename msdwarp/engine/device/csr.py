"""Rows: what several of a kind are to each particle, as kernels find it: particle by particle."""

import numpy as np
from numpy.typing import NDArray


def rows(particle: NDArray[np.integer], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how entries are sorted by their particles, and where those of each begin.

    Parameters
    ----------
    particle
        The particle of each entry, shape [entry_count].
    count
        Number of particles.

    Returns
    -------
    order, first
        The entries, particle by particle and of each in the order given, shape [entry_count]; those of particle i
        are order[first[i]] to order[first[i + 1] − 1], shape [count + 1].
    """
    first = np.append(0, np.cumsum(np.bincount(particle, minlength=count)))
    return np.argsort(particle, kind="stable"), first
