"""Automatic substeps: energy that comes from nothing takes the frame back; work from outside is let in."""

import json
import math

import h5py
import numpy as np
import pytest

from msdwarp import (
    RK4,
    EnergyDriftWarning,
    ExplicitEuler,
    Leapfrog,
    Plane,
    Simulation,
    SimulationDiverged,
    SymplecticEuler,
    Trajectory,
    TrajectoryWriter,
    ball,
    box,
    chain,
)
from msdwarp.simulation import Readback

pytestmark = pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")
"""Blocks of springs alone that start twice as long as at rest turn some cells inside out, with a warning."""
OPTIONS = {"gravity": 0.0, "device": "cpu", "precision": "float64"}
KICK_DRIFT = pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])


def stretched(factor: float = 2.0):
    """Return an undamped block of 4³ particles, stretched once."""
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=100.0)
    position = np.array(body.position)
    position[:, 0] *= factor
    return body.replace(position=position, rest_length=body.rest_length)


# The energy that is watched


@KICK_DRIFT
def test_the_energy_watched_is_constant_in_linear_motion_near_the_limit(integrator):
    # A chain that moves along itself is linear: what kick-drift conserves is constant to rounding, though at 0.95
    # of the limit kinetic and elastic energy together swing by 1/(1 − 0.95²), ten times, when the fastest mode
    # has them.
    count, k, m = 12, 1000.0, 1.0
    body = chain(count, stiffness=k, mass=m).pin([0, count - 1])
    j = count - 2  # the fastest mode of n − 1 springs
    mode = 0.01 * np.sin(np.pi * j * np.arange(count) / (count - 1))
    omega = 2 * math.sqrt(k / m) * math.sin(np.pi * j / (2 * (count - 1)))
    h = 0.95 * 2 / omega
    system = body.replace(position=body.position + mode[:, None] * (1, 0, 0), rest_length=body.rest_length)
    simulation = Simulation(
        system,
        integrator=integrator,
        fps=1 / (3 * h),
        substeps=3,
        allow_unstable=True,
        energy_limit=1e9,
        **OPTIONS,
    )
    watched, plain = [], []
    for _ in range(200):
        simulation.step()
        watched.append(simulation.stepping.balance().energy)
        plain.append(simulation.stepping.balance().energy + simulation.stepping.balance().swing)
    # 600 substeps of sums of numbers near 0.01 and 10 J: a few thousand roundings.
    assert np.ptp(watched) < 1e-11 * np.mean(watched)
    assert max(plain) / min(plain) > 5


def test_with_both_at_one_instant_it_is_the_sum(device):
    simulation = Simulation(stretched(), integrator=RK4(), gravity=3.0, device=device, precision="float64")
    simulation.step(3)
    found, measured = simulation.stepping.balance(), simulation.measure()
    assert found.energy == pytest.approx(measured.energy, rel=1e-13)
    assert (found.swing, found.strain) == (0.0, pytest.approx(measured.largest_strain, rel=1e-13))
    momentum = measured.momentum @ measured.momentum / (2 * 0.01 * 64)
    inner = measured.kinetic_energy - momentum + measured.elastic_energy
    assert found.inner == pytest.approx(inner, rel=1e-9)  # what falls as a whole is taken off


# What is done with it


@KICK_DRIFT
def test_a_stretched_block_keeps_its_energy(integrator):
    start = Simulation(stretched(), integrator=integrator, **OPTIONS)
    energy, few = start.measure().energy, start.substeps
    start.step(300)
    assert abs(start.measure().energy / energy - 1) < 0.1  # 8 % at most above the least, and a swing of 4 %
    assert start.substeps > few
    # The same substeps as at the start are too few: the test can fail.
    fixed = Simulation(stretched(), integrator=integrator, substeps=few, energy_limit=math.inf, **OPTIONS)
    fixed.step(300)
    assert fixed.measure().energy > 2 * energy


