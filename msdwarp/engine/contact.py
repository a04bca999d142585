"""Contact: colliders as arrays on a device, and where those that move are at each substep."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.basis import vector
from ..kernels.contact import KINDS, NoColliders, fixed_contact, moving_contact
from ..world import Collider

COEFFICIENTS = ("restitution", "friction", "tangential_factor", "rest_speed")


class Contact:
    """Colliders on a device.

    Parameters
    ----------
    colliders
        Obstacles, in the order in which a particle meets them.
    rule
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact`.
    dim, scalar, device
        Number of coordinates, Warp's type of numbers, and the Warp device.

    Raises
    ------
    ValueError
        If one is no collider, or does not fit into a space of `dim` coordinates.
    """

    def __init__(self, colliders: Sequence[Collider], rule: str, *, dim: int, scalar: Any, device: Any) -> None:
        for k, collider in enumerate(colliders):
            if not isinstance(collider, Collider) or type(collider).__name__ not in KINDS:
                raise ValueError(f"colliders[{k}] is {collider!r}; it must be a {', '.join(KINDS)}")
            if wrong := collider.fits(dim):
                raise ValueError(f"colliders[{k}].{wrong}")
        self._colliders, self._dim, self._device = tuple(colliders), dim, device
        self._vector, self._turn = vector(dim, scalar), wp.types.matrix((dim, dim), scalar)
        self.moving = any(collider.motion is not None for collider in colliders)
        if not colliders:
            self.Colliders, self.data, self.collide = NoColliders, NoColliders(), None
            return
        kinds = tuple(sorted({type(collider).__name__ for collider in colliders}, key=KINDS.index))
        compose = moving_contact if self.moving else fixed_contact
        self.Colliders, self.collide = compose(dim, scalar, rule, kinds)
        data = self.data = self.Colliders()
        data.count = len(colliders)
        self._describe(data.solids, scalar)
        for name in COEFFICIENTS:
            values = [float(getattr(collider, name)) for collider in colliders]
            setattr(data.surface, name, wp.array(values, dtype=scalar, device=device))
        if self.moving:
            for collider in colliders:  # what a motion gets wrong is said before anything runs
                collider.pose(0.0, dim)

    def _describe(self, solids: Any, scalar: Any) -> None:
        """Fill in the struct of what `msdwarp.kernels.contact.distance` reads."""
        nothing = {"a": np.zeros(self._dim), "b": np.zeros(self._dim), "radius": 0.0, "axes": np.eye(self._dim)}
        geometry = [nothing | collider.geometry(self._dim) for collider in self._colliders]
        types = {"a": self._vector, "b": self._vector, "radius": scalar, "axes": self._turn}
        for name, dtype in types.items():
            values = np.array([one[name] for one in geometry], dtype=np.float64)
            setattr(solids, name, wp.array(values, dtype=dtype, device=self._device))
        kind = [KINDS.index(type(collider).__name__) for collider in self._colliders]
        solids.kind = wp.array(kind, dtype=int, device=self._device)

    def begin(self, inverse_mass: wp.array, substeps: int, dt: float) -> None:
        """Make room for the poses of a frame of so many substeps of `dt` seconds."""
        if self.moving:
            shape = (substeps + 1, len(self._colliders))
            for name in ("turn", "turning"):
                setattr(self.data, name, wp.zeros(shape, dtype=self._turn, device=self._device))
            for name in ("shift", "speed"):
                setattr(self.data, name, wp.zeros(shape, dtype=self._vector, device=self._device))
            self.data.inverse_mass = inverse_mass
            self._dt, self._substeps = dt, substeps

    def place(self, time: float) -> None:
        """Put what moves where it is in the frame that begins at `time` [s]."""
        if self.moving:
            for name, rate, poses in zip(("turn", "shift"), ("turning", "speed"), self._poses(time), strict=True):
                getattr(self.data, name).assign(poses[1:])
                getattr(self.data, rate).assign(np.diff(poses, axis=0) / self._dt)

    def _poses(self, time: float) -> list[NDArray[np.float64]]:
        """Return turns and shifts from a substep before `time` to the end of the frame."""
        times = time + self._dt * np.arange(-1, max(self._substeps, 2) + 1)
        now = times[times >= 0]
        each = [[self._pose(k, t) for k in range(len(self._colliders))] for t in map(float, now)]
        result = []
        for k in (0, 1):
            poses = np.array([[pose[k] for pose in row] for row in each])
            if len(now) < len(times):  # a motion need not be defined before 0: its acceleration was the same
                poses = np.concatenate([[3 * poses[0] - 3 * poses[1] + poses[2]], poses])
            result.append(poses[: self._substeps + 2])
        return result

    def _pose(self, k: int, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pose of a collider; raise ValueError that names it where its motion has none."""
        try:
            return self._colliders[k].pose(time, self._dim)
        except Exception as error:
            raise ValueError(f"colliders[{k}] has no place at {time:g} s: {error}") from error
