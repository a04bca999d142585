"""Effect: what acts in a scene beside springs, dampers and gravity."""

from collections.abc import Mapping
from typing import Any

import warp as wp
from numpy.typing import NDArray

from ..kernels.contact import Contact as ContactPiece
from ..kernels.effect import Piece


class Effect:
    """What acts in a scene beside springs, dampers and gravity.

    An effect is one file in this room, one in kernels, and one line in `engine.effects`, which finds out whether a
    scene has it: a scene without it compiles, stores and launches nothing of it. The stepper, checkpoints, the
    watch and the measures each call every effect; an effect overrides what concerns it and leaves the rest.
    """

    piece: Piece | ContactPiece | None
    """What it adds to kernels; None where the routes to the forces do it."""
    data: Any
    """The struct that the kernels read; it may be replaced in `begin` and `begin_substep`."""
    works: bool = False
    """Whether it may do work on the bodies, so that energy that grows is no sign of divergence."""

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of so many substeps of `dt` seconds."""

    def begin_frame(self, time: float) -> None:
        """Prepare for the frame that begins at `time` [s]: on the host, before the frame's graph is launched."""

    def begin_substep(self, substep: int) -> bool:
        """Prepare for what is launched in a substep of a frame, counted from 0; return whether `data` changed."""
        return False

    @property
    def changing(self) -> list[wp.array]:
        """Arrays that substeps change: what going back to the start of a frame must bring back."""
        return []

    def checkpoint(self) -> dict[str, NDArray]:
        """Return what substeps have changed, by name, in an order that is the same on any device."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Take back what `checkpoint` gave."""

    def changed_fields(self) -> dict[str, NDArray]:
        """Return the fields of the system that the run has changed, as they are now."""
        return {}

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array) -> None:
        """Add to the bound of the rates the stiffness [N/m] and damping [N s/m] that it holds particles with.

        The arrays hold the diagonal blocks A_i and B_i of `integrators.stability`, float64 matrices of shape
        [particle_count], for particles at x. The bound is twice the largest eigenvalue of a block over the mass.
        """

    def energy(self, x: wp.array) -> float:
        """Return the energy that it stores when the particles are at x [J]."""
        return 0.0

    def dissipated_power(self, x: wp.array, v: wp.array) -> float:
        """Return what it turns to heat when the particles are at x and move at v [W]."""
        return 0.0