def shaken():
    """Return an undamped box of 3 x 3 x 2 particles, each displaced at random."""
    body = box((3, 3, 2), 0.1, mass=0.01, stiffness=100.0)
    shifts = np.random.default_rng(0).normal(scale=0.04, size=body.position.shape)
    return body.replace(position=body.position + shifts, rest_length=body.rest_length)


def test_a_first_frame_that_is_refined_starts_from_the_start():
    simulation = Simulation(shaken(), **OPTIONS)
    simulation.step()
    assert simulation.substep_history[-1] == (0.0, simulation.substeps)
    assert len(simulation.substep_history) > 1  # it was refined
    fixed = Simulation(shaken(), substeps=simulation.substeps, **OPTIONS)
    fixed.step()
    # By the same launches from the same numbers; velocities differ by up to a times half a substep else.
    np.testing.assert_array_equal(simulation.frame().velocity, fixed.frame().velocity)
    np.testing.assert_array_equal(simulation.frame().position, fixed.frame().position)


def test_it_is_the_same_again_and_from_a_checkpoint_in_between():
    runs = [Simulation(stretched(), **OPTIONS) for _ in range(3)]
    runs[0].step(90)
    arrays, numbers = runs[0].checkpoint()
    assert len(runs[0].substep_history) > 1  # in the midst of it
    runs[0].step(60)
    runs[1].step(150)
    runs[2].restore(arrays, json.loads(json.dumps(numbers)))  # as a restart file keeps them
    runs[2].step(60)
    for other in runs[1:]:
        np.testing.assert_array_equal(other.frame().position, runs[0].frame().position)
        np.testing.assert_array_equal(other.frame().velocity, runs[0].frame().velocity)
        assert other.substep_history == runs[0].substep_history


def test_an_older_checkpoint_goes_on_as_a_run_that_begins():
    simulation, other = (Simulation(stretched(1.2), **OPTIONS) for _ in range(2))
    simulation.step(5)
    arrays, numbers = simulation.checkpoint()
    older = {k: v for k, v in numbers.items() if not k.startswith("pace.") and k not in ("chosen", "refinement")}
    other.restore(arrays, older)
    other.step(60)
    assert other.measure().energy < 1.1 * simulation.measure().energy
    assert other.substep_history[0] == (0.0, simulation.choice.substeps)
    del numbers["pace.rounding"]  # from before rounding errors were told
    other.restore(arrays, numbers)
    simulation.step(20)
    other.step(20)
    np.testing.assert_array_equal(other.frame().position, simulation.frame().position)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pace.least", math.nan, "pace.least of the checkpoint is nan; it must be a finite number"),
        ("pace.since", -1, "pace.since is -1; it must be a whole number of at least 0"),
        ("pace.anew", "no", "pace.anew is 'no'; it must be one of False, True"),
        ("chosen", [[0.0]], "chosen of the checkpoint is .*; it must be a list of pairs"),
        ("chosen", [[0.0, 0]], "chosen is 0; it must be a whole number of at least 1"),
    ],
)
def test_an_invalid_number_of_a_checkpoint_is_named(name, value, message):
    simulation = Simulation(stretched(1.2), **OPTIONS)
    arrays, numbers = simulation.checkpoint()
    with pytest.raises(ValueError, match=message):
        simulation.restore(arrays, numbers | {name: value})
    simulation.step()


def test_fewer_substeps_are_tried_when_all_is_calm():
    damped = stretched().replace(damping=0.02)
    simulation = Simulation(damped, **OPTIONS)
    few = simulation.substeps
    simulation.step(900)
    counts = [count for _, count in simulation.substep_history]
    assert max(counts) > few
    assert counts[-1] < max(counts)


