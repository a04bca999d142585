"""Textbook experiments of equilibria and large motions, for `validation.py`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipk, ellipkinc

import msdwarp as msd
from msdwarp import Material, System

from .textbook import Found, G, Quantity, line_of, simulation_of


def catenary(device: str, count: int = 100) -> Found:
    """Hang an elastic rope between two points of equal height; its shape is the elastic catenary.

    With the horizontal tension H, weight w per unstretched length, axial stiffness EA, at the unstretched length
    s from the lowest point: x = H s/EA + (H/w) asinh(w s/H), z = w s²/(2 EA) + (H/w) (sqrt(1 + (w s/H)²) − 1)
    (Irvine, Cable Structures, 1981).
    """
    length, span, w, axial = 1.2, 1.0, 3.0, 100.0
    half = length / 2

    def x(s: Any, h: float) -> Any:
        return h * s / axial + h / w * np.arcsinh(w * s / h)

    def z(s: Any, h: float) -> Any:
        return w * s**2 / (2 * axial) + h / w * (np.sqrt(1 + (w * s / h) ** 2) - 1)

    tension = brentq(lambda h: x(half, h) - span / 2, 0.1, 100.0)
    a = length / count
    rope = line_of(count + 1, a, mass=w * a / G, stiffness=axial / a)
    place = rope.position.copy()
    place[:, 0] *= span / length
    place[:, 2] = -0.3 * np.sin(np.pi * place[:, 0] / span)
    simulation = simulation_of(rope.replace(position=place).pin([0, count]), device, gravity=G)
    simulation.settle(1e-10)
    shape = simulation.frame().position
    # The pull of the rope at its left end, along x.
    first = shape[1] - shape[0]
    stretched = np.linalg.norm(first)
    pull = axial / a * (stretched - a) * first[0] / stretched
    s = np.linspace(-half, half, 200)
    return Found(
        [
            Quantity("sag", "m", z(half, tension), -shape[:, 2].min()),
            Quantity("horizontal tension", "N", tension, pull),
        ],
        (shape[::5, 0] - span / 2, shape[::5, 2]),
        (x(s, tension), z(abs(s), tension) - z(half, tension)),
        ("x [m]", "z [m]"),
    )


def elastic_pendulum(device: str, duration: float = 10.0) -> Found:
    """Swing a mass on a spring, tuned to 2 : 1, where swinging and bouncing exchange their energy.

    The reference is SciPy's DOP853 of the equations of motion, to 1e-12.
    """
    mass, stiffness, rest = 1.0, 3 * G, 2.0 / 3.0  # hangs at 1 m: bouncing is twice as fast as swinging

    def motion(_: float, y: NDArray) -> NDArray:
        along = np.hypot(y[0], y[1])
        force = -stiffness * (along - rest) / (mass * along)
        return np.array([y[2], y[3], force * y[0], force * y[1] - G])

    start = [0.1, -1.12, 0.0, 0.0]
    t = np.linspace(0, duration, round(60 * duration) + 1)
    exact = solve_ivp(motion, (0, duration), start, "DOP853", t, rtol=1e-12, atol=1e-13).y[0]
    two = System(
        position=[[0, 0, 0], [start[0], 0, start[1]]],
        mass=[np.inf, mass],
        connections=[(0, 1)],
        stiffness=stiffness,
        rest_length=rest,
    )
    simulation = simulation_of(two, device, gravity=G, integrator=msd.RK4(), substeps=20)
    x = np.array([frame.position[1, 0] for frame in simulation.frames(duration)])
    return Found(
        [Quantity(f"x after {duration:g} s", "m", exact[-1], x[-1])],
        (t[::10], x[::10]),
        (t, exact),
        ("time [s]", "swing x [m]"),
    )


def elastica(device: str, count: int = 40) -> Found:
    """Bend a clamped rod by a large force at its tip: the elastica (Bisshopp and Drucker, 1945).

    With k² = (1 + sin φ₀)/2, φ₀ the tip's angle, and sin φ₁ = 1/(k √2): α = L sqrt(P/(E I)) = K(k) − F(φ₁, k),
    and the deflection is L (1 − 2 (E(k) − E(φ₁, k))/α).
    """
    radius, material = 0.005, Material(density=1000.0, youngs_modulus=1e9)
    rigidity = material.youngs_modulus * np.pi * radius**4 / 4
    a = 1.0 / (count - 0.5)  # the clamp is midway between the first two particles
    rod = msd.rod(count + 1, a, radius=radius, material=material)
    rod = rod.translate((-rod.position[0, 0] - a / 2, 0.0, 0.0)).pin([0, 1])

    def exact(load: float) -> float:
        def root(m: float) -> float:
            return float(ellipk(m) - ellipkinc(np.arcsin(1 / np.sqrt(2 * m)), m))

        m = brentq(lambda m: root(m) - np.sqrt(load), 0.5 + 1e-12, 1 - 1e-12)
        part = ellipe(m) - ellipeinc(np.arcsin(1 / np.sqrt(2 * m)), m)
        return float(1 - 2 / np.sqrt(load) * part)

    loads, sag = np.array([0.5, 1.0, 2.0, 4.0]), []
    for load in loads:
        pull = msd.Force((0.0, 0.0, -load * rigidity), on=[count])
        simulation = simulation_of(rod, device, loads=[pull])
        simulation.settle(1e-6)
        sag.append(-simulation.frame().position[-1, 2])
    fine = np.linspace(0.01, 4.5, 30)
    chosen = (1, 3)
    return Found(
        [
            Quantity(f"tip's deflection over L at P L²/(E I) = {loads[k]:g}", "", exact(loads[k]), sag[k])
            for k in chosen
        ],
        (loads, np.array(sag)),
        (fine, np.array([exact(one) for one in fine])),
        ("P L²/(E I)", "deflection of the tip over L"),
    )


def dzhanibekov(device: str, turns: float = 1.0) -> Found:
    """Spin a stiff body about its middle axis: it flips again and again (Landau and Lifshitz, Mechanics, § 37)."""
    arms = np.array([0.3, 0.2, 0.1])
    position = np.concatenate([np.diag(arms), -np.diag(arms)])
    ends = np.array([(i, j) for i in range(6) for j in range(i)])
    body = System(position=position, mass=1.0, connections=ends, stiffness=2e6)
    moments = 2 * ((arms**2).sum() - arms**2)  # increase from x to z
    spin = np.array([0.05, 2 * np.pi, 0.0])
    a, b, c = moments
    energy, momentum = (moments * spin**2).sum(), ((moments * spin) ** 2).sum()
    # The period of the angular velocity by the complete elliptic integral; here M² > 2 E I₂.
    low, high = energy * c - momentum, momentum - energy * a
    if momentum > energy * b:
        rate, m = np.sqrt((c - b) * high / (a * b * c)), (b - a) * low / ((c - b) * high)
    else:
        rate, m = np.sqrt((b - a) * low / (a * b * c)), (c - b) * high / ((b - a) * low)
    period = 4 * ellipk(m) / rate
    spun = body.with_velocity(np.cross(spin, position))
    simulation = simulation_of(spun, device, fps=200.0)
    frames = list(simulation.frames(turns * period))
    t = np.array([frame.time for frame in frames])
    # Angular velocity along the body's middle axis: momentum along this axis over the moment.
    seen = []
    for frame in frames:
        axis = frame.position[1] - frame.position[4]
        seen.append(np.cross(frame.position, frame.velocity).sum(axis=0) @ axis / np.linalg.norm(axis) / b)
    seen = np.array(seen)
    falls = np.flatnonzero((seen[:-1] > 0) & (seen[1:] <= 0))[0]
    rises = np.flatnonzero((seen[:-1] < 0) & (seen[1:] >= 0))[0]
    first, second = (t[k] + (t[k + 1] - t[k]) * seen[k] / (seen[k] - seen[k + 1]) for k in (falls, rises))
    sn = ellipj(rate * t + ellipk(m), m)[0]
    return Found(
        [Quantity("time from flip to flip 2K/Ω", "s", period / 2, float(second - first))],
        (t[:: len(t) // 40], seen[:: len(t) // 40]),
        (t, sn * seen[0]),
        ("time [s]", "ω about the middle axis [1/s]"),
    )


def kapitza(device: str, steps: int = 8) -> Found:
    """Stand a pendulum upright on a pivot that vibrates: it stays if the pivot is fast enough.

    For small strokes the limit is a ω = sqrt(2 g l) (Kapitza, 1951); at a given stroke it is where the solutions
    of Mathieu's equation, φ'' = (g − a ω² cos ωt) φ/l, begin to grow (Floquet).
    """
    length, stroke = 1.0, 0.1

    def trace(omega: float) -> float:
        """Return half of the trace of a period's matrix: solutions grow where it is above 1."""

        def along(t: float, y: NDArray) -> list[float]:
            pull = (G - stroke * omega**2 * np.cos(omega * t)) / length
            return [y[1], pull * y[0], y[3], pull * y[2]]

        end = solve_ivp(along, (0, 2 * np.pi / omega), [1.0, 0, 0, 1.0], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        return float(end[0] + end[3]) / 2

    usual = np.sqrt(2 * G * length) / stroke
    exact = brentq(lambda omega: trace(omega) - 1.0, 0.8 * usual, 1.3 * usual)

    def leans(omega: float, cycles: int = 200) -> float:
        """Return how far the pendulum has leant after some cycles [m]."""
        lean = 1e-3
        two = System(
            position=[[0, 0, 0], [lean, 0, np.sqrt(length**2 - lean**2)]],
            mass=1.0,
            connections=[(0, 1)],
            stiffness=1e6,
        )
        pivot = msd.PrescribedMotion(
            [0], lambda t: np.stack([0 * t, 0 * t, stroke * np.cos(omega * t) - stroke], -1)
        )
        shaken = two.with_velocity((0.0, 0.0, 0.0))
        simulation = simulation_of(
            shaken, device, gravity=G, loads=[pivot], fps=omega / (2 * np.pi), energy_limit=np.inf
        )
        largest = 0.0
        for _ in range(cycles):
            simulation.step()
            largest = max(largest, abs(float(simulation.frame().position[1, 0])))
            if largest > 0.2:
                break
        return largest

    low, high = 0.9 * exact, 1.1 * exact
    tried = []
    for _ in range(steps):
        middle = 0.5 * (low + high)
        stays = leans(middle) < 0.1
        tried.append((middle, float(stays)))
        low, high = (low, middle) if stays else (middle, high)
    points = np.array(sorted(tried)).T
    return Found(
        [Quantity("slowest pivot that holds it", "1/s", exact, 0.5 * (low + high))],
        (points[0] / exact, points[1]),
        (np.array([0.9, 1.0, 1.0, 1.1]), np.array([0.0, 0.0, 1.0, 1.0])),
        ("frequency of the pivot over its limit", "stands (1) or falls (0)"),
    )
