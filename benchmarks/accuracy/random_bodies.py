"""Random bodies that are mistreated at random: what the automatic step is tested on.

Body number `seed` is the same wherever it is made. A body is a chain, a sheet, a box or a ball of few particles.
It is spun, stretched, squashed, displaced at random, thrown apart, dropped or pressed, and no two of its particles
lie in the same place at the start.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from msdwarp import (
    RK4,
    RKC2,
    Box,
    Capsule,
    ExplicitEuler,
    ExponentialSpring,
    Leapfrog,
    LimitedSpring,
    LinearlyImplicitEuler,
    Material,
    Plane,
    PolynomialSpring,
    Sphere,
    SymplecticEuler,
    System,
    TensionOnlySpring,
    ball,
    box,
    chain,
    rod,
    sheet,
)
from msdwarp.bodies import LINEAR_SPRING

KICK_DRIFT = {
    "symplectic Euler": SymplecticEuler(),
    "leapfrog": Leapfrog(),
    "leapfrog θ=½": Leapfrog(damper_extrapolation=0.5),
}
METHODS = KICK_DRIFT | {"RK4": RK4(), "implicit Euler": LinearlyImplicitEuler()}
ONLY_DAMPED = {"RKC2": RKC2(), "explicit Euler": ExplicitEuler()}
ACTS = ("spun", "stretched", "squashed", "displaced", "flung", "thrown", "dropped", "pressed")
SURROUNDINGS = ("nothing", "nothing", "floor", "floor", "obstacles", "moving")


class Case(NamedTuple):
    """A mistreated body, and how it is to be simulated."""

    seed: int
    shape: str
    act: str
    around: str
    method: str
    precision: str
    damping_ratio: float
    """ζ of a single particle on one connection, b / (2 √(k m))."""
    system: System
    options: dict[str, Any]
    """Arguments of `Simulation`: gravity, colliders, integrator, precision."""

    @property
    def isolated(self) -> bool:
        """Whether nothing outside can do work on the body."""
        return self.around != "moving"


def make(seed: int, materials: bool = False) -> Case:
    """Return body number `seed`; with `materials` it has a Poisson's ratio, a law of springs, or is a rod."""
    rng = np.random.default_rng(seed)
    shape = str(rng.choice(["chain", "sheet", "box", "ball"]))
    spacing, mass = 0.1, float(10 ** rng.uniform(-3, 0))
    stiffness = float(mass * (2 * np.pi * 10 ** rng.uniform(0.0, 1.7)) ** 2)  # a pair oscillates at 1 to 50 Hz
    ratio = float(rng.choice([0.0, 0.0, 0.003, 0.03, 0.3, 1.0, 3.0]))
    numbers = {"mass": mass, "stiffness": stiffness, "damping": 2 * ratio * float(np.sqrt(stiffness * mass))}
    dim = int(rng.choice([2, 3])) if shape in ("chain", "sheet") else 3
    if shape == "chain":
        build: Any = partial(chain, int(rng.integers(2, 30)), spacing, dim=dim)
    elif shape == "sheet":
        size = rng.integers(2, 9, 2)
        build = partial(sheet, (int(size[0]), int(size[1])), spacing, dim=dim)
    elif shape == "box":
        a, b, c = (int(n) for n in rng.integers(2, 6, 3))
        build = partial(box, (a, b, c), spacing)
    else:
        build = partial(ball, float(rng.uniform(1.0, 2.7)) * spacing, spacing)
    system = build(**numbers)
    if materials:
        system = _of_a_material(build, shape, system, ratio, np.random.default_rng((seed, 1)))
    around, act = str(rng.choice(SURROUNDINGS)), str(rng.choice(ACTS))
    if act == "pressed":
        around = "moving"
    elif act == "dropped" and around == "nothing":
        around = "floor"
    method = str(rng.choice([*METHODS, *KICK_DRIFT] + (list(ONLY_DAMPED) if ratio else [])))
    if system.spring != LINEAR_SPRING and method == "implicit Euler":
        method = "leapfrog"
    precision = str(rng.choice(["float32", "float32-compensated", "float64"]))
    speed = float(np.sqrt(stiffness / mass)) * spacing  # at which a wave passes along
    system = _treated(system, act, speed, rng)
    gravity = 0.0 if around == "nothing" and rng.uniform() < 0.7 else 9.82
    if around != "nothing":
        lowest = float(system.position[:, -1].min())
        height = float(rng.uniform(0.05, 2.0)) if act == "dropped" else 1e-3
        system = system.translate((0.0,) * (system.dim - 1) + (height - lowest,))
    options = {"gravity": gravity, "colliders": _colliders(around, act, system, rng), "precision": precision}
    options["integrator"] = (METHODS | ONLY_DAMPED)[method]
    return Case(seed, shape, act, around, method, precision, ratio, system, options)


