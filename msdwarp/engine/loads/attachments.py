"""Attachments: particles held by springs to fixed or moving points, on a device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.loads.attachments import attachments
from ...world import Attachment, Load, MouseSpring, poses
from ..device.csr import rows
from ..device.device import upload_fields
from ..device.frame_tables import Tables
from ..model.effect import Elements, Parameter, summed
from ..model.model import Model
from ..model.stage_tables import FrameTables, exchanged

ASIDE = 0.01
"""Offset, in substeps, of the poses before and after a stage from which a carrier's velocity is computed."""


def attachments_of(model: Model, loads: Sequence[Load]) -> "AttachmentSprings | None":
    """Return the effect of the scene's attachments and mouse springs; None if it has neither."""
    named = [(f"loads[{k}]", one) for k, one in enumerate(loads) if isinstance(one, Attachment | MouseSpring)]
    return AttachmentSprings(model, named) if named else None


class AttachmentSprings(FrameTables):
    """The attachments of a scene."""

    def __init__(self, model: Model, named: Sequence[tuple[str, Attachment | MouseSpring]]) -> None:
        self._model = model
        self._named = [(name, one.bound(model.system)) for name, one in named]
        several: list[Any] = [one for _, one in self._named]
        self._hands = [one for one in several if isinstance(one, MouseSpring)]
        self._carriers = [
            (name, one.carried_by)
            for name, one in self._named
            if isinstance(one, Attachment) and one.carried_by is not None and one.carried_by.motion is not None
        ]
        self._moving = self.timed = bool(self._carriers)
        self.prescribed = [
            (f"{name}.carried_by", one.motion, one.center(model.dim)) for name, one in self._carriers
        ]
        self._damped = bool(self._hands) or any(one.damping for one in several)
        term, self._law, self._blocks, self._measure = attachments(
            model.dim,
            model.scalar,
            model.compensated,
            moving=self._moving,
            damped=self._damped,
            stretched=any(one.rest_length.any() for one in several),
        )
        model.kernels.note(self._blocks, self._measure)
        data = term.Data()
        self.term, self.data = term, data
        # A mouse spring may hold any particles, up to its capacity.
        held = [one.particles(model.system) for one in several]
        self.members = np.any(held, axis=0) if not self._hands else np.ones(model.particle_count, dtype=bool)
        size = sum(
            one.room if isinstance(one, MouseSpring) else int(mask.sum())
            for one, mask in zip(several, held, strict=True)
        )
        device = model.device
        numbers = ("member", "carrier", "rest_length", "stiffness", "damping")
        room = {name: np.zeros(size) for name in numbers} | {"point": np.zeros((size, model.dim))}
        upload_fields(data, device, first=np.zeros(model.particle_count + 1), **room)
        if self._moving:
            self.by_world = ("done",)
            self.done = data.done = wp.zeros((2 * model.worlds, size), dtype=wp.float64, device=device)
        self._fill_rows()

    def _fill_rows(self) -> None:
        """Upload the attached particles, their anchor points and springs, sorted by particle and then by load."""
        model, data = self._model, self.data
        several: list[Any] = [one for _, one in self._named]
        chosen = [np.flatnonzero(one.particles(model.system)) for one in several]
        counts = list(map(len, chosen))
        points, carrier, k = [], np.full(len(several), -1), 0
        self._turns = [np.eye(model.dim) for _ in several]
        for n, one in enumerate(several):
            to = np.asarray(one.to, dtype=np.float64).reshape(-1, model.dim)
            if k < len(self._carriers) and getattr(one, "carried_by", None) is self._carriers[k][1]:
                turns, shifts = self._poses(k, np.zeros(1))
                to = (to - shifts[0]) @ turns[0]  # in the carrier's given pose: y = Rᵀ (p − o)
                self._turns[n] = turns[0]
                carrier[n], k = k, k + 1
            points.append(to)
        order, first = rows(np.concatenate(chosen), model.particle_count)
        self._rows_of = np.split(np.argsort(order), np.cumsum(counts)[:-1])
        member = np.unique(np.concatenate(chosen))
        values = {
            "first": first,
            "member": member,
            "carrier": np.repeat(carrier, counts)[order],
            "point": np.concatenate(points)[order],
        }
        for name in ("rest_length", "stiffness", "damping"):
            of_each = zip(several, counts, strict=True)
            numbers = np.concatenate([np.broadcast_to(getattr(one, name), count) for one, count in of_each])
            values[name] = numbers[order]
        self._member_count = len(member)
        for name, numbers in values.items():
            if len(numbers):  # the rest of the array is unused
                array = getattr(data, name)
                source = wp.array(numbers, dtype=array.dtype, device="cpu")
                wp.copy(array, source, count=len(numbers))

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace mouse springs: the keys of `others` by their values."""
        if any(one in others for one in self._hands):
            before = self._named, self._hands
            self._named = exchanged(self._named, others)
            self._hands = [one for _, one in self._named if isinstance(one, MouseSpring)]
            try:
                self._fill_rows()
            except ValueError:  # raised before any row was filled
                self._named, self._hands = before
                raise
            if self.done is not None:  # rows now belong to other springs, but only the total work is used
                done = np.zeros(self.done.shape)
                done[0, 0] = self.done.numpy().sum()
                self.done.assign(done)

    def begin(self, substeps: int, dt: float) -> None:
        """Allocate tables for carriers' poses in a frame."""
        if not self._moving:
            return
        self.keep_work(dt)
        self.data.ahead = int(self.steps.lagging)
        shape, model = (len(self.steps.times(0.0)), len(self._carriers)), self._model
        turn = wp.types.matrix((model.dim, model.dim), model.scalar)
        kinds = {"turn": turn, "turning": turn, "shift": model.vector, "speed": model.vector}
        self.make_tables({name: (shape, kind) for name, kind in kinds.items()}, model.scalar, model.device)

    def hold(self, time: float) -> None:
        """Write the poses of the carriers at `time` [s] for all stages."""
        if self._frames is not None:
            self._frames.upload(lambda tables: self._write(tables, np.full(len(tables["shift"]), time)))

    def fill(self, time: float, tables: Tables) -> None:
        """Write the poses and velocities of the carriers in the frame that begins at `time`."""
        self._write(tables, self.steps.times(time))

    def _write(self, tables: Tables, times: NDArray[np.float64]) -> None:
        """Write the poses and velocities of the carriers at these times.

        If the method's velocities lag behind positions, a carrier's velocity is its mean over the last substep.
        """
        before, span = (1.0, 1.0) if self.steps.lagging else (ASIDE, 2 * ASIDE)
        start = np.maximum(times - before * self.steps.dt, 0.0)  # a motion may be undefined before 0
        span *= self.steps.dt
        at = np.concatenate([times, start, start + span])
        for k in range(len(self._carriers)):
            for names, values in zip((("turn", "turning"), ("shift", "speed")), self._poses(k, at), strict=True):
                now, then, later = np.split(values, 3)
                tables[names[0]][:, k], tables[names[1]][:, k] = now, (later - then) / span

    def _poses(self, k: int, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a carrier's poses (R, o) at these times; raise ValueError naming it if one is undefined."""
        name, carrier = self._carriers[k]
        assert carrier.motion is not None
        furthest = float(np.finfo(self._model.dtype).max) / 4
        return poses(f"{name}.carried_by", carrier.motion, carrier.center(self._model.dim), times, furthest)

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half of each attachment's stiffness and damping to the blocks, which the stability bound doubles."""
        outputs, threads = [stiffness, damping], self._member_count
        wp.launch(self._blocks, threads, [self.data], outputs, device=self._model.device)

    def elements(self) -> Elements | None:
        """Return the attachments as elements, for gradients; None if there are mouse springs."""
        if self._hands:
            return None
        first = self.data.first.numpy()
        particle = np.repeat(np.arange(len(first) - 1), np.diff(first))
        return Elements(self.data, self._law, particle[:, None], group=np.arange(len(particle)))

    def parameters(self) -> dict[str, Parameter]:
        """Return the parameters of each attachment, in the order of its particles' indices, for gradients."""
        found = dict[str, Parameter]()
        if self._hands:
            return found
        for (name, one), mine, turn in zip(self._named, self._rows_of, self._turns, strict=True):
            found[f"{name}.to"] = Parameter(lambda sums, mine=mine, turn=turn: sums[..., mine, 3:] @ turn.T)
            for n, word in enumerate(("stiffness", "damping")[: 1 + self._damped]):
                found[f"{name}.{word}"] = Parameter(lambda sums, mine=mine, n=n: sums[..., mine, n].sum(axis=-1))
            if isinstance(one, Attachment) and np.all(one.rest_length):  # with a rest length of 0 there is no axis
                found[f"{name}.rest_length"] = Parameter(lambda sums, mine=mine: sums[..., mine, 2])
        return found

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Σ k (|x − p| − l0)²/2 [J] and Σ b |v − u|² [W], with the carriers' poses at the frame's end.

        With a rest length, only the relative speed along the axis counts.
        """
        row = self.data.shift.shape[0] - 1 if self._moving else 0
        inputs = [self.data, row, x, v, self._model.stride]
        return summed(self._model, self._measure, self._member_count, inputs)
