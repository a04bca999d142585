"""Particles among colliders: with which steps and methods they meet, and how far away solids are."""

import numpy as np
import pytest
import warp as wp
from problems import two_quick

from msdwarp import (
    RK4,
    RKC2,
    Box,
    Capsule,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    Simulation,
    Sphere,
    SymplecticEuler,
    System,
)
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.kernels.basis import kernel, vector
from msdwarp.kernels.colliders.signed_distance import KINDS, signed_distance, solids
from msdwarp.world import Problem
from msdwarp.world.colliders import Collider

G = 9.82
STEPS = [1 / 60, 1 / 240, 1 / 960]
INTEGRATORS = [
    SymplecticEuler(),
    Leapfrog(),
    Leapfrog(damper_extrapolation=0.5),
    RK4(),
    RKC2(),
    LinearlyImplicitEuler(iterations=1),  # more would take long, and change little here
]
every_integrator = pytest.mark.parametrize("integrator", two_quick(INTEGRATORS), ids=str)
every_step = pytest.mark.parametrize("h", STEPS)


def particle(position, velocity=0.0) -> System:
    return System(position=[position], velocity=velocity)


def simulate(system: System, colliders, device: str, *, h: float, substeps: int = 1, **options) -> Simulation:
    """Return a float64 simulation among colliders with substeps of h."""
    colliders = [colliders] if isinstance(colliders, Collider) else colliders
    options = {"gravity": G, "precision": "float64"} | options
    return Simulation(
        system, colliders=colliders, fps=1 / (h * substeps), substeps=substeps, device=device, **options
    )


EACH_ONCE = [(SymplecticEuler(), h) for h in STEPS] + [(one, STEPS[1]) for one in INTEGRATORS[1:]]


def axes_of(collider: Box, dim: int) -> np.ndarray:
    """Return the directions of a box's edges, by the exponential of its turn."""
    if collider.turn is None:
        return np.eye(dim)
    if dim == 2:
        generator = collider.turn * np.array([[0, -1], [1, 0]])
    else:
        x, y, z = collider.turn
        generator = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    values, vectors = np.linalg.eig(generator)
    return (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real


def level(collider: Collider, x: np.ndarray) -> np.ndarray:
    """Return numbers that are 0 on the surface, below 0 inside: no distances, but for a plane and a sphere."""
    dim = x.shape[1]
    if isinstance(collider, Plane):
        return x @ collider.unit_normal(dim) - collider.offset
    if isinstance(collider, Sphere):
        return np.linalg.norm(x - collider.position, axis=1) - collider.radius
    if isinstance(collider, Box):
        q = (x - collider.position) @ axes_of(collider, dim)
        return (np.abs(q) - np.array(collider.size) / 2).max(axis=1)
    if isinstance(collider, Capsule):
        a, b = np.array(collider.start), np.array(collider.end)
        t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1) - collider.radius
    a, b = np.array(collider.apex), np.array(collider.base)
    along = (x - a) @ (b - a) / ((b - a) @ (b - a))
    off = np.linalg.norm(x - a - along[:, None] * (b - a), axis=1)
    return np.maximum(off - collider.radius * along, (along - 1) * np.linalg.norm(b - a))


def distances(colliders, x: np.ndarray, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (normals, distances) of points from collider p, as kernels compute them on the CPU."""
    dim = x.shape[1]
    assembly = assemble(
        Problem(system=System(position=x[:1]), colliders=colliders), device="cpu", precision="float64"
    )
    (around,) = assembly.all
    kinds = tuple(sorted({type(one).__name__ for one in colliders}, key=KINDS.index))
    distance, V = signed_distance(dim, wp.float64, kinds), vector(dim, wp.float64)
    Solids, Result = solids(dim, wp.float64), wp.types.vector(dim + 1, wp.float64)

    @kernel
    def measure_distances(s: Solids, p: int, x: wp.array(dtype=V), found: wp.array(dtype=Result)):
        found[wp.tid()] = distance(s, p, x[wp.tid()])

    found = wp.zeros(len(x), dtype=Result, device="cpu")
    inputs = [around.data.solids, p, wp.array(x, dtype=V, device="cpu")]
    wp.launch(measure_distances, len(x), inputs, [found], device="cpu")
    result = found.numpy().reshape(len(x), dim + 1)
    return result[:, :dim], result[:, dim]
