"""Contacts that are overrun: said once, with who, where, how fast, what would help; and not where all is well."""

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
    assert "points are pushed out of it up to a depth of 0.05" in said  # about half a spacing
    assert "remedies: Contact(stiffness=...) above the current 10 N/m" in said


def test_what_meets_itself_without_a_thickness_is_reported_too():
    body = box((4, 4, 4), 0.1, mass=0.02, stiffness=500.0, damping=0.5).translate((0, 0, 0.2))
    floor = Plane(friction=0.5)
    simulation = Simulation(
        body.with_velocity((0, 0, -30)), contact=Contact(self_contact=True), colliders=[floor], device="cpu"
    )
    with pytest.warns(TunnellingWarning, match="remedies: Contact"):
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
