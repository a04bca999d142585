"""The force law: eq. 7 for every direction and precision, and what follows from it for a free body."""

import numpy as np
import problems
import pytest
from tangles import evaluate

from msdwarp import Leapfrog, Simulation, SymplecticEuler, System

# With dx = x_i − x_j and dv = v_i − v_j: forces worked out by hand.
CASES = [
    # length, speed along, speed across, rest, k, b, force along the axis
    (2.0, 0.0, 0.0, 2.0, 100.0, 0.0, 0.0),  # at rest length: none
    (2.5, 0.0, 0.0, 2.0, 100.0, 0.0, -50.0),  # stretched: pulls together
    (1.5, 0.0, 0.0, 2.0, 100.0, 0.0, 50.0),  # compressed: pushes apart
    (2.0, 3.0, 0.0, 2.0, 100.0, 5.0, -15.0),  # parting: the damper holds back
    (2.0, -3.0, 0.0, 2.0, 100.0, 5.0, 15.0),  # approaching: the damper pushes apart
    (2.5, 3.0, 0.0, 2.0, 100.0, 5.0, -65.0),  # both
    (2.5, 0.0, 7.0, 2.0, 100.0, 5.0, -50.0),  # motion across the axis is not damped
    (2.5, 3.0, 0.0, 2.0, 0.0, 5.0, -15.0),  # a damper alone
    (1e-3, 0.0, 0.0, 2.0, 100.0, 0.0, 199.9),  # almost coincident
]
DIRECTIONS = {
    1: [(1.0,), (-1.0,)],
    2: [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)],
    3: [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (2 / 3, -1 / 3, 2 / 3), (-0.48, 0.6, -0.64)],
}
PRECISIONS = {"float32": problems.EPS32, "float64": problems.EPS64}


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.each_value
def test_force_follows_the_table_in_every_direction(device, dim, precision):
    pairs = [(case, np.array(d)) for case in CASES for d in DIRECTIONS[dim] if dim > 1 or case[2] == 0]
    position, velocity, expected = [], [], []
    for (length, along, across, *_, force), d in pairs:
        side = np.zeros(dim)
        if across:
            side[:2] = (-d[1], d[0]) if d[:2].any() else (1.0, 0.0)  # at right angles to d
        position += [length * d / 2, -length * d / 2]
        velocity += [(along * d + across * side) / 2, -(along * d + across * side) / 2]
        expected += [force * d, -force * d]
    rest, k, b = np.array([case[3:6] for case, _ in pairs]).T
    system = System(
        position=position,
        velocity=velocity,
        connections=np.arange(2 * len(pairs)).reshape(-1, 2),
        rest_length=rest,
        stiffness=k,
        damping=b,
    )
    # A dozen operations on terms up to k·l = 250 N and b·v = 35 N: a few roundings of 250 N.
    tolerance = 8 * 250 * PRECISIONS[precision]
    np.testing.assert_allclose(evaluate(system, device, precision), expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["symplectic euler", "leapfrog"])
def test_free_body_keeps_its_momenta(device, integrator):
    # Kicks and drifts keep both momenta: internal forces are central, and x and v move along each other.
    # With a damper the force is central all the same.
    system = problems.tumbling_box(damping=0.1).replace(mass=np.linspace(0.1, 0.4, 8))
    system = system.with_velocity(system.velocity + np.array([0.5, -1.0, 0.25]))
    simulation = Simulation(
        system, gravity=0.0, fps=10, substeps=20, integrator=integrator, device=device, precision="float64"
    )

    def momenta(s: System) -> tuple[np.ndarray, np.ndarray]:
        p = s.mass[:, None] * s.velocity
        return p.sum(axis=0), np.cross(s.position, p).sum(axis=0)

    before = momenta(simulation.snapshot())
    simulation.step(100)
    after = momenta(simulation.snapshot())
    # 2000 substeps, each rounding sums of size 5 kg m²/s at most in some 30 operations; errors of one
    # sign would be 2000 · 30 · ε · 5 = 7e-11.
    for then, now in zip(before, after, strict=True):
        np.testing.assert_allclose(now, then, rtol=0, atol=7e-11)
    moved = simulation.snapshot().position - system.position
    assert np.abs(moved).max() > 1.0  # it did fly
