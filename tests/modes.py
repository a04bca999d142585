"""Linear theory of each method, mode by mode, and runs that are compared with it.

A mode of a body with proportional damping, b = r k, obeys x'' = −p x − q x' with q = r p. With u = h v,
α = h² p and β = h q a substep multiplies (x, u) by a matrix that depends on nothing else: below it is derived
from what each method does on paper.
"""

import functools
import math
from typing import Any

import numpy as np
import problems
import warp as wp
from scipy.optimize import brentq

from msdwarp import RK4, RKC2, ExplicitEuler, Integrator, Leapfrog, SymplecticEuler, System, box, sheet
from msdwarp.engine.model.state import State
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.engine.stepping.substep import take_stage
from msdwarp.engine.stepping.velocities import Velocities
from msdwarp.world import Problem

METHODS = {
    "symplectic euler": SymplecticEuler(),
    "leapfrog": Leapfrog(),
    "leapfrog extrapolated": Leapfrog(damper_extrapolation=0.5),
    "rk4": RK4(),
    "rkc2": RKC2(stages=3),
    "explicit euler": ExplicitEuler(),
}


def rkc2_matrix(stages: int, z: np.ndarray) -> np.ndarray:
    """Return R(z) = a + b T_s(w0 + w1 z) of Sommeijer, Shampine & Verwer (1997), ε = 2/13, of a matrix z.

    T_s(cosh θ) = cosh sθ gives T and T'; T'' follows from (1 − x²) T'' − x T' + s² T = 0; R = 1, R' = 1 and
    R'' = 1 at 0 (order 2) give b, w1 and a.
    """
    s, w0 = stages, 1 + 2 / 13 / stages**2
    theta = math.acosh(w0)
    t, slope = math.cosh(s * theta), s * math.sinh(s * theta) / math.sinh(theta)
    bend = (w0 * slope - s * s * t) / (1 - w0 * w0)
    w1, b = slope / bend, bend / slope**2
    one = np.eye(len(z))
    argument = w0 * one + w1 * z
    before, now = one, argument
    for _ in range(s - 1):
        before, now = now, 2 * argument @ now - before
    return (1 - b * t) * one + b * now


def amplification(method: Integrator, alpha: float, beta: float) -> np.ndarray:
    """Return the matrix of a substep for (x, u), or for (x, u, u seen by dampers) where they see another."""
    z = np.array([[0.0, 1.0], [-alpha, -beta]])
    match method:
        case Leapfrog(damper_extrapolation=0.5):
            # u' = u − α x − β w, x' = x + u', w' = 1.5 u' − 0.5 u
            kick, drift = np.array([-alpha, 1.0, -beta]), np.array([1.0, 0, 0])
            return np.array([drift + kick, kick, 1.5 * kick - [0, 0.5, 0]])
        case SymplecticEuler() | Leapfrog():
            kick = np.array([-alpha, 1 - beta])  # u' = u − α x − β u, x' = x + u'
            return np.array([[1 - alpha, 1 - beta], kick])
        case ExplicitEuler():
            return np.eye(2) + z
        case RK4():
            return np.eye(2) + z @ (np.eye(2) + z / 2 @ (np.eye(2) + z / 3 @ (np.eye(2) + z / 4)))
        case RKC2():
            return rkc2_matrix(method.evaluations, z)
    raise AssertionError(method)


def radius(method: Integrator, h: float, p: float, q: float) -> float:
    """Return the spectral radius of a substep."""
    return float(np.abs(np.linalg.eigvals(amplification(method, h * h * p, h * q))).max())


@functools.cache
def limit(method: Integrator, p: float, q: float) -> float:
    """Return the first h at which the spectral radius leaves 1."""

    def excess(h: float) -> float:
        return radius(method, h, p, q) - 1 - 1e-11

    trials = np.geomspace(1e-4, 30, 800) / max(math.sqrt(p), q)
    past = next(k for k, h in enumerate(trials) if excess(h) > 0)
    return brentq(excess, trials[past - 1], trials[past], rtol=1e-13)


