"""What a look at the energy must leave as it is: the work of loads."""

import numpy as np
import pytest
from test_work import options, rope, shake

from msdwarp import Attachment, Force, Leapfrog, PrescribedMotion, Simulation, Sphere, SymplecticEuler


@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=str)
def test_a_look_at_the_energy_does_no_work(integrator):
    # It takes half a kick, to which the work of forces of time is summed: not that of drives, nor of carriers.
    arm = Sphere((0, 0, 1), 0.1, motion=lambda t: (shake(t), (0 * t, 0 * t, 2 * t)))
    loads = [
        PrescribedMotion([0], lambda t: np.stack(shake(t), axis=-1)),
        Attachment([1, 3], arm, stiffness=20.0),
        Force(lambda t: (0.3, 0.0, 0.0)),
    ]
    simulation = Simulation(rope(0.5), loads=loads, **options("cpu", integrator=integrator))
    for _ in range(5):
        simulation.step()
        before = simulation.measure().external_work
        for _ in range(3):
            simulation.stepping.balance()
        assert simulation.measure().external_work == before
    assert abs(before) > 0.01
