"""Pairs of particles whose spring gives way, and what is left of its length by the law."""

import math

import numpy as np

from msdwarp import RK4, RKC2, Leapfrog, LinearlyImplicitEuler, Simulation, SymplecticEuler, System

INTEGRATORS = [
    SymplecticEuler(),
    Leapfrog(),
    Leapfrog(damper_extrapolation=0.5),
    RK4(),
    RKC2(),
    LinearlyImplicitEuler(iterations=6),  # for as many unknowns
]
AXIS = {1: [1.0], 2: [0.6, 0.8], 3: [2 / 3, -1 / 3, 2 / 3]}


def pair(length: float, dim: int = 3, **fields) -> System:
    """Return two particles so far apart; by default they are pinned, and the rest length is 1 m."""
    position = np.outer([0.0, length], AXIS[dim])
    fields = {"mass": math.inf, "rest_length": 1.0, "stiffness": 50.0} | fields
    return System(position=position, connections=[[0, 1]], **fields)


def simulate(system: System, device: str, *, h: float, substeps: int = 1, **options) -> Simulation:
    """Return a float64 simulation without gravity, with substeps of h."""
    options = {"gravity": 0.0, "precision": "float64"} | options
    return Simulation(system, fps=1 / (h * substeps), substeps=substeps, device=device, **options)


def rest_lengths(simulation: Simulation) -> np.ndarray:
    return simulation.snapshot().rest_length


def relaxed(length: float, time: float, *, yield_strain: float, relaxation_time: float) -> float:
    """Return the rest length of a spring of 1 m that has been held at a length for so long."""
    side = math.copysign(1.0, length - 1.0)
    excess = abs(length - 1.0) - yield_strain
    return length - side * (yield_strain + excess * math.exp(-time / relaxation_time))
