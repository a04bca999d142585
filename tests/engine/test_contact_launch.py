"""Contact of small bodies in one launch a frame, on a GPU, and searches that the device decides on."""

import threading

import numpy as np
import pytest

from msdwarp import Contact, Plane, Simulation, System, box
from msdwarp.engine.stepping import substeps
from msdwarp.runtime import compile_ahead


def tower(speed: float = 1.0, axis: tuple = (1, 2, 0)) -> System:
    """Return two boxes, the upper one turned and falling on the lower one."""
    one = box((3, 3, 3), 0.1, mass=0.02, stiffness=400.0, damping=0.2)
    return one + one.rotate(0.3, axis=axis).translate((0.03, 0.02, 0.26)).with_velocity((0.0, 0.0, -speed))


def test_one_launch_equals_many(plain_device, monkeypatch):
    if plain_device == "cpu":
        pytest.skip("it is for clusters of blocks of a GPU")
    # Gathered springs: scattered ones are summed in any order.
    # So stiff that inner surfaces stay far apart.
    contact = Contact(friction=0.4, stiffness=2000.0)
    options = {"contact": contact, "colliders": [Plane()], "force_algorithm": "gather"}

    def ran() -> tuple[np.ndarray, bool]:
        simulation = Simulation(
            tower(speed=0.3, axis=(0, 0, 1)).translate((0.0, 0.0, 0.12)), device=plain_device, **options
        )
        for thread in threading.enumerate():
            if thread.name == compile_ahead.BESIDE:  # the launch is taken up when it is compiled
                thread.join()
        deepest = 0.0
        for _ in range(30):
            simulation.step()
            deepest = max(deepest, simulation.assembly.body_contact.deepest)
        assert deepest > 0
        return np.concatenate(simulation.frame()[1:]), simulation.stepping.stepper.takes_contact_along

    one, along = ran()
    assert along
    monkeypatch.setattr(substeps, "contact_launch", lambda *a: None)
    many, along = ran()
    assert not along
    np.testing.assert_array_equal(one, many)
