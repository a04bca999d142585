"""Series: what a probe told over time."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Series(NamedTuple):
    """What one probe has told, frame by frame or substep by substep."""

    times: NDArray[np.float64]
    """When frames, or substeps, ended [s], shape [reading_count]."""
    values: NDArray[np.float64]
    """What it told then, in SI units, shape [reading_count, d]; of strain two columns, mean and largest."""
