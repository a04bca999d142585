"""Problems with known solutions, and plain NumPy references that share no code with the package."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import msdwarp
from msdwarp import RK4, Integrator, Leapfrog, Simulation, SymplecticEuler, System

EPS32 = float(np.finfo(np.float32).eps)
EPS64 = float(np.finfo(np.float64).eps)


def two_quick(methods: list[Integrator]) -> list:
    """Return methods as parameters of a test whose kernels are its own: all but two of them are slow."""
    quick = SymplecticEuler, RK4  # of one stage, and of several
    return [one if isinstance(one, quick) else pytest.param(one, marks=pytest.mark.slow) for one in methods]


def triangle(**changes) -> System:
    """Return three joined particles in the plane, with any argument replaced."""
    arguments = {
        "position": [[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]],
        "connections": [[0, 1], [1, 2], [2, 0]],
        "mass": [1.0, 2.0, 3.0],
    }
    return System(**(arguments | changes))


@dataclass(frozen=True)
class Oscillator:
    """Two free particles of mass m joined along `axis`; relative motion is a damped oscillator.

    With the reduced mass m/2 the extension e obeys e'' + 2γ e' + ω² e = 0, ω² = 2k/m and γ = b/m.
    """

    m: float = 0.5
    k: float = 40.0
    b: float = 0.0
    rest_length: float = 2.0
    extension: float = 0.3
    axis: tuple[float, ...] = (2 / 3, -1 / 3, 2 / 3)

    @property
    def omega(self) -> float:
        return math.sqrt(2 * self.k / self.m)

    @property
    def gamma(self) -> float:
        return self.b / self.m

    def system(self) -> System:
        half = np.array(self.axis) * (self.rest_length + self.extension) / 2
        return System(
            position=[half, -half],
            mass=self.m,
            connections=[[0, 1]],
            rest_length=self.rest_length,
            stiffness=self.k,
            damping=self.b,
        )

    def exact(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities at t of the underdamped oscillator released at rest."""
        w = math.sqrt(self.omega**2 - self.gamma**2)
        decay = self.extension * math.exp(-self.gamma * t)
        e = decay * (math.cos(w * t) + self.gamma / w * math.sin(w * t))
        e_dot = -decay * self.omega**2 / w * math.sin(w * t)
        signs = np.array([[0.5], [-0.5]])
        axis = np.array(self.axis)
        return signs * (self.rest_length + e) * axis, signs * e_dot * axis


def chain_mode(count: int, mode: int, *, m: float, k: float) -> tuple[float, np.ndarray]:
    """Return (ω, shape) of a mode of a free chain in one dimension; the shape has maximum norm ≤ 1.

    ω = 2 √(k/m) sin(π mode / 2 count), shape_i = cos(π mode (i + ½) / count).
    """
    omega = 2 * math.sqrt(k / m) * math.sin(math.pi * mode / (2 * count))
    return omega, np.cos(math.pi * mode * (np.arange(count) + 0.5) / count)


def tumbling_box(*, damping: float = 0.0) -> System:
    """Return a small block, distorted, stretched and spinning: large motions and a nonlinear force."""
    block = msdwarp.box((2, 2, 2), spacing=0.5, mass=0.2, stiffness=10.0, damping=damping)
    random = np.random.default_rng(1)
    noise = random.uniform(-0.05, 0.05, block.position.shape)
    return block.replace(position=1.1 * block.position + noise).spin((1.0, 2.0, -0.5))


def cut(lattice: System, keep: np.ndarray) -> System:
    """Return what is left of a lattice when only some particles are kept, numbered anew without gaps."""
    number = np.cumsum(keep) - 1
    kept = keep[lattice.connections].all(axis=1)
    directions, start = {}, 0
    for name, part in lattice.directions[0].items():
        directions[name] = slice(start, start + np.count_nonzero(kept[part]))
        start = directions[name].stop
    return System(
        position=lattice.position[keep],
        velocity=lattice.velocity[keep],
        mass=lattice.mass[keep],
        connections=number[lattice.connections[kept]],
        rest_length=lattice.rest_length[kept],
        stiffness=lattice.stiffness[kept],
        damping=lattice.damping[kept],
        directions=(directions,),
    )


def ball(across: int, **constants: float) -> System:
    """Return the particles of a box, `across` along each edge, that lie in the sphere that touches its faces."""
    block = msdwarp.box((across,) * 3, **constants)
    return cut(block, np.linalg.norm(block.position, axis=1) < (across - 1) / 2 + 0.1)


