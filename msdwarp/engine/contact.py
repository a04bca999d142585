"""Contact: colliders as arrays on a device, and where those that move are at each substep."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.contact import KINDS, fixed_contact, moving_contact
from ..kernels.contact import Contact as ContactPiece
from ..world import Collider
from .effect import Effect

if TYPE_CHECKING:
    from .model import Model

COEFFICIENTS = ("restitution", "friction", "tangential_factor", "rest_speed")


class Contact(Effect):
    """Keeps the particles of a model out of obstacles, fixed or moving.

    Parameters
    ----------
    model
        The system on a device.
    colliders
        Obstacles, in the order in which a particle meets them; one at least.
    rule
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact.rule`.

    Raises
    ------
    ValueError
        If one is no collider, or does not fit into the system's space.
    """

    def __init__(self, model: "Model", colliders: Sequence[Collider], rule: str) -> None:
        for k, collider in enumerate(colliders):
            if not isinstance(collider, Collider) or type(collider).__name__ not in KINDS:
                raise ValueError(f"colliders[{k}] is {collider!r}; it must be a {', '.join(KINDS)}")
            if wrong := collider.fits(model.dim):
                raise ValueError(f"colliders[{k}].{wrong}")
        self._colliders, self._dim, self._device = tuple(colliders), model.dim, model.device
        self._vector, self._turn = model.vector, wp.types.matrix((model.dim, model.dim), model.scalar)
        self._inverse_mass = model.inverse_mass
        self.works = any(collider.motion is not None for collider in colliders)
        kinds = tuple(sorted({type(collider).__name__ for collider in colliders}, key=KINDS.index))
        compose = moving_contact if self.works else fixed_contact
        self.piece = ContactPiece(*compose(model.dim, model.scalar, rule, kinds), moving=self.works)
        data = self.data = self.piece.Colliders()
        data.count = len(colliders)
        self._describe(data.solids, model.scalar)
        for name in COEFFICIENTS:
            values = [float(getattr(collider, name)) for collider in colliders]
            setattr(data.surface, name, wp.array(values, dtype=model.scalar, device=self._device))
        if self.works:
            for collider in colliders:  # what a motion gets wrong is said before anything runs
                collider.pose(0.0, self._dim)

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

    def begin(self, substeps: int, dt: float) -> None:
        """Make room for the poses of a frame of so many substeps of `dt` seconds."""
        if not self.works:
            return
        shape = (substeps + 1, len(self._colliders))
        for name in ("turn", "turning"):
            setattr(self.data, name, wp.zeros(shape, dtype=self._turn, device=self._device))
        for name in ("shift", "speed"):
            setattr(self.data, name, wp.zeros(shape, dtype=self._vector, device=self._device))
        self.data.inverse_mass = self._inverse_mass
        self._dt, self._substeps = dt, substeps

    def begin_frame(self, time: float) -> None:
        """Put what moves where it is in the frame that begins at `time` [s]."""
        if self.works:
            for name, rate, poses in zip(("turn", "shift"), ("turning", "speed"), self._poses(time), strict=True):
                getattr(self.data, name).assign(poses[1:])
                getattr(self.data, rate).assign(np.diff(poses, axis=0) / self._dt)

    def begin_substep(self, substep: int) -> bool:
        """Have what is launched next find colliders where they are in this substep, where any move."""
        if self.works:
            self.data.substep = substep
        return self.works

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
