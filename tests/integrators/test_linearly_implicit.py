"""Linearly implicit Euler: its equations against a dense solve, its order, and steps too long for others."""

import numpy as np
import problems
import pytest

from msdwarp import RK4, LinearlyImplicitEuler, Simulation, box, sheet, stability_limit
from msdwarp.integrators.symplectic_euler import SymplecticEuler

BODIES = {
    "plane": sheet((3, 3), 1.0, mass=[1.0, 2.0, 0.5] * 3, stiffness=40.0, damping=3.0, dim=2).pin(0),
    "space": box((3, 3, 2), 1.0, stiffness=40.0, damping=3.0).pin([0, 5]),
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES.keys())
def test_one_substep_solves_its_equations(body, device):
    rng = np.random.default_rng(4)
    body = body.replace(position=body.position * 1.1)  # stretched: springs are stiff across their axes too
    body = body.with_velocity(rng.normal(size=body.position.shape))
    h, n, d = 0.2, body.particle_count, body.dim
    free = np.repeat(~body.pinned, d)
    mass = np.repeat(np.where(body.pinned, 1.0, body.mass), d)

    def matrix(constant, across):
        """Return K or B of the free coordinates: the rate matrix is M^-1/2 K M^-1/2."""
        root = np.sqrt(mass[free])
        return problems.rate_matrix(body, constant, across=across) * np.outer(root, root)

    K, B = matrix(body.stiffness, True), matrix(body.damping, False)
    gravity = np.zeros((n, d))
    gravity[:, -1] = -9.82
    force = problems.forces(body, body.position, body.velocity)
    v = body.velocity.ravel()[free]
    b = h * ((force.ravel() + mass * gravity.ravel())[free] - h * K @ v)
    dv = np.linalg.solve(np.diag(mass[free]) + h * B + h * h * K, b)
    expected = np.array(body.velocity)
    expected.ravel()[free] += dv

    method = LinearlyImplicitEuler(iterations=n * d)  # as many as unknowns: exact but for rounding
    simulation = Simulation(body, integrator=method, fps=1 / h, substeps=1, device=device, precision="float64")
    simulation.step()
    frame = simulation.frame()
    np.testing.assert_allclose(frame.velocity, expected, rtol=0, atol=1e-10)  # rounding of ~50 iterations
    np.testing.assert_allclose(frame.position, body.position + h * expected, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_order_is_one():
    body = box((3, 3, 3), 1.0, stiffness=100.0, damping=8.0)
    body = body.replace(position=1.1 * body.position)

    def end(method, substeps):
        # Short frames, as each launch of a frame is recorded: ten to half a second.
        options = {"integrator": method, "substeps": substeps // 10, "fps": 20.0, "precision": "float64"}
        simulation = Simulation(body, gravity=0.0, device="cpu", **options)
        simulation.step(10)
        return simulation.frame().position

    exact = end(RK4(), 1000)  # fourth order: off by 1e-12
    errors = [np.abs(end(LinearlyImplicitEuler(25), n) - exact).max() for n in (80, 120, 180)]
    slopes = np.log(np.array(errors[:-1]) / errors[1:]) / np.log(1.5)
    np.testing.assert_allclose(slopes, 1.0, atol=0.15)


def test_it_bears_a_few_springs_that_are_much_stiffer(device):
    rng = np.random.default_rng(2)
    block = box((4, 4, 4), 0.1, mass=0.02, stiffness=300.0, damping=0.3)
    block = block.replace(stiffness=np.where(rng.random(block.connection_count) < 0.01, 3e6, 300.0)).pin([0, 3])
    assert stability_limit(block, SymplecticEuler()) < 1 / (60 * 100)  # explicitly: more than 100 substeps a frame
    simulation = Simulation(block, integrator=LinearlyImplicitEuler(), substeps=4, device=device)
    energies = [simulation.measure().energy]
    for _ in range(120):
        simulation.step()
        energies.append(simulation.measure().energy)
    # It swings from its pins, and only ever loses energy; 1e-5 of it is for float32 sums.
    assert np.diff(energies).max() < 1e-5 * abs(energies[0])
    assert energies[-1] < energies[0] - 0.1


def test_iterations_must_be_a_count():
    with pytest.raises(ValueError, match="iterations is 0"):
        LinearlyImplicitEuler(iterations=0)
