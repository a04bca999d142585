"""Ten textbook experiments with closed forms, for `validation.py`; the tests repeat four of them.

Each function returns a `Found`: numbers beside their closed forms, and a curve with measured points.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipk, ellipkinc

import msdwarp as msd
from msdwarp import Material, Simulation, System

G = 9.82
"""Gravity [m/s²]."""


class Quantity(NamedTuple):
    """A number beside its closed form."""

    name: str
    unit: str
    exact: float
    measured: float

    @property
    def deviation(self) -> float:
        """Measured over exact, minus 1."""
        return self.measured / self.exact - 1.0


class Found(NamedTuple):
    """What an experiment found."""

    quantities: list[Quantity]
    points: tuple[NDArray, NDArray]
    """Measured points (x, y) of the chart."""
    curve: tuple[NDArray, NDArray]
    """The closed form (x, y) of the chart."""
    axes: tuple[str, str]
    """Labels of x and y."""


def _simulation(system: System, device: str, **more: Any) -> Simulation:
    how = {"gravity": 0.0, "integrator": msd.Leapfrog(), "precision": "float64", "device": device}
    return Simulation(system, **{**how, **more})


def _line(count: int, spacing: float, **more: Any) -> System:
    """Return masses on the x axis from 0 on, joined in a row."""
    position = np.zeros((count, more.pop("dim", 3)))
    position[:, 0] = spacing * np.arange(count)
    ends = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    return System(position=position, connections=ends, **more)


def _frequency(system: System, shape: NDArray, device: str, periods: float, guess: float, **more: Any) -> float:
    """Return the frequency [Hz] of a motion that starts at rest in a mode's `shape`.

    It is fitted to the motion's projection on the shape; `guess` [Hz] sets the frames, 40 in a period.
    """
    simulation = _simulation(system, device, fps=40.0 * guess, **more)
    weight = np.where(np.isfinite(system.mass), system.mass, 0.0)[:, None] * shape
    middle = system.position - shape
    seen = [float((weight * (frame.position - middle)).sum()) for frame in simulation.frames(periods / guess)]
    seen, t = np.array(seen), np.arange(len(seen)) / simulation.fps

    def left(f: float) -> float:
        parts = np.stack([np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)], axis=1)
        return float(np.linalg.lstsq(parts, seen, rcond=None)[1][0])

    tried = np.linspace(0.8 * guess, 1.2 * guess, 81)
    best = int(np.argmin([left(f) for f in tried]))
    low, high = tried[max(best - 1, 0)], tried[min(best + 1, 80)]
    for _ in range(60):  # golden section
        a, b = high - (high - low) / 1.618034, low + (high - low) / 1.618034
        low, high = (low, b) if left(a) < left(b) else (a, high)
    return 0.5 * (low + high)


def slinky_drop(device: str, count: int = 400) -> Found:
    """Drop a hanging slinky: its lower end stays until the wave arrives, after T = sqrt(m/k).

    By the wave equation, without contact of coils, the upper end falls with the constant speed g T up to 2 T, and
    the lower end, from T on, with 2 g T.
    """
    mass, stiffness, natural = 0.2, 1.0, 4.0  # long, so that no coil passes through the next one
    duration = np.sqrt(mass / stiffness)
    # Half masses at the ends: the chain is then of second order.
    each = np.full(count + 1, mass / count)
    each[[0, -1]] /= 2
    held = System(
        position=np.linspace(0, -natural, count + 1)[:, None],
        mass=each,
        connections=np.stack([np.arange(count), np.arange(1, count + 1)], axis=1),
        stiffness=stiffness * count,
        rest_length=natural / count,
    )
    below = each[::-1].cumsum()[::-1][1:]  # the weight that each spring carries
    position = -np.concatenate([[0.0], np.cumsum(natural / count + below * G / (stiffness * count))])[:, None]
    fps = 100 / duration
    simulation = _simulation(held.replace(position=position), device, gravity=(-G,), fps=fps)
    fallen = np.array([(position - frame.position)[[0, -1], 0] for frame in simulation.frames(2 * duration)])
    t = np.arange(len(fallen)) / fps
    top, bottom = np.polyfit(t[20:180], fallen[20:180, 0], 1)[0], np.polyfit(t[120:190], fallen[120:190, 1], 1)
    arrives = -bottom[1] / bottom[0]
    exact = np.where(t < duration, 0.0, 2 * G * duration * (t - duration))
    return Found(
        [
            Quantity("speed of the upper end g√(m/k)", "m/s", G * duration, top),
            Quantity("the lower end begins to fall at √(m/k)", "s", duration, arrives),
        ],
        (t[::8], fallen[::8, 1]),
        (t, exact),
        ("time [s]", "fall of the lower end [m]"),
    )


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
    rope = _line(count + 1, a, mass=w * a / G, stiffness=axial / a)
    place = rope.position.copy()
    place[:, 0] *= span / length
    place[:, 2] = -0.3 * np.sin(np.pi * place[:, 0] / span)
    simulation = _simulation(rope.replace(position=place).pin([0, count]), device, gravity=G)
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
    simulation = _simulation(two, device, gravity=G, integrator=msd.RK4(), substeps=20)
    x = np.array([frame.position[1, 0] for frame in simulation.frames(duration)])
    return Found(
        [Quantity(f"x after {duration:g} s", "m", exact[-1], x[-1])],
        (t[::10], x[::10]),
        (t, exact),
        ("time [s]", "swing x [m]"),
    )


def string_modes(device: str, count: int = 64, modes: tuple[int, ...] = (1, 2, 4, 8)) -> Found:
    """Let a taut string vibrate: f = (n/2L) sqrt(T/μ); of N masses m, a apart, (1/π) sqrt(T/(m a)) sin(nπ/2N)."""
    spacing, mass, tension, stiffness = 1.0 / count, 0.01 / count, 10.0, 2e5
    rest = spacing / (1 + tension / (stiffness * spacing))
    string = _line(count + 1, spacing, mass=mass, stiffness=stiffness, rest_length=rest).pin([0, count])
    tension = stiffness * (spacing - rest)
    n = np.arange(1, 13)
    exact = n / 2 * np.sqrt(tension / 0.01)
    found = []
    for k in modes:
        shape = np.zeros_like(string.position)
        shape[:, 2] = 1e-5 * np.sin(k * np.pi * string.position[:, 0])
        moved = string.replace(position=string.position + shape)
        found.append(_frequency(moved, shape, device, 4.0, float(exact[k - 1])))
    chain = np.sqrt(tension / (mass * spacing)) / np.pi * np.sin(np.array(modes) * np.pi / (2 * count))
    return Found(
        [
            Quantity(f"mode {k} of the chain", "Hz", e, f)
            for k, e, f in zip(modes, chain.tolist(), found, strict=True)
        ],
        (np.array(modes), np.array(found)),
        (n, exact),
        ("mode", "frequency [Hz]"),
    )


def membrane_modes(device: str, count: int = 24) -> Found:
    """Let a square membrane vibrate: f = (c/2L) sqrt(m² + n²), c² = tension per length over mass per area.

    Of the lattice f = (1/π) sqrt(T/(m a)) sqrt(sin²(mπ/2N) + sin²(nπ/2N)), T the tension of a spring.
    """
    spacing, mass, tension, stiffness = 1.0 / count, 0.1 / count**2, 1.0, 2e3
    sheet = msd.sheet((count + 1, count + 1), spacing, mass=mass, stiffness=stiffness, neighbours=4)
    sheet = sheet.translate(tuple(-sheet.position.min(axis=0)))
    rim = (sheet.position[:, :2].min(axis=1) < 1e-9) | (sheet.position[:, :2].max(axis=1) > 1 - 1e-9)
    sheet = sheet.replace(rest_length=np.full(sheet.connection_count, spacing - tension / stiffness)).pin(rim)
    pairs = [(1, 1), (1, 2), (2, 2), (1, 3)]
    found, exact, lattice = [], [], []
    for m, n in pairs:
        shape = np.zeros_like(sheet.position)
        x, y = sheet.position[:, :2].T
        shape[:, 2] = 1e-5 * np.sin(m * np.pi * x) * np.sin(n * np.pi * y) * ~rim
        exact.append(np.sqrt(tension * spacing / mass) / 2 * np.hypot(m, n))
        half = np.pi / (2 * count)
        lattice.append(np.sqrt(tension / (mass * spacing)) / np.pi * np.hypot(np.sin(m * half), np.sin(n * half)))
        moved = sheet.replace(position=sheet.position + shape)
        found.append(_frequency(moved, shape, device, 4.0, exact[-1]))
    order = np.hypot(*np.array(pairs).T)
    return Found(
        [
            Quantity(f"mode {m}, {n} of the lattice", "Hz", e, f)
            for (m, n), e, f in zip(pairs, lattice, found, strict=True)
        ],
        (order, np.array(found)),
        (np.array([1.2, 3.4]), exact[0] / np.sqrt(2) * np.array([1.2, 3.4])),
        ("√(m² + n²)", "frequency [Hz]"),
    )


def dispersion(device: str, count: int = 32) -> Found:
    """Let waves stand in a chain, up to the shortest: ω = 2 sqrt(k/m) sin(q a/2) (Born and von Kármán, 1912)."""
    spacing, mass, stiffness = 0.1, 0.01, 100.0
    chain = _line(count + 1, spacing, mass=mass, stiffness=stiffness, dim=1).pin([0, count])
    modes = np.unique(np.linspace(1, count - 1, 9).round().astype(int))
    exact = np.sqrt(stiffness / mass) / np.pi * np.sin(modes * np.pi / (2 * count))
    found = []
    for n, guess in zip(modes, exact.tolist(), strict=True):
        shape = 1e-4 * spacing * np.sin(n * np.pi * np.arange(count + 1) / count)[:, None]
        moved = chain.replace(position=chain.position + shape)
        found.append(_frequency(moved, shape, device, 6.0, guess, substeps=64))
    q = np.linspace(0, np.pi, 100)
    chosen = (0, len(modes) // 2, len(modes) - 1)
    return Found(
        [Quantity(f"mode {modes[k]} of {count}", "Hz", exact[k], found[k]) for k in chosen],
        (np.pi * modes / count, np.array(found)),
        (q, np.sqrt(stiffness / mass) / np.pi * np.sin(q / 2)),
        ("phase from particle to particle q a", "frequency [Hz]"),
    )


def euler_load(device: str, count: int = 40) -> Found:
    """Compress a rod between two hinges: it buckles at π² E I/L².

    Its lowest frequency falls with the compression P, ω² = ω₀² (1 − P/P_E); the load at which it would be 0 is
    extrapolated from loads below.
    """
    spacing, radius = 1.0 / count, 0.005
    material = Material(density=1000.0, youngs_modulus=1e8)
    rod = msd.rod(count + 1, spacing, radius=radius, material=material)
    rod = rod.translate((0.5, 0.0, 0.0))
    # Half masses at the ends would make no difference: they are hinged.
    inertia, area = np.pi * radius**4 / 4, np.pi * radius**2
    limit = np.pi**2 * material.youngs_modulus * inertia
    slowest = np.pi / 2 * np.sqrt(material.youngs_modulus * inertia / (material.density * area))
    loads, squares = np.array([0.0, 0.25, 0.5, 0.75]), []
    for load in loads:
        strain = load * limit / (material.youngs_modulus * area)
        place = rod.position * (1 - strain, 1, 1)
        shape = np.zeros_like(place)
        shape[:, 2] = 1e-6 * np.sin(np.pi * np.arange(count + 1) / count)
        bent = rod.replace(position=place + shape).pin([0, count])
        squares.append(_frequency(bent, shape, device, 3.0, float(slowest * np.sqrt(1 - load))) ** 2)
    slope, first = np.polyfit(loads * limit, squares, 1)
    fine = 1 - np.linspace(1, 0, 50) ** 2
    return Found(
        [
            Quantity("load π² E I/L²", "N", limit, -first / slope),
            Quantity("frequency without load", "Hz", slowest, float(np.sqrt(squares[0]))),
        ],
        (loads, np.sqrt(squares)),
        (fine, slowest * np.sqrt(1 - fine)),
        ("load over Euler's", "frequency [Hz]"),
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
        simulation = _simulation(rod, device, loads=[pull])
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
    simulation = _simulation(spun, device, fps=200.0)
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
        simulation = _simulation(
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


def bubble(device: str, subdivisions: int = 3) -> Found:
    """Let a bubble breathe: M R'' = (3 γ p/R) 4 π R² x, with the mass M of its skin and the gas at p.

    Springs of the skin are at rest and weak; they add Σ k l²/R² to the stiffness.
    """
    radius, mass, outside, gamma, k = 0.1, 0.05, 1000.0, 1.4, 1.0
    skin = msd.shell(msd.icosphere(radius, subdivisions), mass=mass, stiffness=k)
    length = np.linalg.norm(np.diff(skin.position[skin.connections], axis=1)[:, 0], axis=1)
    volume, surface = 4 / 3 * np.pi * radius**3, 4 * np.pi * radius**2
    stiffness = gamma * outside * surface**2 / volume + k * (length**2).sum() / radius**2
    exact = np.sqrt(stiffness / mass) / (2 * np.pi)
    gas = msd.EnclosedGas(0.0, outside=outside, exponent=gamma, volume=None)
    shape = 1e-4 * skin.position
    at_rest = gas.bound(skin)
    found = _frequency(skin.replace(position=skin.position + shape), shape, device, 3.0, exact, loads=[at_rest])
    t = np.linspace(0, 3 / exact, 121)
    simulation = _simulation(skin.replace(position=skin.position + shape), device, fps=40 * exact, loads=[at_rest])
    size = [
        float(np.linalg.norm(frame.position, axis=1).mean()) - radius for frame in simulation.frames(3 / exact)
    ]
    return Found(
        [Quantity("breathing frequency", "Hz", float(exact), found)],
        (t[: len(size)][::4], np.array(size)[::4] * 1e6),
        (t, 1e-4 * radius * np.cos(2 * np.pi * exact * t) * 1e6),
        ("time [s]", "change of radius [µm]"),
    )


EXPERIMENTS = {
    "slinky drop": slinky_drop,
    "catenary": catenary,
    "elastic pendulum": elastic_pendulum,
    "string": string_modes,
    "membrane": membrane_modes,
    "dispersion of a chain": dispersion,
    "Euler load": euler_load,
    "elastica": elastica,
    "Dzhanibekov": dzhanibekov,
    "Kapitza's pendulum": kapitza,
    "bubble": bubble,
}
