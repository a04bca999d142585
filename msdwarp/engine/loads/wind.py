"""WindEffect: the wind of a scene on a device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import check_types
from ...kernels.loads.wind import velocity_of_air, wind_on_faces, wind_on_particles
from ...world import Load, Wind
from ..device.device import upload_fields
from ..model.effect import Effect, Elements, Parameter
from ..model.model import Model
from ..model.stage_tables import AHEAD, MOST_LOOKED_AT, StageTables
from .surface_triangles import EmbeddedVertices, Faces, area_vectors

AHEAD_BY_PLACE = 15
"""Wind that is a function of place is bounded at every 15th time of AHEAD: each takes all particles."""
Named = Sequence[tuple[str, Wind]]
"""Winds, each with its name in messages."""


def winds_of(model: Model, loads: Sequence[Load], vertices: EmbeddedVertices | None) -> list[Effect]:
    """Return the effects of the winds among the loads of a scene: one for surfaces, one for particles.

    `vertices` is the effect of the surface's vertices, if these are weighted means of particles.
    """
    winds = [(f"loads[{k}].velocity", one) for k, one in enumerate(loads) if isinstance(one, Wind)]
    on_faces = [(name, one) for name, one in winds if one.area is None]
    on_particles = [(name, one) for name, one in winds if one.area is not None]
    effects: list[Effect] = [OnFaces(model, on_faces, vertices)] if on_faces else []
    return effects + ([OnParticles(model, on_particles)] if on_particles else [])


class WindEffect(StageTables):
    """Common base of wind on surfaces and on particles: the air velocity at each stage of a frame."""

    table = "velocity"

    def __init__(self, model: Model, winds: Named, compose: Any, **how: bool) -> None:
        self._model, self.named = model, winds
        places = [name for name, one in winds if one.of_place]
        if places and len(winds) > 1:
            raise ValueError(
                f"{places[0]} is a function of place; it must then be the only wind on surfaces, or on particles"
            )
        function = self.function = winds[0][1].velocity if places else None
        """wp.func (x, t) -> velocity of the air [m/s]; None if the velocity is the same everywhere."""
        if function is not None:
            check_types(places[0], function, {"x": model.vector, "t": model.scalar}, model.vector)
        term, self._law = compose(model.dim, model.scalar, model.compensated, function, **how)
        self.term, self.data = term, term.Data()
        for name in ("drag", "lift"):
            setattr(self.data.winds, name, wp.zeros(len(winds), dtype=model.scalar, device=model.device))
        self._take_coefficients()
        self._given = not places
        self.set_up(model, len(winds), model.vector, varies=any(one.varies for _, one in winds))
        self.timed = self.varies or not self._given

    def _take_coefficients(self) -> None:
        """Upload ½ ρ C of each wind [kg/m³]."""
        for name in ("drag", "lift"):
            values = np.array([0.5 * one.density * getattr(one, name) for _, one in self.named])
            getattr(self.data.winds, name).assign(values.astype(self._model.dtype))

    def parameters(self) -> dict[str, Parameter]:
        """Return the parameters of each wind, for gradients; kernels take ½ ρ C and the velocity."""
        found = {}
        for k, (name, one) in enumerate(self.named):
            of, half = name.removesuffix("velocity"), 0.5 * one.density
            weights = {"drag": (half, 0.0), "lift": (0.0, half), "density": (0.5 * one.drag, 0.5 * one.lift)}
            if not one.lift:  # without it kernels leave its direction out
                del weights["lift"]
            for word, weight in weights.items():
                found[of + word] = Parameter(lambda sums, k=k, weight=weight: sums[..., k, :2] @ weight)
            if self._given:
                found[name] = Parameter(lambda sums, k=k: sums[..., k, 2:], one.varies)
        return found

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace winds by other winds on the same surfaces or particles."""
        super().exchange(others)
        self._take_coefficients()

    def place_table(self, name: str, table: wp.array) -> None:
        """Store the table of air velocities in the struct that kernels read."""
        setattr(self.data.winds, name, table)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the velocity of each wind at each time [m/s], shape [time_count, wind_count, d]."""
        return super().at(times) if self._given else np.zeros((len(times), 1, self._model.dim))

    def look_ahead(self, times: NDArray[np.float64], x: Any, v: Any) -> dict[str, NDArray[np.float64]]:
        """Return the velocities of the air at these times; if a function of place, at some of the particles."""
        if self._given:
            return super().look_ahead(times, x, v)
        return {self.named[0][0]: self._by_place(times, x, -(-self._model.particle_count // MOST_LOOKED_AT))}

    def _by_place(self, times: NDArray[np.float64], x: wp.array, every: int = 1) -> NDArray[np.float64]:
        """Return the velocity of the air at these times at one of `every` so many particles [m/s]."""
        model = self._model
        count = -(-model.particle_count // every)
        found = wp.zeros((len(times), count), dtype=model.vector, device=model.device)
        inputs = [x, every, wp.array(times, dtype=model.scalar, device=model.device)]
        kernel = velocity_of_air(model.dim, model.scalar, self.function)
        wp.launch(kernel, found.shape, inputs, [found], device=model.device)
        return found.numpy().astype(np.float64)

    def _resistance(self, x: wp.array, v: wp.array, area: NDArray, wind: NDArray) -> NDArray[np.float64]:
        """Return dF/du = ρ (C_d + C_l) A u [N s/m] for areas A [m²], at the largest relative speed u [m/s].

        That of the air is the largest now and in the next second; if it is a function of place, at the particles'
        present places.
        """
        coefficients = np.array([one.density * (one.drag + one.lift) for _, one in self.named])[wind]
        air = np.linalg.norm(self.now_and_ahead(), axis=-1).max(axis=0)[wind]
        if not self._given:
            air = np.linalg.norm(self._by_place(self._time + AHEAD[::AHEAD_BY_PLACE], x), axis=-1).max()
        speed = np.linalg.norm(v.numpy().astype(np.float64), axis=1).max() + air
        return coefficients * area * speed


class OnFaces(WindEffect):
    """Wind on the triangles of a surface."""

    def __init__(self, model: Model, winds: Named, vertices: EmbeddedVertices | None) -> None:
        faces = self._faces = Faces([one.facets(model.system) for _, one in winds], model.particle_count)
        closed = bool(faces.closed.any())
        super().__init__(model, winds, wind_on_faces, mixed=faces.mixed, any_closed=closed)
        self.data.faces, self.by_world = faces.on(model, vertices)
        upload_fields(self.data, model.device, wind=faces.of, **({"closed": faces.closed} if closed else {}))
        self.members = faces.members()

    def add_resistance(self, x: wp.array, v: wp.array, damping: NDArray[np.float64]) -> None:
        """Add a third of a triangle's resistance to each of its corners."""
        faces = self._faces
        area = np.linalg.norm(area_vectors(faces.corner, faces.facets.points(x.numpy())), axis=1)
        damping += faces.bound(faces.add_to_corners(self._resistance(x, v, area, faces.of) / 3))

    def elements(self) -> Elements:
        """Return the triangles as elements, for gradients."""
        return Elements(self.data, self._law, self._faces.corner, self._faces.facets, group=self._faces.of)


class OnParticles(WindEffect):
    """Wind on particles that have an area."""

    def __init__(self, model: Model, winds: Named) -> None:
        super().__init__(model, winds, wind_on_particles)
        chosen = [one.particles(model.system) for _, one in winds]
        if np.sum(chosen, axis=0).max() > 1:
            second = winds[1][0].removesuffix(".velocity")
            raise ValueError(f"{second}.on shares particles with another wind's; at most one may act on each")
        self.members = members = np.logical_or.reduce(chosen)
        self._on = np.flatnonzero(members)
        self._area, self._number = np.zeros(model.particle_count), np.zeros(model.particle_count, dtype=int)
        for k, ((_, one), mine) in enumerate(zip(winds, chosen, strict=True)):
            self._area[mine], self._number[mine] = one.areas(model.system)[mine], k
        upload_fields(self.data, model.device, wind=self._number, area=self._area)

    def add_resistance(self, x: wp.array, v: wp.array, damping: NDArray[np.float64]) -> None:
        """Add dF/du of each particle's drag [N s/m]."""
        damping += self._resistance(x, v, self._area, self._number)

    def elements(self) -> Elements:
        """Return the particles as elements, for gradients."""
        return Elements(self.data, self._law, self._on[:, None], group=self._number[self._on])
