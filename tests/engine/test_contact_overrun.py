"""Contacts that are overrun: said once, with who, where, how fast, what would help; and not where all is well."""

import re
import warnings

import numpy as np
import pytest

from msdwarp import Contact, Plane, Simulation, System, TunnellingWarning, ball, box, sheet

THICKNESS = 0.01


def shot(speed: float) -> System:
    """Return a ball that flies upright at a sheet, which is held at its rim."""
    cloth = sheet((9, 9), 0.05, mass=0.002, stiffness=200.0, damping=0.1).named("cloth")
    x = cloth.position
    rim = np.abs(x[:, :2]).max(axis=1) > np.abs(x[:, :2]).max() - 1e-6
    shell = ball(0.08, 0.04, mass=0.01, stiffness=500.0, damping=0.5).named("ball")
    lowest = shell.surface.points(shell.position)[:, 2].min() if shell.surface else shell.position[:, 2].min()
    shell = shell.translate((0.01, 0.02, 0.03 - lowest)).with_velocity((0, 0, -speed))
    return cloth.pin(np.flatnonzero(rim)) + shell


def simulated(speed: float, device: str, fps: float = 60.0, **options) -> Simulation:
    contact = Contact(thickness=THICKNESS, **options)
    return Simulation(shot(speed), contact=contact, gravity=0.0, device=device, fps=fps)


# How forces are summed has no part in the first two: tests/engine/test_touch_search.py compares algorithms.


@pytest.mark.slow
def test_a_ball_that_is_shot_through_a_sheet_is_reported_once(plain_device):
    simulation = simulated(60.0, plain_device)  # in a frame it flies 1 m, in a substep some centimetres
    assert 60.0 * simulation.dt > THICKNESS
    with pytest.warns(TunnellingWarning) as told:
        simulation.step(3)
    assert len(told) == 1
    said = str(told[0].message)
    assert said.startswith("up to 0.01667 s a point of ")
    assert "'ball'" in said
    assert "'cloth'" in said
    # Where: on the way of the ball. How fast: as the ball flies, the sheet being light.
    place = [float(one) for one in re.search(r"near \((.*?)\) m", said)[1].split(", ")]
    assert np.abs(place[:2]).max() < 0.12
    assert abs(place[2]) < 0.1
    assert float(re.search(r"at ([\d.]+) m/s", said)[1]) == pytest.approx(60.0, rel=0.2)
    # What would help: substeps in which it comes by half of the thickness, at most.
    needed = int(re.search(r"substeps=(\d+) or more", said)[1])
    assert 60.0 / (60 * needed) <= 0.55 * THICKNESS
    assert f"the present {simulation.substeps} it comes" in said
    # It has gone through.
    assert simulation.frame().position[81:, 2].mean() < -0.3
    # After a reset it is said anew.
    simulation.reset()
    with pytest.warns(TunnellingWarning):
        simulation.step()


def test_what_comes_through_within_a_substep_is_reported(plain_device):
    # It is 20 mm above the sheet, twice as far as where it would touch, and 40 mm below it after a substep.
    bed = sheet((5, 5), 0.05, mass=0.002, stiffness=200.0, damping=0.1).pin(slice(None)).named("sheet")
    bed = bed.translate(-bed.position.mean(axis=0))
    grain = System(position=[[0.01, 0.02, 0.02]], velocity=[[0.0, 0.0, -60.0]], mass=0.001).named("grain")
    how = {"substeps": 2, "fps": 500.0, "allow_unstable": True, "gravity": 0.0, "device": plain_device}
    simulation = Simulation(bed + grain, contact=Contact(thickness=THICKNESS, stiffness=200.0), **how)
    with pytest.warns(TunnellingWarning, match="'grain'"):
        simulation.step()
    np.testing.assert_allclose(simulation.frame().velocity[-1], [0.0, 0.0, -60.0])  # it has never been in touch


@pytest.mark.slow
def test_what_is_said_to_help_does(plain_device):
    # At 12 m/s the ball takes the sheet along, and then is pressed through it: contact is too soft. At 10 m/s
    # what comes through is still pushed back.
    simulation = simulated(12.0, plain_device, fps=240.0)  # short frames, as each launch of one is recorded
    with pytest.warns(
        TunnellingWarning, match=r"would help: Contact\(stiffness=\.\.\.\) of more than the present 286"
    ):
        simulation.step(36)
    assert simulation.frame().position[81:, 2].mean() < -0.3
    simulation = simulated(12.0, plain_device, fps=240.0, stiffness=4000.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.step(36)
    assert simulation.frame().position[81:, 2].mean() > 0.1  # it has bounced


def test_a_body_that_is_pressed_into_another_is_reported(device):
    # Two cubes, the upper 100 times as heavy and fast, and contact much softer than what it must stop.
    low = box((3, 3, 3), 0.1, mass=0.02, stiffness=2e4, damping=8.0).pin(np.arange(27)).named("low")
    high = box((3, 3, 3), 0.1, mass=2.0, stiffness=2e4, damping=80.0).translate((0.01, 0.02, 0.21)).named("high")
    system = low + high.with_velocity((0, 0, -2.0))
    simulation = Simulation(system, contact=Contact(stiffness=10.0), gravity=0.0, fps=240.0, device=device)
    with pytest.warns(
        TunnellingWarning, match=r"a point of '(low|high)' goes .* m deep into '(low|high)'"
    ) as told:
        simulation.step(120)
    assert len(told) == 1
    said = str(told[0].message)
    assert "out of it points are pushed from 0.05" in said  # about half a spacing
    assert "what would help: Contact(stiffness=...) of more than the present 10 N/m" in said


def test_what_meets_itself_without_a_thickness_is_reported_too():
    body = box((4, 4, 4), 0.1, mass=0.02, stiffness=500.0, damping=0.5).translate((0, 0, 0.2))
    floor = Plane(friction=0.5)
    simulation = Simulation(
        body.with_velocity((0, 0, -30)), contact=Contact(self_contact=True), colliders=[floor], device="cpu"
    )
    with pytest.warns(TunnellingWarning, match="what would help: Contact"):
        simulation.step(30)


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
