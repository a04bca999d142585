"""Attaching: particles held by springs to points of the world, or of what moves in it, on a device."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.loads import attachments
from ..world import Attachment, Load, poses
from .effect import Effect
from .in_frames import InFrames, Tables
from .rows import rows

if TYPE_CHECKING:
    from .model import Model

ASIDE = 0.01
"""How far before and after a stage a carrier is looked at, to know how fast it is there, in substeps."""


def attaching(model: "Model", loads: Sequence[Load]) -> Effect | None:
    """Return the effect of the attachments among the loads of a scene, if there are any."""
    named = [(f"loads[{k}]", one) for k, one in enumerate(loads) if isinstance(one, Attachment)]
    return Attached(model, named) if named else None


class Attached(Effect):
    """The attachments of a scene."""

    def __init__(self, model: "Model", named: Sequence[tuple[str, Attachment]]) -> None:
        self._model = model
        several = [one.bound(model.system) for _, one in named]
        moving = [one.carried_by is not None and one.carried_by.motion is not None for one in several]
        self._carriers = [
            (name, one.carried_by)
            for (name, _), one, moves in zip(named, several, moving, strict=True)
            if moves and one.carried_by is not None
        ]
        self._moving = any(moving)
        # Of all attachments, load by load.
        chosen = [np.flatnonzero(one.particles(model.system)) for one in several]
        counts = list(map(len, chosen))
        particle, rest_length = np.concatenate(chosen), np.concatenate([one.rest_length for one in several])
        points = [np.asarray(one.to, dtype=np.float64) for one in several]
        carrier, k = np.full(len(several), -1), 0
        for n, moves in enumerate(moving):
            if moves:
                turns, shifts = self._poses(k, np.zeros(1))
                points[n] = (points[n] - shifts[0]) @ turns[0]  # as the carrier was given: y = Rᵀ (p − o)
                carrier[n], k = k, k + 1
        stiffness, damping = ([getattr(one, name) for one in several] for name in ("stiffness", "damping"))
        self._composed = attachments(
            model.dim,
            model.scalar,
            model.compensated,
            moving=self._moving,
            damped=any(damping),
            stretched=bool(rest_length.any()),
        )
        self.piece = self._composed.piece
        # On the device particle by particle; of each particle in the order of the loads.
        order, first = rows(particle, model.particle_count)
        self.members = np.diff(first) > 0
        data = self.data = self.piece.Data()
        integers = {
            "first": first,
            "member": np.flatnonzero(self.members),
            "carrier": np.repeat(carrier, counts)[order],
        }
        for name, values in integers.items():
            setattr(data, name, wp.array(values, dtype=int, device=model.device))
        place = np.concatenate(points)[order]
        model.check_range(place, "to")
        data.point = wp.array(place, dtype=model.vector, device=model.device)
        if self._moving:
            self.done = data.done = wp.zeros((2, len(order)), dtype=wp.float64, device=model.device)
        numbers = {
            "rest_length": rest_length,
            "stiffness": np.repeat(stiffness, counts),
            "damping": np.repeat(damping, counts),
        }
        for name, values in numbers.items():
            model.check_range(values, name)
            setattr(data, name, wp.array(values[order], dtype=model.scalar, device=model.device))

    def begin(self, substeps: int, dt: float) -> None:
        """Make room for the poses of the carriers in a frame."""
        if not self._moving:
            return
        self.data.ahead = int(self.steps.lagging)
        shape, model = (len(self.steps.times(0.0)), len(self._carriers)), self._model
        turn = wp.types.matrix((model.dim, model.dim), model.scalar)
        kinds = {"turn": turn, "turning": turn, "shift": model.vector, "speed": model.vector}
        tables = {name: (shape, kind) for name, kind in kinds.items()}
        self._frames = InFrames(tables, model.scalar, model.device, self._fill)
        for name, array in self._frames.arrays.items():
            setattr(self.data, name, array)

    def begin_frame(self, time: float) -> None:
        """Put the carriers where they are in the frame that begins at `time` [s]."""
        if self._moving:
            self._frames.begin_frame(time)

    def prepare(self, time: float) -> None:
        """Find out where the carriers are in the frame that begins at `time` [s], while another is running."""
        if self._moving:
            self._frames.prepare(time)

    def hold(self, time: float) -> None:
        """Have all stages see the carriers where they are at `time` [s]."""
        if self._moving:
            self._frames.upload(lambda tables: self._write(tables, np.full(len(tables["shift"]), time)))

    def _fill(self, time: float, tables: Tables) -> None:
        """Write where the carriers are in the frame that begins at `time`, and how fast."""
        self._write(tables, self.steps.times(time))

    def _write(self, tables: Tables, times: NDArray[np.float64]) -> None:
        """Write where the carriers are at these times, and how fast.

        Where velocities lag behind positions that is the way of the last substep over its time, as it is of all
        particles there.
        """
        before, span = (1.0, 1.0) if self.steps.lagging else (ASIDE, 2 * ASIDE)
        start = np.maximum(times - before * self.steps.dt, 0.0)  # a motion need not be defined before 0
        span *= self.steps.dt
        at = np.concatenate([times, start, start + span])
        for k in range(len(self._carriers)):
            for names, values in zip((("turn", "turning"), ("shift", "speed")), self._poses(k, at), strict=True):
                now, then, later = np.split(values, 3)
                tables[names[0]][:, k], tables[names[1]][:, k] = now, (later - then) / span

    def _poses(self, k: int, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (R, o) of a carrier at each time; raise ValueError that names it where its motion has none."""
        (name, carrier), dim = self._carriers[k], self._model.dim
        assert carrier.motion is not None
        furthest = float(np.finfo(self._model.dtype).max) / 4
        turn, shift = poses(f"{name}.carried_by", carrier.motion, carrier.centre(dim), times, furthest)
        return np.broadcast_to(np.eye(dim), (len(times), dim, dim)) if turn is None else turn, shift

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array) -> None:
        """Add half of what each holds its particle with: the bound doubles it, as for springs with two ends."""
        outputs, threads = [stiffness, damping], len(self.data.member)
        wp.launch(self._composed.add_blocks, threads, [self.data], outputs, device=self._model.device)

    def energy(self, x: wp.array) -> float:
        """Return Σ k (|x − p| − l0)²/2 [J]."""
        return self.energy_and_power(x, x)[0]

    def dissipated_power(self, x: wp.array, v: wp.array) -> float:
        """Return Σ b |v − u|², along the axis where there is a rest length [W]."""
        return self.energy_and_power(x, v)[1]

    def energy_and_power(self, x: wp.array, v: wp.array) -> tuple[float, float]:
        """Return what is stored and what turns to heat, where the carriers are as the frame ends."""
        count, device = len(self.data.member), self._model.device
        sums = [wp.zeros(count, dtype=wp.float64, device=device) for _ in range(2)]
        row = self.data.shift.shape[0] - 1 if self._moving else 0
        wp.launch(self._composed.measure, count, [self.data, row, x, v], sums, device=device)
        return float(sums[0].numpy().sum()), float(sums[1].numpy().sum())
