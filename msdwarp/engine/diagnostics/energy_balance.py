"""The energy balance of a run: an energy that the method conserves exactly, so that any growth is visible.

`simulation/substep_controller.py` chooses the number of substeps by this balance.
"""

from typing import Any, NamedTuple

import numpy as np

from ...kernels.reductions import columns
from ..model.model import Model
from ..model.state import State
from ..stepping.assemble import Assembly
from ..stepping.dynamics import Dynamics
from ..stepping.velocities import kicked
from .energies import Sums
from .rate_bounds import effect_stiffness
from .readout import Found

FEW = 32**3
"""With fewer particles the balance is summed in every frame: on a GPU this is faster than separate launches."""


class EnergyBalance(NamedTuple):
    """Energies of a state that show whether energy grows."""

    energy: float
    """Kinetic, elastic, gravitational and other stored energy, as conserved by the method, minus work [J]."""
    swing: float
    """Physical energy minus the energy that the method conserves [J]."""
    inner: float
    """Kinetic energy about the centre of mass plus elastic and other stored energy [J]."""
    kinetic: float
    """Kinetic energy [J]."""
    free: float
    """Kinetic plus gravitational energy, minus work [J]."""
    strain: float
    """Largest |l / l0 − 1|."""
    work: float = 0.0
    """Work of loads, drives and moving obstacles [J]; that of drives and obstacles to first order in the step."""
    within: float = 0.0
    """Scale of energies within the last frame, if known [J]: all may vanish at its end."""

    @property
    def scale(self) -> float:
        """The scale of the energies [J]: at least the external work, whose error is of first order.

        Motion of the whole body has a small weight, since it is not internal energy.
        """
        return max(self.inner + 0.05 * self.kinetic, abs(self.work))


class EnergySums:
    """Computes the energy balance of a state, by sums that can be recorded.

    v += h a(x), x += h v conserves ½ Σ m v_(n−½)·v_(n+½) + U(x_n) exactly in linear motion, up to the limit of
    stability; docs/stability.md derives it. If v is the mean of both velocities, this energy is K(v) + U minus the
    `swing` ½ Σ m |v − v_(n−½)|². Other methods can only decrease K + U. The work of a force over a substep is
    h f_n·(v_(n−½) + v_(n+½))/2. With half of the last one, (h/2) f_n·v_(n−½), energy minus work is constant too.

    `lag` is the time by which velocities lag behind positions [s]: h/2 here, 0 for methods without a lag.
    """

    def __init__(self, dynamics: Dynamics, state: State, lag: float) -> None:
        self._dynamics, self._state, self._lag = dynamics, state, lag
        self._model, work = dynamics.model, dynamics.assembly.external_work
        self._work: Any = work
        self._half_kick = work.half_kick if work is not None and lag else None
        self._sums = Sums(dynamics.assembly, more=self._half_kick and self._half_kick.done)
        self._mass = mass(self._model)
        self._v = state.model.vectors() if lag else state.v
        self._storing = [one for one in dynamics.assembly.all if one.overrides("energies_and_powers")]

    def launch(self, found: Found) -> None:
        """Launch the sums of the balance, and of `DivergenceMonitor.look`; a graph may record both."""
        now = self._state.state_in
        if self._half_kick is not None:
            self._half_kick.done.zero_()
            setattr(self._dynamics.scene, self._work.field, self._half_kick)
        try:
            if self._lag:
                kicked(self._dynamics, self._state, self._lag, self._v)
        finally:
            if self._half_kick is not None:
                setattr(self._dynamics.scene, self._work.field, self._work.data)
        self._sums.launch(now.x, now.v, self._v, now.compensation.x, found.state_out)

    def balance(self, found: list[float]) -> EnergyBalance:
        """Return the balance of the current state, from the sums in `found`."""
        model, kinetic, elastic = self._model, found[columns.MEAN_KINETIC], found[columns.ELASTIC]
        work = 0.0 if self._work is None else float(self._work.before[0]) + found[columns.WORK]
        free, swing = kinetic + found[columns.POTENTIAL] - work, found[columns.SWING]
        now = self._state.x, self._state.v
        stored = sum(float(one.energies_and_powers(*now)[0][0]) for one in self._storing)
        energy = free + elastic + stored - swing
        together = 0.0
        if not model.pinned:
            momentum = found[columns.MOMENTUM : columns.MOMENTUM + model.dim]
            together = 0.5 * sum(one * one for one in momentum) / self._mass
        # Cells of negative modulus store less than nothing; the springs beside them then store more.
        inner = max(kinetic - together, 0.0) + elastic + max(stored, 0.0)
        return EnergyBalance(energy, swing, inner, kinetic, free, found[columns.STRAIN], work)


def is_told_by_frames(dynamics: Dynamics) -> bool:
    """Return whether computing the balance in each frame is faster than on request."""
    model = dynamics.model
    few = model.particle_count < FEW and not model.in_worlds
    return model.device.is_cuda and few and not dynamics.launches_before_forces


def mass(model: Model) -> Any:
    """Return the mass of the free particles [kg]; in an ensemble for each world, as in the functions below."""
    rows = model.row_of("mass")
    return model.of_each(np.where(np.isfinite(rows), rows, 0.0).sum(axis=1))


def weight(model: Model) -> Any:
    """Return the weight of the free particles [N], in an ensemble of each world."""
    falling = model.row_of("gravity")
    if model.falling is not None:  # only the magnitude matters
        falling = model.falling.at(np.zeros(1), model.dim)
    return mass(model) * model.of_each(np.linalg.norm(falling, axis=1))


def potential(model: Model, state: State) -> float:
    """Return the gravitational energy −Σ m g·x of the free particles [J], in a single world."""
    free = np.isfinite(model.mass)
    moment = np.where(free, model.mass, 0.0) @ state.x.numpy().astype(np.float64)
    return -float(moment @ np.array(list(model.gravity), dtype=np.float64))


def size(state: State) -> Any:
    """Return the largest extent of a system [m]; 1 m for a single particle."""
    extent = np.ptp(state.model.by_world(state.x.numpy()), axis=1).max(axis=1).astype(np.float64)
    return state.model.of_each(np.where(extent > 0, extent, 1.0))


def rounding_energy(assembly: Assembly, state: State) -> Any:
    """Return an allowance for rounding [J]: 1000 times the energy of springs and effects at rounded positions.

    The factor allows for rounding errors of many substeps, which add up. Compensated sums keep the rounding errors
    of positions, so only the lengths of springs are rounded; the energies of effects are measured without them.
    """
    model = assembly.model
    place = np.abs(model.by_world(state.x.numpy())).max(axis=(1, 2)).astype(np.float64)
    length = model.row_of("rest_length").max(axis=1) if model.compensated and model.connection_count else place
    springs, effects = model.row_of("stiffness").sum(axis=1), effect_stiffness(assembly, state)
    pairs = (springs, length), (effects, place)
    square = sum(model.of_each(stiffness) * model.of_each(off) ** 2 for stiffness, off in pairs)
    return 1e3 * float(np.finfo(model.dtype).eps) ** 2 * square
