"""Extra springs: springs in no direction of the lattice, which a stencil leaves out."""

import numpy as np

from ...kernels.springs.constants import CONSTANTS
from ...kernels.springs.extra_springs import tie_force
from ..device.csr import rows
from ..device.device import upload_fields
from ..model.effect import Effect
from ..model.model import Model


class ExtraSprings(Effect):
    """Forces of the springs that a stencil leaves out (`Lattice.ties`).

    Energies, the stability bound and linearised products already include them, as springs of the system.
    """

    conserves = True

    def __init__(self, model: Model) -> None:
        assert model.lattice is not None
        system, ties = model.system, model.lattice.ties
        laws = model.laws if system.damping[ties].any() else model.laws._replace(damper=None)
        self.term = tie_force(model.dim, model.scalar, model.compensated, laws)
        # The ends of springs, sorted by particle, then by spring.
        ends = system.connections[ties]
        particle, other, number = ends.ravel(), ends[:, ::-1].ravel(), np.repeat(ties, 2)
        order, first = rows(particle, model.particle_count)
        self.members = np.diff(first) > 0
        data = self.data = model.with_law(self.term.Data())
        upload_fields(data, model.device, first=first, other=other[order])
        self.by_world = tuple(name for name in CONSTANTS if name in model.rows)
        for name in CONSTANTS:
            values = model.row_of(name)[:, number[order]]
            if name in model.rows:
                values = np.tile(values, (model.worlds // len(values), 1))
            upload_fields(data, model.device, **{name: values.ravel()})
