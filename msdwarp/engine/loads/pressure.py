"""SurfacePressure: the pressures of a scene on a device."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.loads.pressure import gas_adjoint, gas_law, pressure
from ...world import EnclosedGas, Load, Pressure, volume
from ..device.device import upload_fields
from ..model.effect import Effect, Elements, Parameter
from ..model.model import Model
from ..model.stage_tables import StageTables
from .surface_triangles import EmbeddedVertices, Faces, area_vectors

THREADS = 256
"""Number of threads that sum a volume."""


def pressures_of(model: Model, loads: Sequence[Load], vertices: EmbeddedVertices | None) -> list[Effect]:
    """Return the effects of the pressures among a scene's loads: one for given pressures, one for gases.

    `vertices` is the effect of the surface's vertices, if these are weighted means of particles.
    """
    given = [(f"loads[{k}].pressure", one) for k, one in enumerate(loads) if isinstance(one, Pressure)]
    gases = [(f"loads[{k}]", one) for k, one in enumerate(loads) if isinstance(one, EnclosedGas)]
    effects: list[Effect] = [GivenPressures(model, given, vertices)] if given else []
    return effects + ([Gases(model, gases, vertices)] if gases else [])


class SurfacePressure(Effect):
    """Common base of given pressures and gases: the triangles under pressure."""

    def __init__(
        self,
        model: Model,
        pressures: Sequence[Pressure | EnclosedGas],
        vertices: EmbeddedVertices | None,
        gas: bool,
    ) -> None:
        self._model, self._vertices = model, vertices
        faces = self._faces = Faces([one.facets(model.system) for one in pressures], model.particle_count)
        kinds = model.dim, model.scalar, model.compensated
        term, self._law = pressure(*kinds, mixed=faces.mixed, gas=gas)
        self.term, self.data = term, term.Data()
        self.data.faces, self.by_world = faces.on(model, vertices)
        upload_fields(self.data, model.device, of=faces.of)
        self.members = faces.members()

    def _turning(self, x: NDArray, pressure: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a bound of each particle's stiffness due to rotating area vectors [N/m], shape [particle_count].

        ∂a/∂x_j is half the opposite edge (as a cross product). By Gershgorin's theorem each triangle adds at most
        p (|e_1| + |e_2| + |e_3|) / 6 to the row of each corner in the stiffness matrix. Blocks get half of this.
        """
        faces, places = self._faces, self._faces.facets.points(x)
        edges = sum(
            np.linalg.norm(places[faces.corner[:, k]] - places[faces.corner[:, k - 1]], axis=1).astype(np.float64)
            for k in range(3)
        )
        return faces.bound(faces.add_to_corners(np.abs(pressure)[faces.of] * edges / 12))

    def _add(self, blocks: wp.array, each: NDArray[np.float64]) -> None:
        blocks.assign(blocks.numpy() + each[:, None, None] * np.eye(self._model.dim))


class GivenPressures(SurfacePressure, StageTables):
    """Pressures that are given, as numbers or as functions of time."""

    def __init__(
        self, model: Model, named: Sequence[tuple[str, Pressure]], vertices: EmbeddedVertices | None
    ) -> None:
        super().__init__(model, [one for _, one in named], vertices, gas=False)
        self.named = named
        self.set_up(model, len(named), model.scalar, varies=any(callable(one.pressure) for _, one in named))

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each pressure at each time [Pa], shape [time_count, count]."""
        return np.stack([one.at(times, name) for name, one in self.named], axis=1)

    def elements(self) -> Elements:
        """Return the triangles as elements, for gradients."""
        return Elements(self.data, self._law, self._faces.corner, self._faces.facets, group=self._faces.of)

    def parameters(self) -> dict[str, Parameter]:
        """Return the pressures as parameters, for gradients."""
        return {
            name: Parameter(lambda sums, k=k: sums[..., k, 0], callable(one.pressure))
            for k, (name, one) in enumerate(self.named)
        }

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the stiffness due to the largest pressures."""
        self._add(stiffness, self._turning(x.numpy(), np.abs(self.now_and_ahead()).max(axis=0)))


