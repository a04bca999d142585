"""Gradients beside another way to find them, complex numbers; and twice, to the last bit."""

import math

import numpy as np
import pytest
from differences import FRAMES, NAMES, SOFT, block, loss, simulation

import msdwarp as msd
from msdwarp import RK4, SymplecticEuler

SUBSTEPS, H = 6, 1 / 360


def squares(found: msd.Frames) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the squares of positions, and a tenth of those of velocities, at the end."""
    by_x, by_v = np.zeros((2, *found.position.shape))
    by_x[-1], by_v[-1] = 2 * found.position[-1], 0.2 * found.velocity[-1]
    return float((found.position[-1] ** 2).sum() + 0.1 * (found.velocity[-1] ** 2).sum()), by_x, by_v


def rates(x, v, ends, start):
    """Return the accelerations of particles, which may be complex, as their springs and forces give them."""
    i, j = ends.T
    dx, dv = x[i] - x[j], v[i] - v[j]
    length = np.sqrt((dx * dx).sum(axis=1))
    pull = start["stiffness"] * (length - start["rest_length"]) + start["damping"] * (dv * dx).sum(axis=1) / length
    force = start["force"] + 0j
    np.add.at(force, i, -(pull / length)[:, None] * dx)
    np.add.at(force, j, (pull / length)[:, None] * dx)
    return force / start["mass"][:, None] + start["gravity"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "precision"), [(RK4(), "float64"), (RK4(), "float32"), (SymplecticEuler(), "float64")]
)
def test_gradients_are_those_of_complex_numbers(method, precision, plain_device):
    body, frames = block(), 3
    body = body.replace(mass=np.where(np.isfinite(body.mass), body.mass, 0.03))
    names = ("position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity", "force")
    values = {name: getattr(body, name) for name in names[:-2]}
    values |= {"gravity": np.array([0.0, 0.0, -9.82]), "force": np.zeros(body.position.shape)}

    def run(start):
        """Return the loss below after substeps by the formulas of the textbook."""
        x, v = start["position"], start["velocity"]
        for _ in range(frames * SUBSTEPS):
            a = rates(x, v, body.connections, start)
            if method == SymplecticEuler():
                v = v + H * a
                x = x + H * v
                continue
            u, b = v + H / 2 * a, rates(x + H / 2 * v, v + H / 2 * a, body.connections, start)
            w, c = v + H / 2 * b, rates(x + H / 2 * u, v + H / 2 * b, body.connections, start)
            z, d = v + H * c, rates(x + H * w, v + H * c, body.connections, start)
            x, v = x + H / 6 * (v + 2 * u + 2 * w + z), v + H / 6 * (a + 2 * b + 2 * c + d)
        return (x**2).sum() + 0.1 * (v**2).sum()

    # In float64 it is hundreds of roundings of 1e-16, multiplied by a hundred at most; in float32 of 6e-8, that is
    # 1.5e-6 of strains of 0.04.
    tolerance = 1e-12 if precision == "float64" else 1e-4
    how = {"substeps": SUBSTEPS, "gravity": 9.82, "integrator": method, "device": plain_device}
    gradient = msd.Simulation(body, precision=precision, **how).gradient(squares, frames, by=names)
    assert gradient.value == pytest.approx(run(values).real, rel=tolerance)
    for name in names:
        way = np.random.default_rng(1).normal(size=values[name].shape) * (np.abs(values[name]) + 0.1)
        # The imaginary part is the derivative times 1e-30, without a difference that would lose digits.
        wanted = run(values | {name: values[name] + 1e-30j * way}).imag / 1e-30
        terms = gradient[name] * way
        assert terms.sum() == pytest.approx(wanted, rel=0, abs=tolerance * np.linalg.norm(terms))


@pytest.mark.slow
def test_gradients_repeat_to_the_last_bit(plain_device):
    loads = [
        msd.EnclosedGas(60.0),
        msd.Wind((3.0, 1.0, -2.0), drag=1.0, lift=0.5),
        msd.Actuator(lambda t: 0.1 * math.sin(40 * t)),
    ]
    how = {"colliders": [msd.Plane((0.1, 0, 1), -0.1, **SOFT)], "loads": loads, "force_algorithm": "gather"}
    numbers = ("strain", "colliders[0].friction", "colliders[0].offset", "loads[1].velocity", "loads[1].drag")
    names = (*NAMES, "force", *numbers)
    first, second = (
        simulation(block(), integrator=msd.Leapfrog(), device=plain_device, **how).gradient(loss, FRAMES, by=names)
        for _ in range(2)
    )
    for name in names:
        assert first[name].any()
        np.testing.assert_array_equal(second[name], first[name])
