"""Viscoelastic bodies relax as the standard linear solid does."""

import math

import pytest

from msdwarp import Simulation, box, chain, viscoelastic


def test_a_held_strain_relaxes_by_a_share(device):
    # Two pinned ends and nothing else: the length is constant, so that each substep of the flow is exact.
    rod = chain(2, 1.0, stiffness=100.0).pin([0, 1]).replace(rest_length=0.9)
    share, time = 0.6, 0.5
    simulation = Simulation(viscoelastic(rod, share, time), device=device, precision="float64", gravity=0.0)
    stretch, full = 0.1, 0.5 * 100.0 * 0.1**2
    for frame in range(31):
        left = stretch * math.exp(-frame / 60 / time)
        expected = 0.5 * 100.0 * ((1 - share) * stretch**2 + share * left**2)
        assert simulation.measure().elastic_energy == pytest.approx(expected, rel=1e-12 * full / expected + 1e-12)
        simulation.step()


def test_it_creeps_to_its_soft_length(plain_device):
    # A weight on a rod sags at once by m g / k, and in the end by m g / (k (1 − share)).
    rod = chain(2, 1.0, stiffness=100.0, damping=8.0, mass=0.1).rotate(math.pi / 2, (0, 1, 0)).pin([0])
    simulation = Simulation(viscoelastic(rod, 0.5, 0.3), device=plain_device, precision="float64")
    top = simulation.frame().position[0, 2]
    simulation.step(240)  # thirteen relaxation times, of the solid: 0.3 / (1 − 0.5) s each
    sag = top - simulation.frame().position[1, 2] - 1.0
    assert abs(sag) == pytest.approx(0.1 * 9.82 / 50.0, rel=2e-3)  # exp(−6.7) is left


def test_what_is_wrong_is_said():
    for wrong, said in (
        ({"fraction": 1.5}, "fraction is 1.5"),
        ({"relaxation_time": 0.0}, "relaxation_time is 0"),
    ):
        with pytest.raises(ValueError, match=said):
            viscoelastic(box((3, 3, 3)), **wrong)
    with pytest.raises(ValueError, match="yield or break"):
        viscoelastic(box((3, 3, 3)).replace(yield_strain=0.1))
