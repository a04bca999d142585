"""What contact between bodies needs: the thickness of single particles, and substeps that miss no body."""

import numpy as np
import pytest

from msdwarp import Contact, Simulation, SimulationDiverged, System, box


@pytest.mark.slow
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


FAST = 1e4
"""So fast [m/s] that a block passes the other within one of the substeps that its springs need."""


def blocks_that_meet(**options) -> Simulation:
    block = box((3, 3, 3), 0.1, mass=0.01, stiffness=100.0, damping=0.05)
    above = block.translate((0.01, 0.02, 0.21)).with_velocity((0, 0, -FAST))
    return Simulation(block + above, gravity=0.0, contact=Contact(), device="cpu", **options)


@pytest.mark.filterwarnings("ignore::msdwarp.checks.StepWarning")  # they move by 30 spacings in each
def test_bodies_do_not_cross_each_other_in_a_single_substep():
    """Automatic substeps become short enough for contact to see the other body."""
    crossings = pytest.importorskip("benchmarks.accuracy.crossings")
    pytest.importorskip("ipctk")
    simulation = blocks_that_meet()
    assert simulation.dt * FAST > 64 * 0.1  # longer than contact looks
    oracle = crossings.Oracle(simulation.system)
    for _ in range(2):
        simulation.step()
        assert not oracle.crosses(simulation.frame().position.astype(float))
    # Springs are a thousand times too slow to carry the impact on: the nearest of three layers of each block
    # bounce, with e = 0.3, and the lower one's takes (1 + e)/2 of the speed. Later the others push them, too.
    speed = -simulation.frame().velocity[:, 2]
    assert 0.65 / 3 * FAST < speed[:27].mean() < 0.5 * FAST < speed[27:].mean()


def test_given_substeps_that_miss_contact_end_the_run():
    simulation = blocks_that_meet(substeps=10)
    with pytest.raises(SimulationDiverged, match=r"moves by 16\.7 m in a substep, and contact would miss bodies"):
        simulation.step()
    assert simulation.time == 0.0
    np.testing.assert_array_equal(simulation.frame().position, simulation.system.position.astype(np.float32))
