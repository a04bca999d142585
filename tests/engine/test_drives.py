"""Driven particles are where a function of time says, and what is attached feels place and speed."""

import itertools
import math

import numpy as np
import pytest
from problems import EPS64, two_quick
from scipy.integrate import solve_ivp

from msdwarp import (
    RK4,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    PrescribedMotion,
    Simulation,
    StartWarning,
    SymplecticEuler,
    System,
    at,
    box,
    chain,
)


def body() -> System:
    return box((3, 2, 2), spacing=0.2, mass=0.1, stiffness=80.0, damping=0.6).named("body")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "precision"),
    [(Leapfrog(), "float64"), (LinearlyImplicitEuler(iterations=4), "float32")],
    ids=str,
)
def test_a_pin_is_a_drive_that_stands_still(device, method, precision):
    # The same code but for where zeros come from: to the last bit. On a GPU the compiler may contract products
    # and sums of another kernel otherwise, implicit methods and bounds add by atomics: to rounding of 80 substeps.
    common = {"integrator": method, "precision": precision, "substeps": 20, "device": device}
    pinned = Simulation(body().pin([0, 5]), **common)
    driven = Simulation(
        body(), loads=[PrescribedMotion([0, 5], lambda t: ((0, 0, 0 * t), (0, 0, 0 * t)))], **common
    )
    without = Simulation(body(), loads=[PrescribedMotion([0, 5])], **common)
    for simulation in (pinned, driven, without):
        simulation.step(4)
    if device == "cpu":
        np.testing.assert_array_equal(without.frame().position, driven.frame().position)
        np.testing.assert_array_equal(driven.frame().position, pinned.frame().position)
        np.testing.assert_array_equal(driven.frame().velocity, pinned.frame().velocity)
    else:
        near = 1e-13 if precision == "float64" else 1e-5
        for other in (without, pinned):
            np.testing.assert_allclose(driven.frame().position, other.frame().position, rtol=0, atol=near)
    held = driven.frame().position[[0, 5]]
    np.testing.assert_array_equal(held, pinned.frame().position[[0, 5]])
    assert driven.choice.limit == pytest.approx(pinned.choice.limit, rel=1e-14)  # the bound takes both alike
    assert np.abs(driven.frame().position - body().position).max() > 0.005  # the rest hangs


@pytest.mark.parametrize(
    "method", two_quick([SymplecticEuler(), Leapfrog(damper_extrapolation=0.5), RK4()]), ids=str
)
def test_what_is_driven_evenly_is_as_what_stands(device, method):
    # Galilei: hung from particles that move at w, seen by somebody who moves with them.
    w = np.array([0.7, -0.4, 0.2])
    common = {"integrator": method, "precision": "float64", "fps": 100.0, "substeps": 8, "device": device}
    fixed = Simulation(body().pin([0, 1]), **common)
    drive = PrescribedMotion([0, 1], lambda t: (w[0] * t, w[1] * t, w[2] * t))
    moved = Simulation(body().with_velocity(w), loads=[drive], **common)
    for simulation in (fixed, moved):
        simulation.step(50)
    # 400 substeps (of up to 4 stages) that round places of 0.5 m, and speeds found from such over 1/800 s.
    np.testing.assert_allclose(
        moved.frame().position - 0.5 * w, fixed.frame().position, rtol=0, atol=4 * 400 * EPS64
    )
    np.testing.assert_allclose(moved.frame().velocity - w, fixed.frame().velocity, rtol=0, atol=800 * 400 * EPS64)
    assert np.abs(fixed.frame().position - body().position).max() > 0.05


