"""Which triangles of a surface part where connections break."""

import numpy as np
from numpy.typing import NDArray

from .system import System


class Edges:
    """The connections along the edges of a surface's triangles.

    A vertex that is a mixture of particles lies on no connection: a surface that is carried by a body inside it
    parts nowhere.

    Parameters
    ----------
    system
        What has the surface, and the connections.
    """

    def __init__(self, system: System) -> None:
        surface = system.surface
        self._of: NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)
        if surface is None:
            return
        self._of = np.full((len(surface.triangles), 3), -1)
        if surface.weights is not None or not system.connection_count:
            return
        corners = surface.particle[surface.triangles]
        self._of = connection_between(system, np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1))

    def parted_at(self, broken_at: NDArray) -> NDArray:
        """Return when each triangle parted, inf where none has, shape [triangle_count].

        It does when its corners are no longer joined by what is whole: as the second of its three edges breaks, or
        the first where one of them has no connection.

        Parameters
        ----------
        broken_at
            When each connection broke [s], inf where it is whole, shape [connection_count].
        """
        absent = self._of < 0
        times = np.sort(np.where(absent, -np.inf, np.append(broken_at, np.inf)[self._of]), axis=1)
        missing = absent.sum(axis=1)
        parted = np.take_along_axis(times, np.clip(missing, 1, 2)[:, None], axis=1)[:, 0]
        return np.where(missing == 3, np.inf, parted)


def connection_between(system: System, pairs: NDArray) -> NDArray[np.int64]:
    """Return which connection joins each pair of particles, -1 where none does.

    Parameters
    ----------
    system
        What has the connections, at least one.
    pairs
        Numbers of particles, shape [..., 2]; the result's is [...].
    """
    n = system.particle_count
    joined = np.sort(system.connections.astype(np.int64), axis=1) @ (n, 1)
    order = np.argsort(joined, kind="stable")
    wanted = np.sort(np.asarray(pairs, dtype=np.int64), axis=-1) @ (n, 1)
    found = order[np.minimum(np.searchsorted(joined, wanted, sorter=order), len(joined) - 1)]
    return np.where(joined[found] == wanted, found, -1)


def broken_before(broken_at: NDArray, time: float) -> NDArray[np.bool_]:
    """Return what is broken in a frame that is recorded at `time` [s]: what broke before it, or from the start.

    What breaks as a frame is recorded does so in the substep behind it. Both are compared as float32, in which
    devices and files have them.
    """
    when = np.asarray(broken_at, dtype=np.float32)
    return (when < np.float32(time)) | (when <= 0)
