"""Numbers as text."""

import numpy as np
from numpy.typing import NDArray

from .uniform import stored


def counted(count: int, what: str) -> str:
    """Return so many of something, such as "1 particle"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def span(values: NDArray[np.float64]) -> str:
    """Return the least and the greatest of some numbers, or the one that all are."""
    least, most = (float(of(stored(values))) for of in (np.min, np.max))
    return f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
