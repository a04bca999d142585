"""Functions of time: automatic substeps resolve loads and motions that are fast, and given ones are warned of."""

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

import msdwarp as msd
from msdwarp.engine import LOOK

BRIEF = 2e-3  # [s], an eighth of a frame
HOW: dict[str, Any] = {"precision": "float64", "device": "cpu"}
FREE: dict[str, Any] = {**HOW, "gravity": 0.0}
PARTICLE = msd.System(position=[(0, 0, 0)], mass=1.0)
SHEET = msd.sheet((3, 3), 0.1, mass=0.001, stiffness=10.0)


def pulse(begin: float, size: float = 1.0):
    return lambda t: size if begin <= t < begin + BRIEF else 0.0


@wp.func
def own_pulse(x: Any, v: Any, t: Any, i: int):
    """1 N along x from 0.1037 s to 0.1057 s."""
    force = type(x)()
    if t >= type(t)(0.1037) and t < type(t)(0.1057):
        force[0] = type(t)(1.0)
    return force


@wp.func
def own_gust(x: Any, t: Any):
    """1 m/s along x from 0.1037 s to 0.1057 s."""
    velocity = type(x)()
    if t >= type(t)(0.1037) and t < type(t)(0.1057):
        velocity[0] = type(t)(1.0)
    return velocity


@wp.func
def own_hum(x: Any, v: Any, t: Any, i: int):
    """1 N at 60 Hz."""
    return type(x)(wp.sin(type(t)(376.99111843) * t), type(t)(0.0), type(t)(0.0))


@pytest.mark.parametrize("begin", [0.0, 0.05, 0.1037])
def test_a_pulse_shorter_than_a_substep_gives_its_impulse(begin):
    # 20 substeps fall into it, of which one more or fewer counts: 5 %.
    one, along = pulse(begin), pulse(begin, 1e-3)
    cloud = msd.System(position=np.eye(3), mass=1.0)
    loads = [
        msd.Force(lambda t: (one(t), 0, 0), on=[0]),
        msd.Wind(lambda t: (one(t), 0, 0), on=[1], area=1.0, drag=2.0, density=1.0),  # pushes by u²
    ]
    own = [msd.Force(own_pulse, on=[0]), msd.Wind(own_gust, on=[1], area=1.0, drag=2.0, density=1.0)]
    for given in (loads, own):
        run = msd.Simulation(cloud, loads=given, gravity=along, **HOW)
        run.step(12)
        np.testing.assert_allclose(run.frame().velocity[:2, 0] / BRIEF, 1.0, rtol=0.05)
        np.testing.assert_allclose(run.frame().velocity[:, 2] / BRIEF, -1e-3, rtol=0.05)
    run = msd.Simulation(SHEET, loads=[msd.Pressure(along)], **FREE)
    run.step(12)
    momentum = 0.001 * run.frame().velocity.sum(axis=0)
    assert np.linalg.norm(momentum) / BRIEF == pytest.approx(1e-3 * 0.04, rel=0.05)  # 0.04 m²


@pytest.mark.parametrize("hertz", [55.0, 60.0, 120.0])
def test_a_drive_at_the_frame_rate_has_not_diverged(hertz):
    # At the ends of frames the drive is at rest in the middle, and all energies are nearly 0; within they are not.
    drive = msd.PrescribedMotion([0], lambda t: (1e-3 * math.sin(2 * math.pi * hertz * t), 0, 0))
    run = msd.Simulation(msd.chain(5, 0.1, mass=0.1, stiffness=20.0, damping=0.0), loads=[drive], **FREE)
    run.step(120)
    assert max(count for _, count in run.substep_history) <= 160


def test_the_work_of_a_drive_is_kept_when_substeps_change():
    # Of a spring that is far softer than inertia the drive stores ½ k x² in it, whatever the substeps.
    drive = msd.PrescribedMotion([0], lambda t: (1e-3 * math.sin(2 * math.pi * 55 * t), 0, 0))
    chain = msd.chain(2, 0.1, mass=1e6, stiffness=20.0, damping=0.0)
    run = msd.Simulation(chain, loads=[drive], substeps=72, **FREE)
    run.step()
    for k in range(1, 12):  # it has moved to −A/2, and goes back
        run._run.stepping = run.stepping.with_choice(replace(run.choice, substeps=720))
        run.stepping.advance(k / 60)
    # Half of a substep's work is f·v h/2 but for a fraction 2ωh, 0.16 at first.
    lost = 0.5 * (20.0 * 0.5e-3) * (1e-3 * 2 * math.pi * 55 * 0.866) * (1 / 72 - 1 / 720) / 60
    assert run.measure().external_work == pytest.approx(0.0, abs=0.2 * lost)  # it is at rest length again


