"""Arrays of another library among the arguments of a simulation, by which it is differentiated."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import System
from ..simulation import GRADIENT_NAMES, Differentiated, Frames, Simulation

ARRAYS = tuple(name for name in GRADIENT_NAMES if name != "strain")


def split_arrays(system: System, options: dict[str, Any], kind: Any) -> tuple[list[str], list[Any]]:
    """Remove arrays of a kind, a type or several, from `options`; return their names and themselves.

    Raises ValueError if gravity is no vector.
    """
    names = [name for name in ARRAYS if isinstance(options.get(name), kind)]
    arrays = [options.pop(name) for name in names]
    for name, one in zip(names, arrays, strict=True):
        if name == "gravity" and tuple(one.shape) != (system.dim,):
            raise ValueError(
                f"gravity has shape {tuple(one.shape)}; it must be a vector, of shape ({system.dim},)"
            )
    return names, arrays


def differentiated(
    system: System, frames: int, values: Mapping[str, NDArray], options: Mapping[str, Any]
) -> tuple[Differentiated, Frames]:
    """Take frames of a system with other values, which can be led back; see `Simulation` for `options`."""
    names: Sequence[str] = list(values)
    own: dict[str, Any] = {name: np.asarray(one, dtype=np.float64) for name, one in values.items()}
    around: dict[str, Any] = {"gravity": own.pop("gravity")} if "gravity" in own else {}
    return Simulation(system.replace(**own), **options, **around).differentiated(frames, names)