class Mode:
    """The fastest mode of a body at rest, and a substep by substep run that it is seeded in."""

    def __init__(self, system: System) -> None:
        unit = problems.rate_matrix(system, system.stiffness)
        rates, shapes = np.linalg.eigh(unit)
        self.system, self.free = system, np.isfinite(system.mass)
        self.p, self.shape = float(rates[-1]), shapes[:, -1].reshape(-1, system.dim)
        stiff = system.stiffness > 0
        ratio = (system.damping[stiff] / system.stiffness[stiff])[0]
        assert np.allclose(system.damping, ratio * system.stiffness, rtol=1e-14)  # proportional
        self.q = float(ratio) * self.p
        self.root = np.sqrt(system.mass[self.free])[:, None]
        self.scale = np.abs(self.shape / self.root).max()

    def place(self, amount: float) -> np.ndarray:
        """Return the vectors of all particles in the mode, the largest coordinate being `amount`."""
        vectors = np.zeros(self.system.position.shape)
        vectors[self.free] = amount / self.scale * self.shape / self.root
        return vectors

    def amount(self, vectors: np.ndarray) -> float:
        """Return how much of the mode is in the vectors of all particles, in the same unit."""
        return self.scale * float((self.root * vectors[self.free] * self.shape).sum())

    def run(self, method: Integrator, h: float, steps: int, start: np.ndarray) -> np.ndarray:
        """Return (x, u[, u seen]) of the mode before and after every substep; shape [steps + 1, 2 or 3]."""
        run = Run(self.system, method, h)
        run.state.x.assign(self.system.position + self.place(start[0]))
        run.state.v.assign(self.place(start[1] / h))
        if len(start) == 3:
            run.state.state_in.method_state[0].assign(self.place(start[2] / h))
        found = [start]
        for _ in range(steps):
            run.step()
            x = self.amount(run.state.x.numpy() - self.system.position)
            parts = [run.state.v, *run.state.state_in.method_state] if len(start) == 3 else [run.state.v]
            found.append(np.array([x, *(h * self.amount(part.numpy()) for part in parts)]))
        return np.array(found)


class Run:
    """Substeps launched one by one in float64, without gravity; h may be negative."""

    def __init__(
        self, system: System, method: Integrator, h: float, *, gravity: Any = 0.0, device: str = "cpu"
    ) -> None:
        self.method, self.h = method, h
        self.assembly = assemble(Problem(system=system, gravity=gravity), device=device, precision="float64")
        self.state, self.dynamics = (
            State.from_system(system, self.assembly.model, method.method_state),
            Dynamics(self.assembly),
        )
        self.work = method.workspace(self.state)
        self.velocities = Velocities(self.dynamics, self.state, method.lag * h, method.staggered)
        self.velocities.start()

    def step(self, steps: int = 1) -> None:
        for _ in range(steps):
            for stage in self.method.substep(self.state, self.work, self.h):
                take_stage(self.dynamics, stage)
            self.state.flip()
        self.velocities.given = False

    def velocity(self) -> wp.array:
        """Return the velocities at the instant of the positions."""
        return self.velocities.read()


@functools.cache
def fastest(name: str) -> Mode:
    """Return the fastest mode of a scene below."""
    return Mode(SCENES[name]())


def _contrast(mass_outside: float, mass_inside: float) -> System:
    """Return a cube with a particle of another mass in its middle."""
    mass = np.full(27, mass_outside)
    mass[13] = mass_inside
    return box((3, 3, 3), mass=mass, stiffness=1000.0, damping=2.0)


SCENES = {  # small bodies with the constants of the report's scenes
    "mattress": lambda: box((8, 4, 2), stiffness=5000.0, damping=20.0),
    "die": lambda: box((3, 3, 3), stiffness=1e5, damping=20.0),
    "worm": lambda: box((20, 2, 2), stiffness=1e5, damping=20.0),
    "cloth": lambda: sheet((9, 9), stiffness=1e4, damping=20.0).pin([72, 76, 80]),
    "jelly": lambda: box((5, 5, 5), stiffness=2200.0, damping=0.1),
    "soft cube": lambda: box((5, 5, 5), stiffness=70.0, damping=80.0),
    "light among heavy": lambda: _contrast(1.0, 1e-3),
    "heavy among light": lambda: _contrast(1e-3, 1.0),
}