@pytest.mark.slow
@pytest.mark.parametrize("hertz", [59.0, 60.0, 120.0])
@pytest.mark.parametrize("held", ["drive", "carrier"])
def test_a_driven_oscillator_has_the_amplitude_of_the_steady_state(held, hertz):
    own, damping, size, w = 2 * math.pi * 40, 6.0, 1e-3, 2 * math.pi * hertz

    def motion(t):  # takes no array
        return size * math.sin(w * t), 0.0, 0.0

    if held == "drive":
        springs = {"connections": [(0, 1)], "stiffness": own**2, "damping": damping}
        load = msd.PrescribedMotion([0], motion)
    else:
        springs, carrier = {}, msd.Sphere((0, 0, 0), 0.1, motion=motion)
        load = msd.Attachment([1], carried_by=carrier, stiffness=own**2, damping=damping)
    system = msd.System(position=[(0, 0, 0), (1, 0, 0)], mass=1.0, **springs)
    probes = {"end": msd.Probe([1], "position", every="substep")}
    run = msd.Simulation(system, loads=[load], probes=probes, **FREE)
    run.step(150)
    times, places = run.readings["end"]
    late = times > 2.0  # exp(−c t / 2) of the beginning is left there: 0.25 %
    waves = np.stack([np.sin(w * times[late]), np.cos(w * times[late]), np.ones(late.sum())], axis=1)
    found = np.hypot(*np.linalg.lstsq(waves, places[late].reshape(-1, 3)[:, 0])[0][:2])
    right = size * abs((own**2 + 1j * w * damping) / (own**2 - w**2 + 1j * w * damping))
    # Of ω² a substep of 2π/20ω takes (2π/20)²/12 = 0.8 % off, which the difference to the own frequency doubles.
    # At 120 Hz velocities that are half a substep old turn the damper's force by π/20: 2 % of k/ω² there.
    assert found == pytest.approx(right, rel=0.03)


def test_a_floor_that_moves_at_the_frame_rate_throws_a_bead():
    # It leaves the floor, which has v = Aω then, where this slows by more than gravity: at once.
    size, w = 1e-3, 2 * math.pi * 60
    floor = msd.Plane(motion=lambda t: (0, 0, size * math.sin(w * t)), restitution=0.0)
    run = msd.Simulation(PARTICLE, colliders=[floor], **HOW)
    run.step(2)
    turn = math.asin(9.82 / (size * w**2))
    left, height, speed = turn / w, size * math.sin(turn), size * w * math.cos(turn)
    flight = 2 / 60 - left
    # The floor's speed is its mean over a substep: with 20 to a period 1 − sin(π/10)/(π/10) = 1.6 % less.
    assert run.frame().position[0, 2] == pytest.approx(height + speed * flight - 4.91 * flight**2, rel=0.05)


def hum(t):
    return np.sin(2 * np.pi * 60 * t)


def shaken(t):
    return 1e-3 * hum(t), 0 * t, 0 * t


@pytest.mark.parametrize(
    ("around", "name"),
    [
        ({"loads": [msd.Force(shaken)]}, "loads[0].force"),
        ({"loads": [msd.Force(own_hum)]}, "loads[0].force"),
        ({"gravity": hum}, "gravity"),
        ({"loads": [msd.Wind(shaken)]}, "loads[0].velocity"),
        ({"loads": [msd.Pressure(hum)]}, "loads[0].pressure"),
        ({"loads": [msd.Actuator(lambda t: 0.1 * hum(t))]}, "loads[0].strain"),
        ({"loads": [msd.PrescribedMotion([0], shaken)]}, "loads[0]"),
        (
            {"loads": [msd.Attachment([0], carried_by=msd.Sphere(motion=shaken), stiffness=1.0)]},
            "loads[0].carried_by",
        ),
        ({"colliders": [msd.Plane(), msd.Sphere((0, 0, 9), motion=shaken)]}, "colliders[1]"),
        ({"colliders": [msd.Box((0, 0, 9), motion=lambda t: ((0 * t,) * 3, shaken(t)))]}, "colliders[0]"),
    ],
)
def test_no_period_hides_in_that_of_frames(around, name):
    run = msd.Simulation(SHEET, **{**FREE, **around})
    assert run.substeps == 20
    assert f"{name} 20" in str(run.choice)
    with pytest.warns(msd.StepWarning, match="60 Hz|would resolve it"):
        msd.Simulation(SHEET, substeps=9, **{**FREE, **around})


def test_slow_functions_take_no_more_substeps():
    slow = [lambda t: (1, 0, 0), lambda t: (3 * t, 0, 0), lambda t: (np.sin(3 * t), 4 + np.cos(5 * t), 0 * t)]
    for one in slow:
        # Without a limit of energy, functions alone are followed.
        run = msd.Simulation(PARTICLE, loads=[msd.Force(one)], energy_limit=math.inf, **FREE)
        run.step(2 * LOOK)
        assert max(count for _, count in run.substep_history) <= 2
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            msd.Simulation(run.system, loads=[msd.Force(one)], substeps=1, **FREE).step(LOOK)


