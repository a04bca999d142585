"""The energy balance of a run: an energy that the method itself conserves, so that growth shows at once."""

from typing import NamedTuple

import numpy as np

from ..bodies import stored
from ..kernels.reductions import measure as columns
from .measures import Sums
from .model import Model
from .state import State


class Balance(NamedTuple):
    """What a state holds, as far as growth can be told from it."""

    energy: float
    """Kinetic, elastic, gravitational and other stored energy, as the method conserves it [J]."""
    inner: float
    """Kinetic energy about the centre of mass, and elastic energy [J]."""
    kinetic: float
    """Kinetic energy [J]."""
    free: float
    """Kinetic and gravitational energy, with the velocities as they are kept [J]."""
    strain: float
    """Largest |l / l0 − 1|."""


class Ledger:
    """Tells the balance of a state, of what the kernels sum on its device in one recorded go.

    v += h a(x), x += h v conserves ½ Σ m v_(n−½)·v_(n+½) + U(x_n) exactly in linear motion, up to the limit of
    stability; docs/stability.md derives it. As m v_(n+½) = m v_(n−½) + h f, that is K(v_(n−½)) + U + (h/2) Σ v·f.
    Methods of other kinds let K + U itself only fall.

    Parameters
    ----------
    model, state
        The system on a device.
    lag
        The time by which velocities lag behind positions [s]: h/2 above, 0 for methods that keep them together.
    """

    def __init__(self, model: Model, state: State, lag: float) -> None:
        self._model, self._state, self._lag = model, state, lag
        self._sums = Sums(model)
        self._mass = mass(model)

    def launch(self) -> None:
        """Launch what `balance` reads; it may be recorded."""
        self._sums.launch(self._state.x, self._state.v, self._state.lost.x)

    @np.errstate(over="ignore", invalid="ignore")  # of what has diverged nothing is finite
    def balance(self) -> Balance:
        """Return the balance of the state that `launch` found."""
        model = self._model
        particles, connections = self._sums.totals()
        kinetic, elastic = float(particles[columns.KINETIC]), float(connections[columns.ELASTIC])
        free = kinetic + float(particles[columns.POTENTIAL])
        energy = free + elastic + sum(effect.energy(self._state.x) for effect in model.effects)
        momentum = particles[columns.MOMENTUM :][: model.dim]
        if self._lag:
            g = np.array(list(model.gravity), dtype=np.float64)
            power = (g * momentum).sum() - connections[columns.STORING] - connections[columns.DISSIPATED]
            energy += self._lag * float(power)
        together = 0.0 if model.pinned else 0.5 * float((momentum * momentum).sum()) / self._mass
        inner = max(kinetic - together, 0.0) + elastic
        return Balance(energy, inner, kinetic, free, float(connections[columns.STRAIN]))


def mass(model: Model) -> float:
    """Return the mass of all that is not pinned [kg]."""
    each = model.system.mass
    one = stored(each)
    return float(one[np.isfinite(one)].sum() * (len(each) / len(one)))  # a mass stored once stands for all


def weight(model: Model) -> float:
    """Return the weight of all that is not pinned [N]."""
    return mass(model) * float(np.linalg.norm(np.array(list(model.gravity), dtype=np.float64)))


def size(state: State) -> float:
    """Return the largest extent of a system [m], at least a metre for a single particle."""
    return float(np.ptp(state.x.numpy(), axis=0).max()) or 1.0


def rounding_energy(model: Model, state: State) -> float:
    """Return what rounding may make of nothing [J]: every spring stretched by the rounding of its ends' places.

    A thousand times that, since rounding errors of many substeps add up.
    """
    off = float(np.finfo(model.dtype).eps) * float(np.abs(state.x.numpy()).max())
    stiffness = model.system.stiffness
    one = stored(stiffness)
    total = float(one.sum()) * (len(stiffness) / len(one) if len(one) else 0.0)
    return 1e3 * total * off**2