@pytest.mark.slow
def test_work_from_outside_is_let_in_and_substeps_come_back():
    # A plane that rises lifts the body, which then has more energy than ever, whatever the step.
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.2).translate((0, 0, 0.11))

    def lift(t: float):
        return (0.0, 0.0, min(t, 2.0) * 0.5)

    simulation = Simulation(body, colliders=[Plane(motion=lift)], device="cpu", precision="float64")
    few, start = simulation.substeps, simulation.measure().energy
    simulation.step(180)
    assert simulation.measure().energy > start + 0.9 * 0.27 * 9.82 * 1.0  # a metre higher
    assert simulation.substeps <= 2 * few


def test_given_substeps_and_no_limit_are_left_alone():
    for options in ({"substeps": 6, "allow_unstable": True}, {"energy_limit": math.inf}):
        simulation = Simulation(stretched(), **options, **OPTIONS)
        simulation.step(60)
        assert len(simulation.substep_history) == 1


@pytest.mark.slow
def test_energy_that_no_step_takes_away_ends_the_run_in_words():
    # Explicit Euler throws what spins outwards with every step, dampers or not: its energy grows with the rate of
    # turning squared times the step, at any step.
    body = ball(0.2, 0.1, mass=0.01, stiffness=100.0, damping=5.0)
    simulation = Simulation(body.spin((60.0, 60.0, 60.0)), integrator=ExplicitEuler(), **OPTIONS)
    with pytest.raises(
        SimulationDiverged, match=r"energy has grown by \d+% without a cause, and shorter steps did not"
    ):
        simulation.step(6000)
    before = simulation.frame()
    assert before.time == simulation.time
    assert np.isfinite(before.position).all()


# Rounding errors


def trembling():
    """Return a stiff undamped block 20 m from the origin, whose particles move at random."""
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=1e5).translate((20, 0, 0))
    return body.replace(velocity=np.random.default_rng(0).normal(scale=0.1, size=(64, 3)))


def test_energy_from_rounding_errors_is_told_once():
    # Places near 20 m are rounded to 2e-6 m, which gives each of some 270 springs about 1e-7 J, 138 times a frame;
    # there are 9 mJ at the start.
    simulation = Simulation(trembling(), gravity=0.0, device="cpu")
    with pytest.warns(
        EnergyDriftWarning, match=r"energy has risen by .* J, .*float32.*'float32-compensated'"
    ) as told:
        simulation.step(120)
    assert len(told) == 1
    start = Simulation(trembling(), gravity=0.0, device="cpu").measure().energy
    assert simulation.measure().energy > 1.5 * start


def test_a_precision_that_keeps_small_steps_adds_no_energy():
    simulation = Simulation(trembling(), gravity=0.0, device="cpu", precision="float32-compensated")
    start = simulation.measure().energy
    simulation.step(120)  # a warning would be an error here
    # The watch lets it rise by 2 % of its scale, and what physics has be 4 % more than what the method conserves;
    # as much again while it finds the step.
    assert simulation.measure().energy == pytest.approx(start, rel=0.12)


# Where it is told


def test_what_was_chosen_is_kept_with_each_frame(tmp_path):
    simulation = Simulation(stretched(), **OPTIONS)
    readback, path = Readback(simulation, strain=False), tmp_path / "a.vtkhdf"
    taken = []
    with TrajectoryWriter(path, simulation.system, fps=60, strain=False) as writer:
        writer.write_pending(readback.take())
        for _ in range(60):
            simulation.step()
            taken.append(simulation.substeps)
            writer.write_pending(readback.take())
    with Trajectory(path) as trajectory:
        counts = trajectory.substeps
        assert counts is not None
        assert counts[0] == simulation.substep_history[0][1]
        np.testing.assert_array_equal(counts[1:], taken)
    with h5py.File(path, "r+") as file:
        file["msdwarp/substeps"][3] = -1
    with Trajectory(path) as trajectory, pytest.raises(ValueError, match="its substeps are no counts"):
        _ = trajectory.substeps
    times, numbers = zip(*simulation.substep_history, strict=True)
    assert len(set(taken)) > 1
    for k, count in enumerate(taken):  # frame k + 1 begins at k/60 s
        assert numbers[np.searchsorted(times, k / 60 + 1e-9) - 1] == count
