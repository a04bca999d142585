"""The cases that errors are measured on, and references for them that share no code with the package.

Spacing 1 m, 1 kg a particle, damping 20 N s/m and gravity 9.82 m/s² unless given. Spans end while the
problem is still well posed: a thin body that buckles multiplies every perturbation, and past some time no
reference, however fine, says where a particle is. The references' own errors show that these spans are not.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.sparse import csr_array

from msdwarp import Plane, System, box, chain, sheet


@dataclass(frozen=True)
class Case:
    """A scene, for as long as errors are measured."""

    name: str
    title: str
    system: System
    duration: float
    """Span [s] at the end of which positions are compared."""
    gravity: float = 9.82
    colliders: tuple[Plane, ...] = ()
    exact: Callable[[], NDArray] | None = None
    """Positions at the end [m], where they are known in closed form."""


def chain_case() -> Case:
    """Return 40 particles in one dimension, pinned at both ends, released from a smooth displacement."""
    count, k, b, duration = 40, 1000.0, 1.0, 2.0
    rest = chain(count, stiffness=k, damping=b, dim=1).pin([0, count - 1])
    s = np.linspace(0, 1, count)
    u0 = 0.3 * np.exp(-(((s - 0.35) / 0.1) ** 2)) * np.sin(np.pi * s)
    u0[[0, -1]] = 0
    system = rest.replace(position=rest.position + u0[:, None])
    return Case(
        "chain",
        "Chain, exact solution",
        system,
        duration,
        0.0,
        exact=lambda: rest.position + chain_solution(u0, k, b, duration)[:, None],
    )


def chain_solution(u0: NDArray, k: float, b: float, t: float) -> NDArray:
    """Return the displacements at t of a chain of unit masses, pinned at both ends, at rest at first.

    With n springs, mode j = 1 … n−1 is sin(πjp/n), λ_j = 4k sin²(πj/2n), and q_j'' + 2γ_j q_j' + λ_j q_j = 0 with
    γ_j = bλ_j/2k.
    """
    n = len(u0) - 1
    j = np.arange(1, n)
    modes = np.sin(np.pi * np.outer(j, np.arange(n + 1)) / n)
    q = 2 / n * modes @ u0
    stiffness = 4 * k * np.sin(np.pi * j / (2 * n)) ** 2
    gamma = b * stiffness / (2 * k)
    omega = np.sqrt(stiffness - gamma**2 + 0j)
    q = q * np.exp(-gamma * t) * (np.cos(omega * t) + gamma * np.sin(omega * t) / omega).real
    return q @ modes


def cloth_case() -> Case:
    """Return a level cloth of 31 × 31 with three points of an edge pinned, let go. It has not folded after 1 s."""
    cloth = sheet((31, 31), stiffness=1e4, damping=20.0).pin([930, 945, 960])
    return Case("cloth", "Cloth", cloth, 1.0)


def mattress_case(stiffness: float = 5000.0) -> Case:
    """Return a mattress of 20 × 7 × 2, bent and stretched by a tenth, thrown with spin."""
    body = box((20, 7, 2), stiffness=stiffness, damping=20.0)
    return Case("mattress", "Mattress", _thrown(body, (1.1, 0.95, 1.0), (0.3, 1.0, 0.5)), 1.0)


def worm_case() -> Case:
    """Return a worm of 400 × 2 × 2, standing on end, falling while waves run along it."""
    body = box((2, 2, 400), stiffness=1e5, damping=20.0).translate((0, 0, 200.5))
    s = body.position[:, 2] / 400
    wave = np.stack([0.5 * np.sin(20 * np.pi * s), np.zeros_like(s), 0.5 * np.cos(10 * np.pi * s)], axis=1)
    return Case("worm", "Worm, 400 m tall", body.with_velocity(wave), 0.5)


def jelly_case() -> Case:
    """Return a cube of 10³, stretched by a tenth, hardly damped (b = 0.1), thrown with spin."""
    body = box((10, 10, 10), stiffness=2200.0, damping=0.1)
    return Case("jelly", "Jelly, hardly damped", _thrown(body, (1.1, 0.95, 1.0), (0.3, 1.0, 0.5)), 2.0)


def soft_cube_case() -> Case:
    """Return a cube of 7³ whose dampers dominate (k = 70, b = 80), stretched by a tenth, thrown with spin."""
    body = box((7, 7, 7), stiffness=70.0, damping=80.0)
    return Case("soft_cube", "Soft cube, overdamped", _thrown(body, (1.1, 0.95, 1.0), (0.3, 1.0, 0.5)), 1.5)


def _thrown(body: System, stretch: tuple[float, ...], spin: tuple[float, ...]) -> System:
    return body.replace(position=body.position * np.array(stretch)).spin(spin)


def dropped(case: Case, duration: float) -> Case:
    """Return a case with a floor 5 cm below its lowest particle, its own motion kept; default contact rule."""
    system = case.system.rotate(0.2, axis=(1, 0.4, 0)) if case.name != "worm" else case.system
    system = system.translate((0, 0, 0.05 - system.position[:, 2].min()))
    return Case(f"{case.name}_contact", f"{case.title}, on a floor", system, duration, colliders=(Plane(),))


CASES = {
    "chain": chain_case,
    "cloth": cloth_case,
    "mattress": mattress_case,
    "worm": worm_case,
    "jelly": jelly_case,
    "soft_cube": soft_cube_case,
}
CONTACT_CASES = {
    "mattress": lambda: dropped(mattress_case(), 0.6),
    "worm": lambda: dropped(worm_case(), 0.3),
    "jelly": lambda: dropped(jelly_case(), 0.6),
    "soft_cube": lambda: dropped(soft_cube_case(), 0.6),
}


def incidence(system: System) -> csr_array:
    """Return the matrix that turns particle positions into differences along connections."""
    c, n = system.connection_count, system.particle_count
    rows = np.repeat(np.arange(c), 2)
    return csr_array((np.tile([1.0, -1.0], c), (rows, system.connections.ravel())), shape=(c, n))


def acceleration(difference: csr_array, case: Case, u: NDArray, v: NDArray, rest_dx: NDArray) -> NDArray:
    """Return accelerations [m/s²] for displacements u [m] from the start and velocities v, in plain NumPy."""
    system = case.system
    dx, dv = rest_dx + difference @ u, difference @ v
    length = np.sqrt(np.einsum("cd,cd->c", dx, dx))
    speed = np.einsum("cd,cd->c", dv, dx) / length
    tension = -(system.stiffness * (length - system.rest_length) + system.damping * speed) / length
    a = (difference.T @ (tension[:, None] * dx)) / system.mass[:, None]
    a[:, -1] -= case.gravity
    a[system.pinned] = 0.0
    return a


def reference(case: Case, rtol: float) -> NDArray:
    """Return positions at the end of a case without contact: exact, or by SciPy's DOP853 in displacements."""
    if case.exact is not None:
        return case.exact()
    shape, size = case.system.position.shape, case.system.position.size
    difference = incidence(case.system)
    a = partial(acceleration, difference, case, rest_dx=difference @ case.system.position)

    def slope(t: float, y: NDArray) -> NDArray:
        return np.concatenate([y[size:], a(u=y[:size].reshape(shape), v=y[size:].reshape(shape)).ravel()])

    start = np.concatenate([np.zeros(size), case.system.velocity.ravel()])
    solved = solve_ivp(slope, (0, case.duration), start, "DOP853", [case.duration], rtol=rtol, atol=rtol / 10)
    return case.system.position + solved.y[:size, -1].reshape(shape)


def relative_error(case: Case, position: NDArray | None, wanted: NDArray) -> float:
    """Return the RMS distance from the wanted positions over the RMS way of the particles since the start."""
    if position is None or not np.isfinite(position).all():
        return float("nan")
    way = np.sum((wanted - case.system.position) ** 2)
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.sum((position - wanted) ** 2) / way))
