"""A body as stiff as the step of another one allows: almost rigid where it is heavier, at no substep more."""

import numpy as np
import pytest

from msdwarp import (
    RUBBER,
    Plane,
    Simulation,
    SymplecticEuler,
    System,
    ball,
    box,
    match_stiffness,
    rod,
    stability_limit,
)

FOAM = box((8, 5, 4), 0.08, mass=0.01, stiffness=500.0, damping=3.0)


def heavy(mass: float = 0.2) -> System:
    return ball(0.25, 0.1, mass=mass, stiffness=1.0, damping=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.001, 0.2, 3.0])
def test_it_has_the_step_of_the_other(mass):
    stiff = match_stiffness(heavy(mass), FOAM)
    # Springs and dampers are scaled by ratios of bounds that are linear in them: rounding alone.
    limits = [stability_limit(one, SymplecticEuler()) for one in (stiff, FOAM)]
    assert limits[0] == pytest.approx(limits[1], rel=1e-12)
    apart = FOAM + stiff.translate((0, 0, 2.0))
    substeps = [Simulation(one, device="cpu").substeps for one in (FOAM, apart)]
    assert substeps[0] == substeps[1]


def test_heavier_is_stiffer_in_proportion():
    light, dense = (match_stiffness(heavy(mass), FOAM) for mass in (0.1, 0.4))
    np.testing.assert_allclose(dense.stiffness, 4 * light.stiffness, rtol=1e-12)


def test_a_rod_is_stiffer_in_bending_by_as_much():
    soft = rod(9, 0.1, radius=0.02, material=RUBBER)
    stiff = match_stiffness(soft, FOAM)
    for name in ("stiffness", "damping"):
        stretch = getattr(stiff, name) / getattr(soft, name)
        bending = getattr(stiff.angles, name) / getattr(soft.angles, name)
        np.testing.assert_allclose(bending, stretch[0], rtol=1e-12)
    # Bounds are linear in the stiffness and in the damping of both: rounding alone.
    limits = [stability_limit(one, SymplecticEuler()) for one in (stiff, FOAM)]
    assert limits[0] == pytest.approx(limits[1], rel=1e-12)


@pytest.mark.slow
def test_it_bends_by_a_share_of_a_percent(plain_device):
    # Its own weight on a floor: each layer of springs bears the layers above, k of 20 times the foam's.
    stiff = match_stiffness(heavy(), FOAM).translate((0, 0, 0.3))
    simulation = Simulation(stiff, colliders=[Plane(restitution=0.0)], device=plain_device)
    simulation.step(120)
    height = np.ptp(simulation.frame().position[:, 2]) / np.ptp(stiff.position[:, 2])
    assert 0.99 < height < 1.0
    assert simulation.measure().largest_strain < 0.02


@pytest.mark.parametrize(
    ("system", "other", "message"),
    [
        (heavy(), System(position=np.zeros((1, 3))), "other has no springs"),
        (System(position=np.zeros((1, 3))), FOAM, "system has no springs"),
        (heavy(), 3.0, "other is 3.0"),
    ],
)
def test_what_has_no_springs_is_refused(system, other, message):
    with pytest.raises(ValueError, match=message):
        match_stiffness(system, other)
