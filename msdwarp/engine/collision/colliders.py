"""Colliders: obstacles as arrays on a device, and the poses of moving ones in each substep."""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.basis import vector
from ...kernels.colliders.collide import ColliderTerm, collider_contact
from ...kernels.colliders.signed_distance import KINDS
from ...world import Capsule, Collider, Cone, Motion, Plane, poses
from ..device.frame_tables import Tables
from ..model.model import Model
from ..model.stage_tables import FrameTables
from .penetration_depth import describe, start_depths, touching, ways_out

LARGEST = 1e30
"""Largest number in a solid's geometry [m]: `msdwarp.kernels.colliders.signed_distance` starts its search for the
least depth at it."""
DEPENETRATION_TIME = 0.5
"""Time within which particles that start inside an obstacle are moved out [s]: slowly, to spare their springs."""
COEFFICIENTS = ("restitution", "friction", "tangential_factor", "rest_speed")


class Colliders(FrameTables):
    """Keeps the particles of a model out of obstacles, fixed or moving.

    `colliders` must have a rigid obstacle; the rigid ones act on a particle in the given order, by the `rule`
    "coulomb" or "report"; see `msdwarp.kernels.colliders.contact_rule`. If `contact_forces`, the forces of
    obstacles on particles are summed in `data.impulse`. `spared` marks particles that obstacles ignore, see
    `SurfaceContact`, and `radius` is that of each particle [m]; both have the shape [particle_count]. Raises
    ValueError if an entry is no collider, or has another number of dimensions than the system.
    """

    def __init__(
        self,
        model: Model,
        colliders: Sequence[Collider],
        rule: str,
        contact_forces: bool = False,
        spared: NDArray[np.bool_] | None = None,
        radius: NDArray[np.float64] | None = None,
    ) -> None:
        self._numbers = [k for k, collider in enumerate(colliders) if collider.stiffness is None]
        """Indices of the rigid obstacles among the scene's obstacles."""
        colliders = [colliders[k] for k in self._numbers]
        self.solids, self._dim, self._device = tuple(colliders), model.dim, model.device
        """The rigid obstacles."""
        self._scalar, self._vector = model.scalar, model.vector
        self._turn = wp.types.matrix((model.dim, model.dim), model.scalar)
        self._inverse_mass, self._furthest = model.inverse_mass, _furthest(model)
        self.moves = self.numbers_substeps = any(collider.motion is not None for collider in colliders)
        self.planes_only = all(isinstance(one, Plane) for one in colliders)
        """Whether all obstacles are planes, which need no swept test."""
        kinds = self.kinds = tuple(sorted({type(one).__name__ for one in colliders}, key=KINDS.index))
        self.spared = np.zeros(model.particle_count, dtype=bool) if spared is None else spared
        """Which particles obstacles ignore."""
        self.radius = np.zeros(model.particle_count) if radius is None else radius
        """Radii of the particles against obstacles [m]."""
        free, spares = np.isfinite(model.mass) & ~self.spared, bool(self.spared.any())
        inside, self.leads_out = _deepest(model, colliders, free, self.radius), rule == "coulomb"
        self.overlap = inside > 0.0
        """Whether a free particle starts inside an obstacle."""
        self._deepest = inside if self.leads_out else 0.0
        self.overlapping_at_start, self._release_time = self._deepest > 0.0, DEPENETRATION_TIME
        self._put_out = _put_out(model, colliders, free, self.radius) if inside > self._deepest else None
        how = self.moves, contact_forces, self.overlapping_at_start
        several, round_particles = len(colliders) > 1, bool(self.radius.any())
        composed = collider_contact(model.dim, model.scalar, rule, kinds, several, *how, round_particles)
        self.term = ColliderTerm(*composed, *how, spares, round_particles)
        self.contact_forces = contact_forces
        data = self.data = self.term.Colliders()
        if spares:
            data.spared = wp.array(self.spared.astype(np.int32), device=self._device)
        if round_particles:
            data.radius = wp.array(self.radius, dtype=model.scalar, device=self._device)
        if self.overlapping_at_start:
            data.inverse_mass = self._inverse_mass
        if self.moves:
            count = model.worlds * model.particle_count
            self.done = data.done = wp.zeros(count, dtype=wp.float64, device=self._device)
        self.by_world = (*("done",) * self.moves, *("impulse",) * contact_forces)
        data.count = len(colliders)
        if contact_forces:
            wide = vector(model.dim, wp.float64)
            data.impulse = wp.zeros(model.worlds * model.particle_count, dtype=wide, device=self._device)
        for k, collider in zip(self._numbers, colliders, strict=True):
            _check_range(f"colliders[{k}]", collider, model)
        describe(data.solids, self.solids, model.dim, model.scalar, self._device)
        if kinds != ("Plane",):
            data.inradius = min(collider.inradius() for collider in colliders)
        for name in COEFFICIENTS:
            values = [float(getattr(collider, name)) for collider in colliders]
            setattr(data.surface, name, wp.array(values, dtype=model.scalar, device=self._device))
        if self.overlapping_at_start:
            data.surface.slack = touching(model.system)
        self._moving: list[tuple[int, Motion, NDArray]] = [
            (k, collider.motion, collider.center(self._dim))
            for k, collider in enumerate(colliders)
            if collider.motion is not None
        ]
        self.prescribed = [(f"colliders[{self._numbers[k]}]", one, at) for k, one, at in self._moving]
        self.timed = bool(self.prescribed)

    def brings_in(self, model: Model) -> NDArray[np.float64]:
        """Return an estimate of the energy that depenetration adds [J], for each row of a model's parameters."""
        mass = model.row_of("mass")
        moving = np.where(np.isfinite(mass), mass, 0.0).sum(axis=1) * (self._deepest / DEPENETRATION_TIME) ** 2
        if self._put_out is None:
            return moving
        i, j = model.system.connections.T
        stretch = np.linalg.norm(self._put_out[j] - self._put_out[i], axis=1) - model.system.rest_length
        return 0.5 * model.row_of("stiffness") @ stretch**2

    def release_overlap_within(self, seconds: float) -> None:
        """Move out particles that start inside obstacles within a time [s], instead of DEPENETRATION_TIME."""
        self._release_time = seconds

    def begin(self, substeps: int, dt: float) -> None:
        """Allocate the poses of a frame."""
        # A velocity half a substep behind is a displacement / dt.
        self.data.surface.onward = 2.0 * self.steps.lag
        if self.overlapping_at_start:
            self.data.surface.overlap_release_speed = self._deepest * dt / self._release_time
        if not self.moves:
            return
        shape = (substeps + 1, len(self.solids))
        kinds = {"turn": self._turn, "shift": self._vector, "turning": self._turn, "speed": self._vector}
        layout = {name: (shape, kind) for name, kind in kinds.items()}
        tables = self.make_tables(layout, self._scalar, self._device)
        tables["turn"][:] = np.eye(self._dim)  # never changed for obstacles that do not turn
        self.data.inverse_mass = self._inverse_mass
        self._dt, self._times = dt, dt * np.arange(-1, max(substeps, 2) + 1)

    def fill(self, time: float, tables: Tables) -> None:
        """Write the poses of the frame that begins at `time` [s]: one for each substep, and one for its end.

        Beside each is written the mean velocity in the substep before.
        """
        for k, motion, centre in self._moving:
            turn, shift = self._poses(k, motion, centre, time)
            tables["shift"][:, k], tables["speed"][:, k] = shift[1:], (shift[1:] - shift[:-1]) / self._dt
            tables["turn"][:, k], tables["turning"][:, k] = turn[1:], (turn[1:] - turn[:-1]) / self._dt

    def _poses(self, k: int, motion: Motion, centre: NDArray, time: float) -> tuple[NDArray, NDArray]:
        """Return rotations and shifts from one substep before `time` to the frame's end."""
        times, rows = time + self._times, self.data.turn.shape[0] + 1
        first = times[0] < 0
        now = times[1:] if first else times[:rows]
        turn, shift = poses(f"colliders[{self._numbers[k]}]", motion, centre, now, self._furthest)
        if first:  # a motion may be undefined before 0: extrapolate with equal acceleration
            turn, shift = _with_a_past(turn)[:rows], _with_a_past(shift)[:rows]
        return turn, shift

    def hold_still(self, time: float) -> None:
        """Fix obstacles at their poses at `time` [s] until a frame begins, for measurements between frames."""
        if self._frames is not None:
            self._frames.upload(lambda tables: self._fill_still(time, tables))

    def _fill_still(self, time: float, tables: Tables) -> None:
        """Write for all substeps the pose at `time` [s], and the mean velocity in the substep before that."""
        self.fill(time, tables)
        for table in tables.values():
            table[1:] = table[:1]

    def begin_substep(self, substep: int) -> bool:
        """Select the poses of this substep for the next launches, if any obstacle moves."""
        if self.moves:
            self.data.substep = substep
        return self.moves


