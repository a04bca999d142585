"""Stepping: replaced as a whole when substeps or parameters change, while the run's own scale stays."""

import numpy as np
import pytest

from msdwarp import Leapfrog, Plane, Simulation, SymplecticEuler, at, box, sheet


def squeezed(dim: int = 2):
    """Return an undamped sheet, pressed to a tenth of its width."""
    body = sheet((6, 6), 0.1, mass=0.01, stiffness=100.0, dim=dim)
    position = np.array(body.position)
    position[:, 0] *= 0.1
    return body.replace(position=position, rest_length=body.rest_length)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")
@pytest.mark.parametrize(("integrator", "refresh"), [(Leapfrog(), True), (SymplecticEuler(), False)], ids=repr)
def test_growth_counts_since_the_start_though_substeps_change(integrator, refresh):
    # Nothing is a source of energy here, and the steps chosen for the sheet as it is at each frame's start are too
    # long for what comes within it: energy grew by 167 times in 600 frames while each new number of substeps began
    # to count anew. Now it is a tenth at most, 8 % that a run may gain and a swing. Symplectic Euler's swings more
    # while steps are long, as its velocities are half a step old.
    options = {"gravity": 0.0, "integrator": integrator, "precision": "float64", "device": "cpu"}
    simulation = Simulation(squeezed(), refresh=refresh, **options)
    start, chosen = simulation.measure().energy, set()
    for frame in range(600):
        simulation.step()
        chosen.add(simulation.substeps)
        if frame > 300 or integrator == Leapfrog():
            assert simulation.measure().energy <= 1.1 * start
    assert len(chosen) > 1


def test_it_is_another_object_after_each_change_and_the_same_between():
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=50.0, damping=0.1).translate((0, 0, 0.3))
    simulation = Simulation(body, colliders=[Plane()], schedule=[at(0.1, stiffness=80.0)], device="cpu")
    first = simulation.stepping
    simulation.step(6)
    assert simulation.stepping is first
    simulation.step()  # the change is due
    second = simulation.stepping
    assert second is not first
    assert second.model is not first.model
    simulation.change(damping=0.2)
    assert simulation.stepping is not second
    checkpoint = simulation.checkpoint()
    before = simulation.stepping
    simulation.restore(*checkpoint)
    assert simulation.stepping is not before
    simulation.reset()
    assert simulation.stepping.model.system is body


def test_other_substeps_go_on_with_the_same_model_and_state():
    simulation = Simulation(squeezed(), gravity=0.0, refresh=True, precision="float64", device="cpu")
    before = simulation.stepping
    while simulation.stepping is before:
        simulation.step()
    after = simulation.stepping
    assert after.choice.substeps != before.choice.substeps
    assert after.model is before.model
    assert after.state is before.state
    assert after.watch.baseline == before.watch.baseline


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ("many", "blocks is 'many'; it must be 'auto', None, or"),
        ((2,), r"blocks is \(2,\)"),
        ((1, 0), r"blocks\[1\] is 0; it must be a whole number of at least 1"),
        ((2, 1), r"blocks\[0\] is 2; it must be at most 1 on the CPU"),
    ],
)
def test_blocks_that_a_device_cannot_have_are_named(blocks, message):
    with pytest.raises(ValueError, match=message):
        Simulation(box((2, 2, 2)), blocks=blocks, device="cpu")


def test_a_simulation_says_what_it_is():
    body = box((3, 3, 3), 0.1, mass=0.01).translate((0, 0, 0.3))
    lines = repr(
        Simulation(body, colliders=[Plane()], substeps=12, allow_unstable=True, device="cpu")
    ).splitlines()
    assert 1 <= len(lines) <= 5
    said = "\n".join(lines)
    for word in ("27 particles", "158 connections", "Plane", "SymplecticEuler", "12 substeps", "float32", "cpu"):
        assert word in said
    assert "array" not in said