def test_given_substeps_are_warned_of_once_and_the_load_is_named():
    loads = [msd.Force((0, 0, 1)), msd.Force(lambda t: (pulse(0.4)(t), 0, 0))]
    run = msd.Simulation(PARTICLE, loads=loads, substeps=2, **FREE)
    said = r"loads\[1\].force changes too fast for substeps=2 between 0.3333 s and 0.5 s; 1[56]\d would resolve it"
    with pytest.warns(msd.StepWarning, match=said) as found:
        run.step(40)
    assert len(found) == 1


def test_functions_may_end_before_the_look_does():
    def ends(t):
        if np.max(t) > 0.2:
            raise ValueError("no data")
        return (hum(t), 0 * t, 0 * t)

    run = msd.Simulation(PARTICLE, loads=[msd.Force(ends)], **FREE)
    assert run.substeps > 15
    run.step(12)
    with pytest.raises(ValueError, match="no data"):
        run.step()


@pytest.mark.parametrize("later", [False, True], ids=["from the start", "brought by a change"])
def test_substeps_of_a_pulse_repeat_and_resume(later):
    given = {"loads": [msd.Force(lambda t: (pulse(0.21)(t), 0, 0))]}
    if later:
        given = {"schedule": [msd.at(0.1, gravity=pulse(0.21))]}
    whole, first, rest = (msd.Simulation(PARTICLE, **given, **FREE) for _ in range(3))
    whole.step(25)
    first.step(10)
    rest.restore(*first.checkpoint())
    rest.step(15)
    assert max(count for _, count in whole.substep_history) > 100
    assert rest.substep_history == whole.substep_history
    np.testing.assert_array_equal(rest.frame().velocity, whole.frame().velocity)
    assert whole.substeps < 10  # they end with it


def test_worlds_follow_functions_of_time_as_single_runs_do():
    system, loads = PARTICLE, [msd.Force(lambda t: (pulse(0.21)(t), 0, 0))]
    worlds = msd.Ensemble(system, 2, loads=loads, mass=[1.0, 2.0], **FREE)
    worlds.step(25)
    for k, mass in enumerate((1.0, 2.0)):
        # Without a limit of energy its automatic substeps follow functions alone, as those of worlds.
        one = msd.Simulation(system.replace(mass=mass), loads=loads, energy_limit=math.inf, **FREE)
        one.step(25)
        assert max(count for _, count in one.substep_history) > 100
        np.testing.assert_array_equal(worlds.frame().velocity[k], one.frame().velocity)
        assert mass * worlds.frame().velocity[k, 0, 0] / BRIEF == pytest.approx(1.0, rel=0.05)


def test_noise_asks_for_no_substeps():
    random = np.random.default_rng(1)
    noise = msd.Force(lambda t: (0.01 * random.normal(), 0, 0), on=[0])
    # What is resolved beside it is followed: 20 substeps to a period of a frame.
    loads = [noise, msd.Wind(shaken, on=[1], area=1.0, drag=2.0, density=1.0)]
    system = msd.System(position=np.eye(3), mass=1.0)
    said = r"loads\[0\].force changes too fast for automatic substeps between 0 s and 0.1667 s; no number would"
    with pytest.warns(msd.StepWarning, match=said) as found:
        run = msd.Simulation(system, loads=loads, energy_limit=math.inf, **FREE)
    assert len(found) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run.step(LOOK + 1)
    assert run.substep_history == [(0.0, 20)]


def test_noise_is_named_with_given_substeps_too():
    random = np.random.default_rng(1)
    noise = msd.Force(lambda t: (0.01 * random.normal(), 0, 0))
    with pytest.warns(msd.StepWarning, match="too fast for substeps=30 between .* no number would resolve it"):
        msd.Simulation(PARTICLE, loads=[noise], substeps=30, **FREE)


@pytest.mark.parametrize(
    "force", [lambda t: np.cos(t) ** 2 + np.sin(t) ** 2 - 1, lambda t: 1e-12 * np.sin(6000 * math.pi * t)]
)
@pytest.mark.filterwarnings("error")
def test_forces_below_the_rounding_of_weights_ask_for_nothing(force):
    system = msd.System(position=[(0, 0, 0), (0, 0, 1)], mass=[1.0, math.inf])
    load = msd.Force(lambda t: (force(t), 0 * t, 0 * t))
    assert msd.Simulation(system, loads=[load], device="cpu").substeps == 1
    assert msd.Simulation(system, loads=[msd.Force(shaken)], device="cpu").substeps == 20  # 1 mN is not below it


@pytest.mark.parametrize("hertz", [5e3, 1e4])
def test_a_fast_sinusoid_is_not_taken_for_noise(hertz):
    load = msd.Force(lambda t: (np.sin(2 * math.pi * hertz * t), 0 * t, 0 * t))
    run = msd.Simulation(PARTICLE, loads=[load], **FREE)
    assert run.substeps == pytest.approx(20 * hertz / 60, rel=0.1)  # chords between 25 values a period are flatter
