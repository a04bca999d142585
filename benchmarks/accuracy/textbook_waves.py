"""Textbook experiments of waves and vibrations, for `validation.py`."""

import numpy as np

import msdwarp as msd
from msdwarp import Material, System

from .textbook import Found, G, Quantity, frequency_of, line_of, simulation_of


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
    simulation = simulation_of(held.replace(position=position), device, gravity=(-G,), fps=fps)
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


def string_modes(device: str, count: int = 64, modes: tuple[int, ...] = (1, 2, 4, 8)) -> Found:
    """Let a taut string vibrate: f = (n/2L) sqrt(T/μ); of N masses m, a apart, (1/π) sqrt(T/(m a)) sin(nπ/2N)."""
    spacing, mass, tension, stiffness = 1.0 / count, 0.01 / count, 10.0, 2e5
    rest = spacing / (1 + tension / (stiffness * spacing))
    string = line_of(count + 1, spacing, mass=mass, stiffness=stiffness, rest_length=rest).pin([0, count])
    tension = stiffness * (spacing - rest)
    n = np.arange(1, 13)
    exact = n / 2 * np.sqrt(tension / 0.01)
    found = []
    for k in modes:
        shape = np.zeros_like(string.position)
        shape[:, 2] = 1e-5 * np.sin(k * np.pi * string.position[:, 0])
        moved = string.replace(position=string.position + shape)
        found.append(frequency_of(moved, shape, device, 4.0, float(exact[k - 1])))
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
    sheet = msd.sheet((count + 1, count + 1), spacing, mass=mass, stiffness=stiffness, neighbors=4)
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
        found.append(frequency_of(moved, shape, device, 4.0, exact[-1]))
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
    chain = line_of(count + 1, spacing, mass=mass, stiffness=stiffness, dim=1).pin([0, count])
    modes = np.unique(np.linspace(1, count - 1, 9).round().astype(int))
    exact = np.sqrt(stiffness / mass) / np.pi * np.sin(modes * np.pi / (2 * count))
    found = []
    for n, guess in zip(modes, exact.tolist(), strict=True):
        shape = 1e-4 * spacing * np.sin(n * np.pi * np.arange(count + 1) / count)[:, None]
        moved = chain.replace(position=chain.position + shape)
        found.append(frequency_of(moved, shape, device, 6.0, guess, substeps=64))
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
        squares.append(frequency_of(bent, shape, device, 3.0, float(slowest * np.sqrt(1 - load))) ** 2)
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


def bubble(device: str, subdivisions: int = 3) -> Found:
    """Let a bubble breathe: M R'' = (3 γ p/R) 4 π R² x, with the mass M of its skin and the gas at p.

    Springs of the skin are at rest and weak; they add Σ k l²/R² to the stiffness.
    """
    radius, mass, outside, gamma, k = 0.1, 0.05, 1000.0, 1.4, 1.0
    skin = msd.shell(msd.icosphere(radius, subdivisions), total_mass=mass, stiffness=k)
    length = np.linalg.norm(np.diff(skin.position[skin.connections], axis=1)[:, 0], axis=1)
    volume, surface = 4 / 3 * np.pi * radius**3, 4 * np.pi * radius**2
    stiffness = gamma * outside * surface**2 / volume + k * (length**2).sum() / radius**2
    exact = np.sqrt(stiffness / mass) / (2 * np.pi)
    gas = msd.EnclosedGas(0.0, outside=outside, exponent=gamma, volume=None)
    shape = 1e-4 * skin.position
    at_rest = gas.bound(skin)
    found = frequency_of(skin.replace(position=skin.position + shape), shape, device, 3.0, exact, loads=[at_rest])
    t = np.linspace(0, 3 / exact, 121)
    simulation = simulation_of(
        skin.replace(position=skin.position + shape), device, fps=40 * exact, loads=[at_rest]
    )
    size = [
        float(np.linalg.norm(frame.position, axis=1).mean()) - radius for frame in simulation.frames(3 / exact)
    ]
    return Found(
        [Quantity("breathing frequency", "Hz", float(exact), found)],
        (t[: len(size)][::4], np.array(size)[::4] * 1e6),
        (t, 1e-4 * radius * np.cos(2 * np.pi * exact * t) * 1e6),
        ("time [s]", "change of radius [µm]"),
    )
