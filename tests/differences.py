"""A block whose loss is differentiated, and the comparison of its derivatives with central differences."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import EPS64

from msdwarp import Frames, Leapfrog, PrescribedMotion, Simulation, SymplecticEuler, System, box

NAMES = ("position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity")
METHODS = {"symplectic Euler": SymplecticEuler(), "leapfrog": Leapfrog()}
GRAVITY = np.array([0.3, 0.0, -9.8])
FRAMES = 5
STEP = 1e-6
"""Of central differences, as a share of each parameter: they are cut off at 1e-12 of the loss, and rounded at
1e-16/1e-6 = 1e-10. The tolerances are 1e-6 of the largest term of the sum, as single terms cancel."""


SOFT = {"stiffness": 300.0, "dissipation": 0.5, "friction": 0.4, "rest_speed": 0.05}


@wp.func
def soft_floor(x: wp.vec3d, v: wp.vec3d, t: wp.float64, i: int) -> wp.vec3d:
    """Return Hunt and Crossley's force of the plane z = -0.11, with friction that begins smoothly."""
    force = wp.vec3d()
    depth = wp.float64(-0.11) - x[2]
    if depth > wp.float64(0.0):
        pressing = wp.float64(500.0) * depth * wp.max(wp.float64(0.0), wp.float64(1.0) - wp.float64(0.5) * v[2])
        across = wp.vec3d(v[0], v[1], wp.float64(0.0))
        slip = wp.sqrt(wp.dot(across, across) + wp.float64(1e-4))
        force = wp.vec3d(wp.float64(0.0), wp.float64(0.0), pressing) - (wp.float64(0.4) * pressing / slip) * across
    return force


PAIR = {"connections": [[0, 1], [1, 2]], "stiffness": [50.0, 80.0], "damping": 0.2, "rest_length": [0.9, 0.4]}
CHAIN = System(position=[[0.0, 0, 1], [1.0, 0, 1], [1.4, 0.2, 1]], mass=[0.3, 0.5, 0.4], **PAIR)
ROWS = {
    "position": CHAIN.position + 0.01 * np.random.default_rng(0).normal(size=(4, 3, 3)),
    "velocity": np.array([[0.1, 0.0, 0.2], [0.0, 0.3, -0.1]]),  # the same for all particles, in every other world
    "stiffness": CHAIN.stiffness * np.array([[0.8], [1.0], [1.2], [1.3]]),
    "damping": np.array([0.2, 0.3]),
    "rest_length": np.array(0.7),  # of all connections in all worlds
    "mass": np.array([0.3, 0.4, 0.5, 0.6]),
    "gravity": np.array([9.0, 9.8]),  # downwards
}
"""Parameters of four worlds of the chain, in all shapes that an ensemble takes."""


def block() -> System:
    """Return a strained block, pinned at two particles, with different numbers everywhere."""
    rng = np.random.default_rng(0)
    body = box((4, 3, 3), 0.1, stiffness=300.0, damping=0.3).named("block")
    particles, connections = body.particle_count, body.connection_count
    body = body.replace(
        position=body.position + 0.004 * rng.normal(size=(particles, 3)),
        velocity=0.1 * rng.normal(size=(particles, 3)),
        mass=0.02 * (1 + rng.random(particles)),
        stiffness=300 * (1 + 0.1 * rng.random(connections)),
        damping=0.3 * (1 + 0.1 * rng.random(connections)),
    )
    return body.pin([0, 1])


def terms_of_loss(frames: Frames) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the weight of each coordinate, and the terms that the loss sums."""
    weight = np.linspace(1, 2, frames.position[-1].size).reshape(frames.position[-1].shape)
    x, v = frames.position[-1], frames.velocity
    return weight, 0.5 * weight * x**2, 0.01 * weight * v[-1] ** 2, 0.1 * weight * v[2], 0.01 * v[0]


def loss(frames: Frames) -> tuple[float, np.ndarray, np.ndarray]:
    """Return a loss of positions and velocities at the end, and of velocities in the middle."""
    weight, *terms = terms_of_loss(frames)
    x, v = frames.position[-1], frames.velocity[-1]
    by_x, by_v = np.zeros(frames.position.shape), np.zeros(frames.position.shape)
    by_x[-1], by_v[-1], by_v[2] = weight * x, 0.02 * weight * v, 0.1 * weight
    by_v[0] += 0.01
    return sum(one.sum() for one in terms), by_x, by_v


def at_end(axis: int, of: str = "position") -> Callable[[Frames], tuple[Any, Any, Any]]:
    """Return a loss: a coordinate of the last particle at the end, or of its velocity."""

    def loss(frames: Frames) -> tuple[Any, Any, Any]:
        by = np.zeros(frames.position.shape)
        by[-1, -1, axis] = 1.0
        value = getattr(frames, of)[-1, -1, axis]
        return (value, by, None) if of == "position" else (value, None, by)

    return loss


def rounding(frames: Frames) -> float:
    """Return how far rounding may move the loss: some units in the last place of each of its terms."""
    _, *terms = terms_of_loss(frames)
    return 4 * EPS64 * sum(abs(one).sum() for one in terms)


def simulation(body: System, gravity=GRAVITY, substeps=12, **options) -> Simulation:
    """Return a simulation whose frames have twelve substeps."""
    return Simulation(body, gravity=gravity, precision="float64", substeps=substeps, **options)


def check(body: System, name: str, found: np.ndarray, step: float = STEP, **options) -> None:
    """Compare a derivative in a random direction with a central difference."""
    rng = np.random.default_rng(1)
    base = GRAVITY if name == "gravity" else np.array(getattr(body, name))
    free = np.broadcast_to(np.isfinite(body.mass), body.particle_count)
    scale = {"position": 0.1, "velocity": 1.0, "gravity": 1.0}.get(name, np.where(np.isfinite(base), base, 0.0))
    way = scale * rng.normal(size=base.shape)
    if name in ("position", "velocity"):
        way = way * free[:, None]
        for one in options.get("loads", ()):
            if isinstance(one, PrescribedMotion):  # its particles are where it puts them
                way[one.particles(body)] = 0.0
    values = []
    for sign in (1, -1):
        value = base + sign * step * np.where(np.isfinite(base), way, 0.0)
        changed = (body, value) if name == "gravity" else (body.replace(**{name: value}), GRAVITY)
        _, frames = simulation(*changed, **options).differentiated(FRAMES, ())
        values.append(loss(frames)[0])
    terms = np.where(way != 0, found * way, 0.0)
    # The losses of both sides are rounded; the error of the difference itself is of second order in the step.
    tolerance = 1e-6 * max(abs(terms).max(), 1e-3) + rounding(frames) / step
    assert terms.sum() == pytest.approx((values[0] - values[1]) / (2 * step), rel=0, abs=tolerance)
