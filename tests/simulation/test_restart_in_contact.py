"""Restarts in the middle of contact, and of tearing: what goes on is the same to the last bit."""

import copy
import pickle

import numpy as np
import pytest

from msdwarp import Simulation, System, Touch, ball, box, sheet

pytestmark = pytest.mark.filterwarnings("ignore::msdwarp.ContactOverrun")  # the ball comes at 8 m/s


def thrown(break_strain: float = np.inf) -> System:
    """Return a ball that is thrown into a sheet, which is held at its rim and resists bending."""
    cloth = sheet((10, 10), 0.05, mass=0.002, stiffness=150.0, damping=0.1, bending=1e-3)
    rim = [k for k in range(100) if k % 10 in (0, 9) or k < 10 or k >= 90]
    weight = ball(0.1, 0.05, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.14))
    return cloth.replace(break_strain=break_strain).pin(rim) + weight.with_velocity((0, 0, -8))


@pytest.mark.parametrize(("break_strain", "frames"), [(np.inf, 3), (0.1, 10)], ids=["whole", "torn"])
def test_a_restart_in_contact_goes_on_to_the_last_bit(plain_device, break_strain, frames):
    # Hundreds of facets are near a point of the sheet by then; where the run starts there are none.
    run = Simulation(thrown(break_strain), touch=Touch(), device=plain_device)
    run.step(frames)
    restored = Simulation(thrown(break_strain), touch=Touch(), device=plain_device)
    restored.restore(*run.checkpoint())
    one, other = run.measure(), restored.measure()
    assert other.effect_energy == one.effect_energy
    assert one.effect_energy > 0 or run.snapshot().broken.any()
    assert other.dissipated_power == one.dissipated_power
    for _ in range(12):
        run.step()
        restored.step()
    assert restored.substeps == run.substeps
    np.testing.assert_array_equal(restored.frame().position, run.frame().position)
    np.testing.assert_array_equal(restored.frame().velocity, run.frame().velocity)


def test_the_largest_strain_is_that_of_what_is_whole(plain_device):
    run = Simulation(thrown(0.1), touch=Touch(), device=plain_device)
    run.step(12)
    now = run.snapshot()
    assert now.broken.any()
    along = np.diff(now.position[now.connections], axis=1)[:, 0]
    strain = np.abs(np.linalg.norm(along, axis=1) / now.rest_length - 1)
    counts = ~now.broken & now.between_neighbours
    # float32 positions of half a metre: 3e-8 m of lengths of 5 cm, and as much again in a difference.
    assert run.stepping.balance().strain == pytest.approx(strain[counts].max(), abs=1e-5)


def test_a_simulation_says_that_it_has_no_copy():
    simulation = Simulation(box((2, 2, 2)), device="cpu")
    for refused in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="use checkpoint and restore"):
            refused(simulation)