LAWS = (TensionOnlySpring(), LimitedSpring(0.1, 20.0), ExponentialSpring(5.0), PolynomialSpring((1.0, 0.0, 10.0)))


def _of_a_material(build: Any, shape: str, system: System, ratio: float, rng: np.random.Generator) -> System:
    """Return a body with a law of springs or, about as stiff and heavy as before, of a material."""
    if rng.uniform() < 0.4:
        return system.replace(spring=LAWS[int(rng.integers(len(LAWS)))])
    spacing, stiffness, mass = 0.1, float(system.stiffness[0]), float(system.mass[0])
    poisson = float(rng.choice([0.0, 0.1, 0.2, 0.4, 0.45, 0.49]))
    how = {"damping_ratio": min(ratio, 0.3), "poissons_ratio": None if shape == "chain" else poisson}
    if shape in ("box", "ball"):
        return build(material=Material(mass / spacing**3, stiffness / spacing, **how))
    thickness = float(rng.uniform(0.1, 1.0)) * spacing
    if shape == "sheet":
        stuff = Material(mass / (thickness * spacing**2), stiffness / thickness, **how)
        return build(material=stuff, thickness=thickness)
    area = np.pi * thickness**2 / 4
    stuff = Material(mass / (area * spacing), stiffness * spacing / area, **how)
    count = max(system.particle_count, 3)
    return rod(count, spacing, radius=thickness / 2, material=stuff, dim=system.dim)


def _treated(system: System, act: str, speed: float, rng: np.random.Generator) -> System:
    """Return the system as it starts: deformed, or with velocities that are a share of the wave speed."""
    position = np.array(system.position, dtype=np.float64)
    position -= position.mean(axis=0)
    extent = max(float(np.ptp(position, axis=0).max()), 0.1)
    if act == "spun":
        rate = float(rng.uniform(0.05, 1.0)) * speed / extent * 2
        velocity = np.zeros_like(position)
        velocity[:, 0], velocity[:, -1] = -rate * position[:, -1], rate * position[:, 0]
    elif act == "flung":
        velocity = float(rng.uniform(0.1, 1.5)) * speed / extent * 2 * position
    elif act in ("thrown", "dropped"):
        direction = rng.normal(size=system.dim)
        velocity = np.tile(direction / np.linalg.norm(direction), (len(position), 1))
        velocity *= float(rng.uniform(0.05, 1.0)) * speed * (0.3 if act == "dropped" else 1.0)
    else:
        velocity = np.zeros_like(position)
    axis = int(rng.integers(system.dim)) if system.dim > 1 else 0
    if act == "stretched":
        position[:, axis] *= float(rng.uniform(1.1, 3.0))
    elif act == "squashed":
        position[:, axis] *= float(rng.uniform(0.1, 0.9))
    elif act == "displaced":
        position += rng.uniform(-0.3, 0.3) * 0.1 * rng.uniform(-1, 1, position.shape)
    return system.replace(position=position, velocity=velocity, rest_length=system.rest_length)


def _colliders(around: str, act: str, system: System, rng: np.random.Generator) -> list[Any]:
    """Return obstacles: a floor, and what stands or moves above it."""
    if around == "nothing":
        return []
    up = (0.0,) * (system.dim - 1) + (1.0,)
    numbers = {"restitution": float(rng.uniform(0, 1)), "friction": float(rng.choice([0.0, 0.3, 1.0]))}
    top = float(system.position[:, -1].max())
    middle = system.position.mean(axis=0)
    found: list[Any] = [Plane(up, **numbers)]
    if around == "obstacles":
        aside = np.array(middle)
        aside[0] = system.position[:, 0].max() + 0.2
        aside[-1] = 0.0
        place = tuple(float(n) for n in aside)
        end = (place[0], *(0.0,) * (system.dim - 2), 0.3)
        found.append(
            [
                Sphere(place, 0.15, **numbers),
                Box(place, (0.2,) * system.dim, **numbers),
                Capsule(place, end, 0.1, **numbers),
            ][int(rng.integers(3))]
        )
    elif act == "pressed":
        depth, time = float(rng.uniform(0.1, 0.7)) * top, float(rng.uniform(0.2, 2.0))
        down = tuple(-n for n in up)

        def press(t: float):
            return tuple(-depth * min(t / time, 1.0) * n for n in up)

        found.append(Plane(down, -(top + 1e-3), motion=press, **numbers))
    elif around == "moving":
        size, frequency = float(rng.uniform(0.005, 0.05)), float(rng.uniform(0.5, 5.0))

        def shake(t: float):
            return tuple(size * (np.cos(2 * np.pi * frequency * t) - 1.0) * n for n in up)

        found = [Plane(up, motion=shake, **numbers)]
    return found