def _deepest(model: Model, colliders: Sequence[Collider], free: NDArray[np.bool_], radius: NDArray) -> float:
    """Return the largest depth of a free particle in an obstacle at the start [m]; 0 if none is inside."""
    places = model.system.position[free]
    deepest = float(start_depths(places, colliders, radius[free]).max(initial=0.0))
    return deepest if deepest > touching(model.system) else 0.0


def _put_out(
    model: Model, colliders: Sequence[Collider], free: NDArray[np.bool_], radius: NDArray
) -> NDArray[np.float64]:
    """Return the positions of particles after moving free ones inside obstacles onto their surfaces [m]."""
    position = np.array(model.system.position)
    for collider in colliders:
        inside = free & (start_depths(position, [collider], radius)[0] > 0)
        if inside.any():
            position[inside] += ways_out(position[inside], collider, radius[inside])
    return position


def _with_a_past(poses: NDArray) -> NDArray:
    """Prepend the pose one substep earlier, extrapolated by a parabola through the first three poses."""
    return np.concatenate([[3 * poses[0] - 3 * poses[1] + poses[2]], poses])


def _furthest(model: Model) -> float:
    """Return the largest coordinate that solids may have in the model's precision [m]."""
    # A distance is the root of a sum of at most 4 squares of sums of 2 numbers.
    return min(LARGEST, math.sqrt(float(np.finfo(model.dtype).max)) / 4)


def _check_range(name: str, collider: Collider, model: Model) -> None:
    """Raise ValueError for a capsule or cone whose ends coincide in the model's precision."""
    least, where = float(np.finfo(model.dtype).tiny), f"in {model.precision}"
    if isinstance(collider, Capsule | Cone):
        geometry = collider.geometry(model.dim)
        a, b = (np.asarray(geometry[end], dtype=model.dtype).astype(np.float64) for end in "ab")
        if float((b - a) @ (b - a)) < least:
            first, second = collider.places
            raise ValueError(
                f"{name}.{second} is {getattr(collider, second)}; it must be further from {first}, "
                f"{getattr(collider, first)}: {where} both are one point"
            )