class Gases(SurfacePressure):
    """Enclosed gases: pressures are computed from volumes in each stage of a substep."""

    def __init__(
        self, model: Model, named: Sequence[tuple[str, EnclosedGas]], vertices: EmbeddedVertices | None
    ) -> None:
        gases = self._gases = [one for _, one in named]
        super().__init__(model, gases, vertices, gas=True)
        self._names = [name for name, _ in named]
        self._gas_law = gas_law(model.dim, model.scalar, model.compensated, self._faces.mixed)
        model.kernels.note(self._gas_law, block=THREADS)
        self.data.value = wp.zeros((model.worlds, len(gases)), dtype=model.scalar, device=model.device)
        self.by_world = (*self.by_world, "value")
        numbers = [(one.pressure + one.outside, one.outside, one.volume, one.exponent) for one in gases]
        self._numbers = wp.array(numbers, dtype=wp.vec4d, device=model.device)
        self._ends = wp.array(self._faces.ends, dtype=int, device=model.device)

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the kernel that computes the pressures for positions x."""
        model, threads = self._model, THREADS if self._model.device.is_cuda else 1
        stride = model.stride
        if self._vertices is not None:
            x = self._vertices.x
            stride = len(x) // model.worlds
        inputs = [self.data.faces.corner, self._ends, self._numbers, x, compensation.x, stride]
        count, out = model.worlds * len(self._gases) * threads, [self.data.value]
        wp.launch(self._gas_law, count, inputs, out, device=model.device, block_dim=threads)

    def elements(self) -> Elements:
        """Return the triangles as elements, for gradients; `Elements.prepare` first sums over each gas."""
        model, faces, worlds = self._model, self._faces, self._model.worlds
        each, count = np.arange(worlds)[:, None], worlds * len(self._gases)
        of, ends = faces.of + len(self._gases) * each, faces.ends[:-1] + faces.ends[-1] * each
        Data, law, kernel = gas_adjoint(model.dim, model.scalar)
        data: Any = Data()
        upload_fields(data, model.device, of=of.ravel(), over=np.zeros(count), slope=np.zeros(count))
        data.origin = wp.zeros(count, dtype=model.vector, device=model.device)
        threads = THREADS if model.device.is_cuda else 1
        begin = wp.array(np.append(ends, worlds * faces.ends[-1]), dtype=int, device=model.device)
        numbers = wp.array(np.tile(self._numbers.numpy(), (worlds, 1)), dtype=wp.vec4d, device=model.device)

        def prepare(*arrays: wp.array) -> None:
            particle, weight, x, phi, by_numbers = arrays
            inputs = [particle, weight, begin, numbers, x, phi, data, by_numbers]
            wp.launch(kernel, count * threads, inputs, device=model.device, block_dim=threads)

        of_each = np.arange(len(self._gases))
        return Elements(data, law, faces.corner, faces.facets, prepare, of_all_worlds=True, group=of_each)

    def parameters(self) -> dict[str, Parameter]:
        """Return the parameters of each gas, for gradients; values of the initial state are constants."""
        words = "pressure", "outside", "volume", "exponent"
        return {
            f"{name}.{word}": Parameter(lambda sums, k=k, n=n: sums[..., k, n])
            for k, name in enumerate(self._names)
            for n, word in enumerate(words)
        }

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the stiffness due to gases.

        Besides rotating area vectors, a gas resists volume changes with stiffness γ p / V: a matrix of rank 1,
        whose mass-weighted eigenvalue is γ p / V Σ |∂V/∂x_i|² / m_i. Blocks get half of it times the mass.
        """
        model, faces = self._model, self._faces
        places = faces.facets.points(x.numpy())
        masses = model.row_of("mass")
        inverse_mass = np.broadcast_to(
            (1.0 / masses[world % len(masses)]).astype(model.dtype), model.particle_count
        )
        over, each = np.zeros(len(self._gases)), np.zeros(model.particle_count)
        for k, gas in enumerate(self._gases):
            corner = faces.corner[faces.ends[k] : faces.ends[k + 1]]
            assert gas.volume is not None  # set, since gases are bound
            now = max(volume(corner, places), 1e-6 * gas.volume)
            inside = (gas.pressure + gas.outside) * (gas.volume / now) ** gas.exponent
            over[k] = inside - gas.outside
            gradient = faces.facets.spread(
                faces.add_to_corners(area_vectors(corner, places) / 3, corner), model.particle_count
            )
            rate = gas.exponent * inside / now * float(((gradient**2).sum(axis=1) * inverse_mass).sum())
            mine = (gradient != 0).any(axis=1) & (inverse_mass > 0)
            each[mine] += 0.5 * rate / inverse_mass[mine]
        self._add(stiffness, each + self._turning(x.numpy(), over))
