"""Which triangles of a surface part where connections break."""

import numpy as np
from numpy.typing import NDArray

from .system import System


class Edges:
    """The connections along the edges of the triangles of a system's surface.

    A vertex that is a mixture of particles lies on no connection, so that such a surface parts nowhere.
    """

    def __init__(self, system: System) -> None:
        surface = system.surface
        self._of: NDArray[np.int64] = np.full((0 if surface is None else len(surface.triangles), 3), -1)
        if surface is None or surface.weights is not None or not system.connection_count:
            return
        corners = surface.particle[surface.triangles]
        self._of = connection_between(system, np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1))

    def parted_at(self, broken_at: NDArray) -> NDArray:
        """Return when each triangle parted, inf where none has, shape [triangle_count].

        A triangle parts when its corners are no longer joined: as the second of its three edges breaks, or the
        first where one of them has no connection. `broken_at` is as in `System`.
        """
        absent = self._of < 0
        times = np.sort(np.where(absent, -np.inf, np.append(broken_at, np.inf)[self._of]), axis=1)
        missing = absent.sum(axis=1)
        parted = np.take_along_axis(times, np.clip(missing, 1, 2)[:, None], axis=1)[:, 0]
        return np.where(missing == 3, np.inf, parted)


def connection_between(system: System, pairs: NDArray) -> NDArray[np.int64]:
    """Return which connection joins each pair of particles, -1 where none does.

    The system has one connection at least. The shape of `pairs` is [..., 2], that of the result [...].
    """
    n = system.particle_count
    joined = np.sort(system.connections.astype(np.int64), axis=1) @ (n, 1)
    order = np.argsort(joined, kind="stable")
    wanted = np.sort(np.asarray(pairs, dtype=np.int64), axis=-1) @ (n, 1)
    found = order[np.minimum(np.searchsorted(joined, wanted, sorter=order), len(joined) - 1)]
    return np.where(joined[found] == wanted, found, -1)


def broken_before(broken_at: NDArray, time: float) -> NDArray[np.bool_]:
    """Return which connections are broken in a frame at `time` [s]: those that broke before, or at the start.

    One that breaks at the frame's time does so in the following substep. Times are compared as float32, as devices
    and files have them.
    """
    when = np.asarray(broken_at, dtype=np.float32)
    return (when < np.float32(time)) | (when <= 0)
