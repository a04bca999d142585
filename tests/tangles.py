"""Bodies that every algorithm is tried on, and the forces that a device finds in them."""

import functools

import numpy as np
import problems
import pytest

from msdwarp import System, box, chain, sheet
from msdwarp.engine.model.algorithm_choice import FORCE_ALGORITHMS
from msdwarp.engine.model.state import State
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.engine.stepping.stages import Stage
from msdwarp.engine.stepping.substep import take_stage
from msdwarp.kernels.integrators.euler import kick
from msdwarp.world import Problem

PRECISIONS = {
    "float32": problems.EPS32,
    "float32-compensated": problems.EPS32,
    "float64": problems.EPS64,
}
CONSTANTS = ("rest_length", "stiffness", "damping")
FAR = (5e4, 0, 0)
"""So far out [m] float32 rounds positions to 4 mm, which springs feel and compensated precision must not."""
every_route = pytest.mark.parametrize("force_algorithm", FORCE_ALGORITHMS)


def tangle(dim: int, count: int, own: tuple[str, ...], *, damped: bool) -> System:
    """Return particles joined at random: one with half of all, many with few, the last few with none.

    Constants in `own` differ from connection to connection; of the others there is one for all.
    """
    random = np.random.default_rng(100 * dim + count)
    joined = max(2, count - 3)
    hub = [(0, j) if j % 4 == 1 else (j, 0) for j in range(1, joined, 2)]
    pairs = [random.choice(joined, 2, replace=False) for _ in range(2 * count)]
    connections = random.permutation(np.array([*hub, *pairs]))  # some pairs come twice
    constants = {"rest_length": 0.8, "stiffness": 30.0, "damping": 2.0 if damped else 0.0}
    for name in own:
        constants[name] = constants[name] * random.uniform(0.5, 1.5, len(connections))
    position, velocity = random.normal(size=(2, count, dim))
    return System(position=position, velocity=velocity, connections=connections, **constants)


def moving(system: System, seed: int = 3) -> System:
    """Return the system distorted by about a tenth, and in turbulent motion."""
    random = np.random.default_rng(seed)
    noise, velocity = random.normal(size=(2, *system.position.shape))
    return system.replace(position=system.position + 0.1 * noise, velocity=velocity)


@functools.cache
def lattices(damping: float) -> dict[str, System]:
    """Return lattices of all kinds, whole, cut and together."""
    constants = {"stiffness": 30.0, "damping": damping}
    small, tall = box((3, 3, 3), 1.2, **constants), box((2, 4, 5), 0.9, **constants)
    return {
        "chain": chain(9, dim=1, **constants),
        "sheet 4": sheet((5, 7), neighbors=4, dim=2, **constants),
        "sheet 8": sheet((7, 5), **constants),
        "smallest sheet": sheet((2, 2), **constants),
        "box 6": box((3, 4, 5), neighbors=6, **constants),
        "box 26": box((5, 4, 3), **constants),
        "oblong cells": box((3, 4, 3), (0.7, 1.1, 1.6), **constants),
        "smallest box": box((2, 2, 2), **constants),
        "thin box": box((2, 2, 7), **constants),
        "ball": problems.ball(7, **constants),
        "two equal boxes": small + small.translate((5, 0, 0)),
        "two unlike boxes": small + tall.replace(stiffness=80.0).translate((5, 0, 0)),
        "two kinds of one shape": small + small.replace(stiffness=80.0).translate((5, 0, 0)),
        "a box and what has fewer directions": small + sheet((4, 3)).translate((0, 0, 4)) + chain(5),
    }


def evaluate(system: System, device: str, precision: str, force_algorithm: str = "auto") -> np.ndarray:
    """Return the force on every particle: what a second's kick gives to masses of 1 kg."""
    assembly = assemble(
        Problem(system=system.replace(mass=1.0), gravity=0.0),
        device=device,
        precision=precision,
        force_algorithm=force_algorithm,
    )
    dynamics, state = Dynamics(assembly), State.from_system(system, assembly.model)
    rest, force = state.model.vectors_together(2)
    fields = {"compensation": state.compensation, "x": state.x, "v": state.v, "v_half": rest, "v_out": force}
    take_stage(dynamics, Stage(kick, {"h": 1.0, **fields}))
    return force.numpy()


def assert_forces_are_right(system: System, device: str, precision: str, force_algorithm: str) -> None:
    """Compare the force on every particle with the plain sum over connections."""
    x, v, eps = system.position, system.velocity, PRECISIONS[precision]
    if precision != "float64":
        v = v.astype(np.float32).astype(np.float64)
    if precision == "float32":
        x = x.astype(np.float32).astype(np.float64)
    (i, j), degree = system.connections.T, np.bincount(system.connections.ravel(), minlength=len(x))
    length, speed = np.linalg.norm(x[i] - x[j], axis=1), np.linalg.norm(v[i] - v[j], axis=1)
    size = system.stiffness * (length + system.rest_length) + system.damping * speed
    # A connection's force is (k − (k l0 − b Δv·Δx/|Δx|)/|Δx|) Δx: no part of it goes through more than 16
    # roundings (the constants' own, 2 in 1/√ on a GPU, and so on), each of at most ε/2 of k |Δx|, k l0 or b |Δv|.
    # Then as many are added as meet in the particle, each time with a rounding of the sum so far.
    sizes = np.bincount(i, size, len(x)) + np.bincount(j, size, len(x))
    bound = (8 + degree / 2) * eps * sizes
    error = np.abs(evaluate(system, device, precision, force_algorithm) - problems.forces(system, x, v)).max(
        axis=1
    )
    assert (error <= bound).all()  # exactly 0 for a particle that is alone
    assert bound[degree > 0].max() < 1e-2 * size.max()  # it is a bound that says something
