"""What contact between bodies needs to know of single particles."""

import numpy as np
import pytest

from msdwarp import Contact, Simulation, System, box


def test_particles_that_touch_each_other_need_a_thickness():
    def grains(count: int) -> System:
        position = np.arange(3.0 * count).reshape(-1, 3)
        return System(position=position, mass=0.01, connections=np.zeros((0, 2), dtype=int))

    contact = Contact(stiffness=1e3)
    with pytest.raises(ValueError, match=r"contact\.thickness is None, but 2 of the bodies are single particles"):
        Simulation(grains(2), contact=contact, device="cpu")
    Simulation(
        grains(1) + box((2, 2, 2)).translate((0, 0, 9)), contact=contact, device="cpu"
    )  # a solid has a surface
