"""EmbeddedVertices: surface vertices that are weighted means of particles, for loads on the surface."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from ...bodies import facets_of
from ...kernels.loads import mix_vertices, mixed_vertices
from ...world import EnclosedGas, Load, Pressure, Wind
from ..model.effect import Effect
from ..model.model import Model


def embedded_vertices_of(model: Model, loads: Sequence[Load]) -> "EmbeddedVertices | None":
    """Return the effect that loads on a surface with embedded vertices need; None if there are none."""
    on_facets = any(
        isinstance(one, Pressure | EnclosedGas) or (isinstance(one, Wind) and one.area is None) for one in loads
    )
    return EmbeddedVertices(model) if on_facets and facets_of(model.system).mixed else None


class EmbeddedVertices(Effect):
    """Computes the vertices of a surface before forces are evaluated; loads read them like particles."""

    def __init__(self, model: Model) -> None:
        self._model, facets = model, facets_of(model.system)
        self.by_world = ("x", "v")
        self.piece = mixed_vertices(model.dim, model.scalar)
        self._mix = mix_vertices(model.dim, model.scalar, model.compensated)
        self._particle = wp.array(facets.particle, dtype=int, device=model.device)
        self._weight = wp.array(facets.weight, dtype=model.scalar, device=model.device)
        self.data = self.piece.Data()
        for name in ("x", "v"):
            count = model.worlds * len(facets.particle)
            setattr(self.data, name, wp.zeros(count, dtype=model.vector, device=model.device))

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the kernel that computes vertices' positions and velocities from particles' x and v."""
        inputs = [self._particle, self._weight, self._model.stride, compensation, x, v]
        wp.launch(self._mix, len(self.data.x), inputs, [self.data], device=self._model.device)
