"""EnsembleModel: many worlds of one topology on a device, and what differs between them."""

from collections.abc import Mapping, Sequence
from math import lcm
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import System
from ...kernels.records import record_length
from ...world import Collider, Contact, Force
from ..collision.body_contact_worlds import BodyContactWorlds
from ..collision.colliders import Colliders
from ..collision.penetration_depth import start_depths, touching
from ..device.device import find_device
from ..loads.external_work import Work
from ..loads.forces import Steady
from .force_algorithm import AUTO, ensemble_force_algorithm
from .model import Model
from .state import State

Rows = Mapping[str, NDArray[np.float64]]
"""What differs between worlds, by name: world w has row w mod (number of rows)."""
CONNECTIONS = ("rest_length", "stiffness", "damping")
LINE = 8
"""Particles in a line of the GPU's caches, with which each world begins."""
MOST_RECORDS = 2**31 - 1
"""Particles of all worlds together that 32-bit numbers count."""


class EnsembleModel(Model):
    """Many worlds on a device: a system as all have it, and rows of what differs.

    Its vectors are those of all worlds, one world after the other, each with the margin past which its lattice may
    be read. All else is as in the model of one world.

    Parameters
    ----------
    system
        What all worlds have; `damping` and `mass` are the largest of all worlds, so that what any has is compiled.
    worlds
        How many.
    rows
        What differs: rest_length, stiffness, damping of shape [rows, connection_count]; mass
        [rows, particle_count]; gravity [rows, d]; friction [rows, collider_count]; position, velocity
        [rows, particle_count, d]. Each number of rows divides `worlds`.
    options
        Of `Model`.

    Raises
    ------
    ValueError
        If the scene has an effect that worlds cannot have, or a number is out of the range of the precision.
    """

    in_worlds = True

    def __init__(self, system: System, worlds: int, rows: Rows, **options: Any) -> None:
        self.worlds, self.rows = worlds, dict(rows)
        for k, one in enumerate(options.get("loads", ())):
            if not isinstance(one, Contact) and (not isinstance(one, Force) or one.varies or one.of_place):
                raise ValueError(
                    f"loads[{k}] is {one!r}, which worlds of an ensemble cannot have yet: only Contact and a "
                    "constant Force"
                )
            if isinstance(one, Contact) and one.surface_colliders:
                raise ValueError("contact has surface_colliders=True, which worlds of an ensemble cannot have yet")
        largest = {name: self.rows[name].max(axis=0) for name in ("mass", "damping") if name in self.rows}
        first = {name: self.rows[name][0] for name in ("position", "velocity") if name in self.rows}
        if options.get("force_algorithm", AUTO) == AUTO:
            on_gpu = find_device(options.get("device")).is_cuda
            force_algorithm = ensemble_force_algorithm(system, on_gpu=on_gpu)
            options["force_algorithm"] = (
                force_algorithm
                if force_algorithm != "stencil" or self._is_alike_by_direction(system)
                else "gather"
            )
        super().__init__(system.replace(**largest, **first), **options)
        self._check_effects()
        self._check_starts(options.get("colliders", ()))
        for name, values in self.rows.items():
            self.check_range(values[np.isfinite(values)], name)
        if worlds * self.stride + 2 * self.margin > MOST_RECORDS:
            most = (MOST_RECORDS - 2 * self.margin) // self.stride
            raise ValueError(
                f"worlds is {worlds}; it must be at most {most} of {self.particle_count} particles each"
            )
        self.world_inverse_mass = self.upload_rows(1.0 / self.row_of("mass"))
        """Of shape [rows, particle_count]."""
        self.world_gravity = wp.array(self.row_of("gravity"), dtype=self.vector, device=self.device)
        """Of shape [rows]."""

    def _is_alike_by_direction(self, system: System) -> bool:
        """Tell whether in each world the connections of a direction are alike, as a stencil has them."""
        rows = [self.rows[name] for name in CONNECTIONS if name in self.rows and self.rows[name].strides[1] != 0]
        parts = [part for body in system.directions for part in body.values()]
        return all((values[:, part] == values[:, part][:, :1]).all() for values in rows for part in parts)

    @property
    def touching(self) -> BodyContactWorlds | None:
        """The contact between bodies; None where they do not touch."""
        return next((one for one in self.effects if isinstance(one, BodyContactWorlds)), None)

    @property
    def steady_force(self) -> NDArray[np.float64]:
        """The constant force on each particle [N], in all worlds, shape [particle_count, d]; or [0, d]."""
        for effect in self.effects:
            if isinstance(effect, Steady):
                return effect.sums[effect.data.combination.numpy()]
        return np.zeros((0, self.dim))

    @property
    def stride(self) -> int:
        """How far one world's particles lie from the next one's, in particles."""
        return -(-(self.particle_count + self.margin) // LINE) * LINE

    @property
    def different(self) -> int:
        """How many worlds there are that differ in anything; the others are like these, in turn."""
        return lcm(*map(len, self.rows.values()))

    def row_of(self, name: str) -> NDArray[np.float64]:
        """Return the rows of a parameter: one row where it is the same in all worlds."""
        if name in self.rows:
            return self.rows[name]
        if name == "gravity":
            return np.array(list(self.gravity), dtype=np.float64)[None]
        return getattr(self.system, name)[None]

    def upload_rows(self, values: NDArray[np.float64]) -> wp.array:
        """Upload numbers of shape [rows, count]; what is the same all along a row is stored once."""
        count, along = values.shape
        if along < 2 or values.strides[1] != 0:
            return wp.array(np.ascontiguousarray(values), dtype=self.scalar, device=self.device)
        once = wp.array(np.ascontiguousarray(values[:, 0]), dtype=self.scalar, device=self.device)
        size = wp.types.type_size_in_bytes(self.scalar)
        view = wp.array(
            ptr=once.ptr,
            dtype=self.scalar,
            shape=(count, along),
            strides=(size, 0),
            device=self.device,
            capacity=once.capacity,
        )
        view._ref = once  # a view does not own its memory
        return view

    @property
    def vectors_each(self) -> int:
        """Vectors in an array of them: one for each particle of each world, and the margins between worlds.

        World w begins at w times `stride`.
        """
        return self.worlds * self.stride

    @property
    def stride_in_bytes(self) -> int:
        """The same as `stride`, in bytes."""
        return self.stride * record_length(self.dim) * wp.types.type_size_in_bytes(self.scalar)

    def by_world(self, vectors: wp.array) -> NDArray:
        """Return what `vectors` holds, on the host: a copy of shape [worlds, particle_count, d]."""
        flat = vectors.numpy().reshape(self.worlds, self.stride, self.dim)
        return np.array(flat[:, : self.particle_count])

    def spread(self, values: NDArray) -> NDArray:
        """Return vectors of shape [rows, particle_count, d] as `vectors` holds them for all worlds."""
        flat = np.zeros((self.worlds, self.stride, self.dim), dtype=values.dtype)
        rows = len(values)
        flat.reshape(self.worlds // rows, rows, self.stride, self.dim)[:, :, : self.particle_count] = values
        return flat.reshape(-1, self.dim)

    def start(self, method_state: int) -> State:
        """Return the state in which all worlds start."""
        state = State(self, method_state)
        for name, field in (("x", "position"), ("v", "velocity")):
            exact = self.row_of(field)
            rounded = exact.astype(self.dtype)
            getattr(state.state_in, name).assign(self.spread(rounded))
            if self.compensated:  # what rounding takes from the start is not lost either
                compensation = self.spread((rounded - exact).astype(self.dtype))
                for array in {
                    getattr(instant.compensation, name) for instant in (state.state_in, state.state_out)
                }:
                    array.assign(compensation)
        return state

    def _check_effects(self) -> None:
        """Raise ValueError for what acts in the scene and worlds cannot have."""
        if self.system.yields:
            raise ValueError("system yields (yield_strain); in an ensemble connections must not yield yet")
        if self.system.tears:
            raise ValueError(
                "system can tear (break_strain, broken); in an ensemble connections must not break yet"
            )
        for effect in self.effects:
            if isinstance(effect, Steady | BodyContactWorlds):
                continue
            if isinstance(effect, Work) and effect.is_of_potentials:
                continue
            if not isinstance(effect, Colliders):
                raise ValueError(
                    f"the scene has {type(effect).__name__.lower()}, which worlds of an ensemble cannot have yet; "
                    "what acts must be springs, dampers, gravity, constant forces, contact between bodies, and "
                    "obstacles that stand still"
                )
            if effect.moves:
                raise ValueError("an obstacle moves; in an ensemble all must stand still yet")

    def _check_starts(self, colliders: Sequence[Collider]) -> None:
        """Raise ValueError where worlds start inside obstacles, each in its own way.

        What leads them out is one for all. So the scene may start inside one, where all worlds start alike.
        """
        if not colliders or not {"position", "rest_length", "mass"} & self.rows.keys():
            return
        places = self.row_of("position")
        depths = start_depths(places.reshape(-1, self.dim), colliders).max(axis=0).reshape(places.shape[:2])
        depths = np.where(np.isfinite(self.row_of("mass")).any(axis=0), depths, 0.0)
        if depths.max() > touching(self.system):
            row, particle = np.unravel_index(np.argmax(depths), depths.shape)
            raise ValueError(
                f"particle {particle} of world {row} starts {depths.max():.3g} m inside an obstacle; where "
                "positions, rest lengths or masses differ between worlds, all particles must start outside"
            )