def forced(method, substeps: int, device: str, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Return place and speed after 80 frames, 1 s, of a mass on a spring whose end swings, and those of SciPy."""
    k, m, A, omega = 40.0, 0.5, 0.2, 5.0
    system = System(
        position=[[0.0], [1.0]], mass=m, connections=[(0, 1)], stiffness=k, damping=damping, rest_length=1.0
    )
    drive = PrescribedMotion([0], lambda t: (A * np.sin(omega * t),))
    common = {"integrator": method, "gravity": 0.0, "precision": "float64", "fps": 80.0, "device": device}
    simulation = Simulation(system, loads=[drive], substeps=substeps, **common)
    simulation.step(80)
    frame = simulation.frame()

    def rates(t: float, y: np.ndarray) -> list[float]:
        x, v = y[0] - A * math.sin(omega * t), y[1] - A * omega * math.cos(omega * t)
        return [y[1], (-k * x - damping * v) / m]

    exact = solve_ivp(rates, (0, 1), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(frame.position[0], A * math.sin(omega), rtol=0, atol=4 * EPS64)
    return np.array([frame.position[1, 0] - 1.0, frame.velocity[1, 0]]), exact


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "damping", "order"),
    [
        (Leapfrog(damper_extrapolation=0.5), 2.0, 2),
        (RK4(), 2.0, 4),
    ],
    ids=str,
)
def test_what_is_attached_follows_in_the_order_of_its_method(device, method, damping, order):
    # Other methods in test_work.py. Against SciPy's DOP853 to 1e-12: halving the substeps divides the error by 2
    # to the order, within a third.
    errors = []
    for substeps in (1, 2, 4):
        found, exact = forced(method, substeps, device, damping)
        errors.append(np.abs(found - exact).max())
    for coarse, fine in itertools.pairwise(errors):
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.4)


def test_a_turn_is_about_the_centre_and_its_speed_is_told(plain_device):
    # A rod driven as a whole: ω × r, exact but for the differences (the second order of leapfrog's kick: (ωh)²/6).
    omega, h = 3.0, 1 / 600
    rod = System(position=[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], mass=[1.0, 1.0, 2.0])
    for about, centre in ((None, np.array([1.25, 0.0])), ((0.0, 1.0), np.array([0.0, 1.0]))):
        drive = PrescribedMotion(None, lambda t: ((0.5 * t, 0 * t), omega * t), about=about)
        common = {"integrator": Leapfrog(), "precision": "float64", "substeps": 10, "device": plain_device}
        simulation = Simulation(rod, loads=[drive], **common)
        simulation.step(20)
        t = simulation.time
        R = np.array([[math.cos(omega * t), -math.sin(omega * t)], [math.sin(omega * t), math.cos(omega * t)]])
        expected = (rod.position - centre) @ R.T + centre + [0.5 * t, 0]
        np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=8 * EPS64)
        r = expected - centre - [0.5 * t, 0]
        velocity = omega * np.stack([-r[:, 1], r[:, 0]], axis=1) + [0.5, 0]
        error = 2.5 * omega * (omega * h) ** 2 / 6
        np.testing.assert_allclose(simulation.frame().velocity, velocity, rtol=0, atol=error + 1e-11)


@pytest.mark.slow
def test_released_particles_go_on_as_they_went(plain_device):
    # With the speed of the motion then, and the mass they have: a free throw.
    system = System(position=[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]], mass=2.0).named("hand")
    drive = PrescribedMotion("hand", lambda t: (np.sin(2 * t), 0 * t, t))
    common = {"integrator": Leapfrog(), "precision": "float64", "device": plain_device, "fps": 50.0, "substeps": 4}
    simulation = Simulation(system, loads=[drive], schedule=[at(0.5, unpin="hand")], gravity=10.0, **common)
    simulation.step(50)
    v, s = np.array([2 * math.cos(1.0), 0, 1.0]), 0.5
    expected = system.position + [math.sin(1.0), 0, 0.5] + s * v + [0, 0, -5 * s * s]
    # Speed at the release is that of differences, 8 h²/6 s⁻² with leapfrog.
    np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=8 * (1 / 200) ** 2 / 6)
    assert simulation.measure().kinetic_energy == pytest.approx(2.0 * ((v - (0, 0, 5)) ** 2).sum(), rel=1e-3)


def test_some_may_be_released_before_others(plain_device):
    system = System(position=np.arange(6.0).reshape(3, 2))
    drive = PrescribedMotion(None, lambda t: (0 * t, 0 * t))
    simulation = Simulation(system, loads=[drive], precision="float64", device=plain_device)
    simulation.change(unpin=[1])
    simulation.step(3)
    fallen = simulation.frame().position[:, 1] < system.position[:, 1] - 0.001
    np.testing.assert_array_equal(fallen, [False, True, False])
    simulation.reset()
    simulation.step(3)
    np.testing.assert_array_equal(simulation.frame().position, system.position)


@pytest.mark.slow
def test_what_a_drive_did_is_not_forgotten_when_it_ends(plain_device):
    body = box((3, 2, 2), 0.2, mass=0.1, stiffness=80.0, damping=0.0).replace(groups={"end": [0, 1, 2]})
    drive = PrescribedMotion("end", lambda t: (0.1 * np.sin(9 * t), 0 * t, 0 * t))
    common = {"integrator": Leapfrog(), "precision": "float64", "device": plain_device, "substeps": 40}
    simulation = Simulation(body, loads=[drive], schedule=[at(0.1, unpin="end")], gravity=0.0, **common)
    start = simulation.checkpoint()
    simulation.step(15)
    end = simulation.measure()
    # What is released takes its own kinetic energy along, which the drive's work does not count.
    released = 0.5 * 0.3 * (0.9 * math.cos(0.9)) ** 2
    # Leapfrog's energy swings, by less than a thousandth with so many substeps.
    assert end.energy - released == pytest.approx(end.external_work, rel=1e-3)
    other = Simulation(body, loads=[drive], schedule=[at(0.1, unpin="end")], gravity=0.0, **common)
    other.restore(*simulation.checkpoint())
    assert other.measure().external_work == end.external_work
    simulation.restore(*start)
    assert simulation.measure().external_work == 0.0


@pytest.mark.slow
def test_obstacles_do_not_stop_what_is_driven(device):
    floor = Plane(restitution=0.0)
    drive = PrescribedMotion([0], lambda t: (0 * t, 0 * t, -t))
    system = chain(2, 0.5).translate((0, 0, 0.5))
    simulation = Simulation(
        system, colliders=[floor], loads=[drive], gravity=0.0, precision="float64", device=device
    )
    simulation.step(60)
    assert simulation.frame().position[0, 2] == pytest.approx(-0.5, abs=4 * EPS64)
    assert simulation.frame().position[1, 2] >= 0.0


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ([PrescribedMotion("hand", lambda t: (t, 0, 0))], r"loads\[0\].*'hand'"),
        ([PrescribedMotion([9], lambda t: (t, 0, 0))], r"loads\[0\]\.on .*out of bounds"),
        (
            [PrescribedMotion([0], lambda t: (t, 0))],
            r"loads\[0\]\.motion has no place at 0 s: motion\(0\) is \(0.0, 0\); it must be 3 finite numbers",
        ),
        (
            [PrescribedMotion([0, 1], lambda t: (t, 0, 0)), PrescribedMotion([1], lambda t: (0, 0, t))],
            r"loads\[1\] drives particle 1, as",
        ),
    ],
)
def test_what_cannot_be_driven_is_refused(loads, message):
    with pytest.raises(ValueError, match=message):
        Simulation(chain(3, 0.5), loads=loads, device="cpu", substeps=20)


def test_one_too_fast_for_the_step_is_refused(device):
    # 1000 m/s for 1/1200 s: further than the half metre to the next particle; nothing has moved then.
    drive = PrescribedMotion([0], lambda t: (1000 * t if t > 0.02 else 0.0, 0, 0))
    simulation = Simulation(chain(3, 0.5), loads=[drive], device=device, substeps=20)
    simulation.step()
    kept = simulation.frame().position
    with pytest.raises(ValueError, match=r"loads\[0\] moves by .* m in the substep .* take more substeps"):
        simulation.step()
    np.testing.assert_array_equal(simulation.frame().position, kept)


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match=r"motion is 3; it must be a function of time, or None"):
        PrescribedMotion("hand", 3)
    system = chain(3).named("rope")
    with pytest.raises(ValueError, match=r"unpin is 'rope', which names no particle that a drive holds"):
        Simulation(system, schedule=[at(1.0, unpin="rope")], device="cpu")


def test_a_motion_that_begins_elsewhere_is_allowed_and_told():
    with pytest.warns(StartWarning, match=r"loads\[0\] has displaced its particles by 0.1 m at time 0"):
        simulation = Simulation(chain(3), loads=[PrescribedMotion([0], lambda t: (0.1, 0, 0))], device="cpu")
    assert simulation.frame().position[0, 0] == pytest.approx(chain(3).position[0, 0] + 0.1, rel=1e-6)


def test_a_motion_that_fails_on_the_way_is_named(device):
    drive = PrescribedMotion([0], lambda t: (math.sqrt(0.045 - t) - math.sqrt(0.045), 0, 0))
    simulation = Simulation(chain(3), loads=[drive], device=device, substeps=20)
    with pytest.raises(ValueError, match=r"loads\[0\] has no place at 0.04.* s: "):
        simulation.step(5)
    assert simulation.frame_index == 2


@pytest.mark.slow
def test_a_drive_without_motion_holds_until_it_is_released():
    rope = chain(3, 0.5).named("rope")
    drive = PrescribedMotion([0])
    assert "at rest" in repr(drive)
    simulation = Simulation(rope, loads=[drive], schedule=[at(0.1, unpin=[0])], gravity=9.82, device="cpu")
    simulation.step(6)
    assert (simulation.frame().position[0] == rope.position[0].astype(np.float32)).all()
    simulation.step(6)
    assert simulation.frame().position[0, -1] < rope.position[0, -1]