def forces(system: System, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the force on every particle [N]: the report's eq. 7 over the connections, in float64."""
    i, j = system.connections.T
    dx, dv = x[i] - x[j], v[i] - v[j]
    length = np.sqrt((dx * dx).sum(axis=1))
    axis = dx / length[:, None]
    tension = -system.stiffness * (length - system.rest_length) - system.damping * (dv * axis).sum(axis=1)
    total = np.zeros_like(x)
    np.add.at(total, i, tension[:, None] * axis)
    np.add.at(total, j, -tension[:, None] * axis)
    return total


def acceleration(system: System, x: np.ndarray, v: np.ndarray, gravity: float) -> np.ndarray:
    """Return the acceleration of every particle [m/s²]; gravity points down the last coordinate."""
    a = forces(system, x, v) / system.mass[:, None]
    a[:, -1] -= gravity
    a[np.isinf(system.mass)] = 0.0
    return a


def symplectic_euler_loop(
    system: System,
    *,
    gravity: float,
    h: float,
    steps: int,
    floor: float | None = None,
    restitution: float = 0.0,
    rest_speed: float = 0.01,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (x, v) after `steps` of semi-implicit Euler, optionally over a frictionless floor."""
    x, v = system.position.copy(), np.array(system.velocity)
    for _ in range(steps):
        v_old = v
        v = v + h * acceleration(system, x, v, gravity)
        x_before = x
        x = x + h * v
        if floor is not None:
            for n in np.flatnonzero((x[:, -1] < floor) & (v[:, -1] < 0)):
                bounces = v_old[n, -1] < -rest_speed
                v[n, -1] = -restitution * v_old[n, -1] if bounces else 0.0
                # What bounces goes on from where the substep began.
                x[n, -1] = max(floor, x_before[n, -1] + h * v[n, -1]) if bounces and restitution else floor
    return x, v


def reference(system: System, duration: float, *, gravity: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (x, v) after `duration` by SciPy's DOP853, as exactly as float64 allows."""
    shape = system.position.shape

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[: y.size // 2].reshape(shape), y[y.size // 2 :].reshape(shape)
        return np.concatenate([v.ravel(), acceleration(system, x, v, gravity).ravel()])

    y = np.concatenate([system.position.ravel(), system.velocity.ravel()])
    end = solve_ivp(slope, (0, duration), y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return end[: y.size // 2].reshape(shape), end[y.size // 2 :].reshape(shape)


def energy(system: System, *, gravity: float = 0.0) -> float:
    """Return kinetic plus elastic plus gravitational energy [J]."""
    mass = np.where(np.isinf(system.mass), 0.0, system.mass)
    i, j = system.connections.T
    length = np.linalg.norm(system.position[i] - system.position[j], axis=1)
    kinetic = 0.5 * (mass * (system.velocity**2).sum(axis=1)).sum()
    elastic = 0.5 * (system.stiffness * (length - system.rest_length) ** 2).sum()
    return float(kinetic + elastic + gravity * (mass * system.position[:, -1]).sum())


def rate_matrix(system: System, constant: np.ndarray, *, across: bool = True) -> np.ndarray:
    """Return M^-½ A M^-½ of the particles that are not pinned, A the connections' tangent matrix.

    A connection of constant c and axis d adds c (d dᵀ + (1 − l0/l)(1 − d dᵀ)) to both ends and takes it
    from the blocks that couple them; without `across` (a damper) only c d dᵀ.
    """
    n, dim = system.position.shape
    matrix = np.zeros((n, dim, n, dim))
    for c, (i, j) in enumerate(system.connections):
        dx = system.position[i] - system.position[j]
        length = np.linalg.norm(dx)
        along = np.outer(dx, dx) / length**2
        block = along + (1 - system.rest_length[c] / length) * (np.eye(dim) - along) * across
        for p, q, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            matrix[p, :, q, :] += sign * constant[c] * block
    free = np.isfinite(system.mass)
    root = 1 / np.sqrt(np.repeat(system.mass[free], dim))
    size = dim * int(free.sum())
    return matrix[free][:, :, free].reshape(size, size) * np.outer(root, root)


def stiffness_rate(system: System, force, step: float = 1e-6) -> float:
    """Return the largest eigenvalue of M⁻¹K, K by central differences of `force`, a function of positions."""
    x = system.position
    matrix = np.zeros((x.size, x.size))
    for k in range(x.size):
        both = []
        for sign in (1, -1):
            moved = x.copy()
            moved.ravel()[k] += sign * step
            both.append(force(moved))
        matrix[:, k] = (both[1] - both[0]).ravel() / (2 * step)
    root = np.where(system.pinned, 0.0, 1 / np.sqrt(system.mass)).repeat(system.dim)
    return float(np.linalg.eigvalsh(root[:, None] * (matrix + matrix.T) / 2 * root)[-1])


def energy_swing(system: System, device: str, substeps: int, frames: int) -> float:
    """Return the largest change of a free body's energy by leapfrog, as a share of that at the start."""
    simulation = Simulation(
        system, integrator=Leapfrog(), substeps=substeps, gravity=0.0, device=device, precision="float64"
    )
    start = simulation.measure().energy
    energies = [simulation.step() or simulation.measure().energy for _ in range(frames)]
    return float(np.abs(np.array(energies) / start - 1).max())


def assert_leapfrog_keeps_energy(start: System, device: str) -> None:
    """Assert that the energy of a stretched body swings by a share that falls with the square of the step."""
    system = start.replace(position=start.position * (1.15, 1.1, 1.1), rest_length=start.rest_length)
    coarse, fine = (energy_swing(system, device, substeps, frames=20) for substeps in (16, 64))
    assert coarse < 0.02
    assert fine < coarse / 8  # of second order: 16 times; corners in a law take some of it away


def balance(simulation: Simulation) -> tuple[float, float]:
    """Return energy less work, and work [J]."""
    found = simulation.measure()
    return found.energy - found.external_work, found.external_work


def drifts(frames: int, make: Callable[[int], Simulation]) -> list[float]:
    """Return by how much energy less work leaves its start, as a share of the most work, at h and h/2."""
    found = []
    for substeps in (20, 40):
        simulation = make(substeps)
        (start, _), off, most = balance(simulation), 0.0, 0.0
        for _ in range(frames):
            simulation.step()
            now, work = balance(simulation)
            off, most = max(off, abs(now - start)), max(most, abs(work))
        found.append(off / most)
    return found
