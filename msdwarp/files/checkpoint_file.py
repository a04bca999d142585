"""Restart files: checkpoints on disk, replaced as a whole.

`simulation/checkpoint.py` describes their contents; `load` in `names.py` verifies checksums.
"""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..disk import failure_named, replacing
from .names import load, store
from .validation import begins_as_hdf5

FORMAT = 1
_MARK = "msdwarp_restart_format"


def write_restart(path: str | Path, arrays: Mapping[str, NDArray], attributes: Mapping[str, Any]) -> None:
    """Write arrays of numbers or booleans, and JSON attributes, to a file that replaces an earlier file.

    After a crash or a power cut either the complete old or the complete new file exists. Raise ValueError for data
    that the file cannot store, and OSError if it cannot be written; the old file then stays.
    """
    import h5py

    path = Path(path)
    given = {name: np.asarray(values) for name, values in arrays.items()}
    for name, values in given.items():
        if values.dtype.kind not in "biufc":
            raise ValueError(f"arrays[{name!r}] is of type {values.dtype}; it must hold numbers or truth values")
    shapes = {name: values.shape for name, values in given.items()}
    try:
        text = json.dumps({"attributes": attributes, "shapes": shapes})
    except (TypeError, ValueError) as error:
        raise ValueError(f"attributes is {attributes!r}; it must be what JSON can hold: {error}") from error
    # HDF5 writes to memory, since it does not recover from a full disk. In the format of 2016 HDF5's own records
    # have checksums.
    image = io.BytesIO()
    with h5py.File(image, "w", libver=("v110", "v110")) as file:
        file.attrs[_MARK] = FORMAT
        store(file, "description", np.frombuffer(text.encode(), dtype=np.uint8))
        for k, values in enumerate(given.values()):  # names may contain a slash
            store(file, f"arrays/{k}", values.ravel())
    with failure_named(path), replacing(path, durable=True) as unfinished, image.getbuffer() as whole:
        unfinished.write_bytes(whole)


def read_restart(path: str | Path) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Return the arrays and attributes from a file that `write_restart` wrote.

    Raise FileNotFoundError if it is missing, ValueError if it is another file, damaged, or in another format.
    """
    import h5py

    path = Path(path)
    if not begins_as_hdf5(path):
        raise ValueError(f"{path} is no restart file: it is no HDF5 file")
    try:
        with h5py.File(path, "r", locking=False) as opened:
            file: Any = opened
            version = file.attrs.get(_MARK)
            if version == FORMAT:
                description = json.loads(load(file["description"]).tobytes())
                shapes = description["shapes"].items()
                arrays = {name: load(file[f"arrays/{k}"]).reshape(to) for k, (name, to) in enumerate(shapes)}
                return arrays, description["attributes"]
    except (AttributeError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
        reason = "it is cut short" if "truncated" in str(error) else error
        raise ValueError(f"{path} is damaged: {reason}") from error
    if version is None:
        raise ValueError(f"{path} is no restart file: it is an HDF5 file of another kind")
    raise ValueError(f"{path} is a restart file of format {version}; this version of msdwarp reads {FORMAT}")
