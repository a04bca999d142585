"""SoftColliders: obstacles that push particles out by a force. Force and adjoint: `kernels/colliders`."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.colliders.signed_distance import KINDS
from ...kernels.colliders.soft_colliders import soft_colliders
from ...world import Collider, Plane
from ..device.device import upload_fields
from ..model.effect import Effect, Parameter, summed
from ..model.model import Model
from .penetration_depth import describe

NUMBERS = ("stiffness", "ramp", "dissipation", "friction", "rest_speed")


class SoftColliders(Effect):
    """The soft obstacles among the colliders of a scene: those that have a stiffness.

    `radius` is that of each particle against them [m], shape [particle_count].
    """

    conserves = True

    def __init__(self, model: Model, colliders: Sequence[Collider], radius: NDArray[np.float64]) -> None:
        self._soft = [(k, one) for k, one in enumerate(colliders) if one.stiffness is not None]
        soft = [one for _, one in self._soft]
        self._model = model
        self.kinds = tuple(sorted({type(one).__name__ for one in soft}, key=KINDS.index))
        """The kinds of obstacles, as in `msdwarp.kernels.colliders`."""
        how = model.dim, model.scalar, model.compensated, self.kinds, bool(radius.any())
        self._composed = soft_colliders(*how)
        self.term = self._composed.term
        model.kernels.note(self._composed.add_blocks, self._composed.measure)
        data = self.data = self.term.Data()
        data.count = len(soft)
        describe(data.solids, soft, model.dim, model.scalar, model.device)
        numbers = {name: np.array([getattr(one, name) for one in soft], dtype=np.float64) for name in NUMBERS}
        upload_fields(data, model.device, **numbers)
        if radius.any():
            upload_fields(data, model.device, radius=radius)
        self._stiffness = float(numbers["stiffness"].max())
        self._damped = float(numbers["dissipation"].any())

    def parameters(self) -> dict[str, Parameter]:
        """Return the parameters of each obstacle, with its position if one number or point defines it."""
        found, count = dict[str, Parameter](), len(NUMBERS)
        for p, (k, one) in enumerate(self._soft):
            for n, word in enumerate(NUMBERS):
                found[f"colliders[{k}].{word}"] = Parameter(lambda sums, p=p, n=n: sums[..., p, n])
            if isinstance(one, Plane):
                normal = one.unit_normal(self._model.dim)
                found[f"colliders[{k}].offset"] = Parameter(lambda sums, p=p, n=normal: sums[..., p, count:] @ n)
            elif one.places == ("position",):
                found[f"colliders[{k}].position"] = Parameter(lambda sums, p=p: sums[..., p, count:])
        return found

    def begin(self, substeps: int, dt: float) -> None:
        """Set the length of substeps [s], which limits friction."""
        self.data.dt = dt

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half of the largest stiffness k to each particle's block, wherever it is: it may soon be in contact.

        If obstacles dissipate, add the damping √(k m) too. That is the most for a particle that hits an obstacle
        of dissipation c at the speed 1/c [m/s].
        """
        model = self._model
        table = model.table("inverse_mass")
        inputs = [self._stiffness, self._damped, table[world % table.shape[0]]]
        wp.launch(
            self._composed.add_blocks, model.particle_count, inputs, [stiffness, damping], device=model.device
        )

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the stored energy [J], and the power that is dissipated by damping and friction [W]."""
        model = self._model
        inputs = [self.data, model.table("inverse_mass"), model.stride, x, v]
        return summed(model, self._composed.measure, model.particle_count, inputs)
