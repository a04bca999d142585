"""Changes at set times: when they come, whom they concern, and what they do to a motion, by exact solutions."""

import math
import re

import numpy as np
import problems
import pytest
from problems import EPS64

from msdwarp import RK4, Simulation, SymplecticEuler, System, UnstableStep, at, box, chain
from msdwarp.world.scene import Scene

M, K, STRETCH = 0.5, 40.0, 0.2


def swing(dim: int = 2) -> System:
    """Return a particle on a spring of 1 m whose other end is pinned, stretched along x."""
    position = np.zeros((2, dim))
    position[1, 0] = 1.0 + STRETCH
    return System(position=position, mass=[math.inf, M], connections=[[0, 1]], rest_length=1.0, stiffness=K)


def simulate(system: System, device: str, *changes, **options) -> Simulation:
    """Return a float64 simulation with frames of 0.1 s, without gravity."""
    options = {"gravity": 0.0, "precision": "float64", "fps": 10, "integrator": RK4()} | options
    return Simulation(system, device=device, schedule=changes, **options)


def swung(
    state: tuple[float, float], time: float, *, k: float, m: float = M, rest: float = 1.0
) -> tuple[float, float]:
    """Return (length, speed) of an undamped spring after a time."""
    length, speed = state
    w = math.sqrt(k / m)
    c, s = math.cos(w * time), math.sin(w * time)
    return rest + (length - rest) * c + speed / w * s, -(length - rest) * w * s + speed * c


def present(simulation: Simulation) -> tuple[float, float]:
    now = simulation.frame()
    return float(now.position[1, 0]), float(now.velocity[1, 0])


@pytest.mark.parametrize(("integrator", "error"), [(RK4(), 1e-9), (SymplecticEuler(), 2e-2)], ids=["rk4", "euler"])
def test_a_frequency_changes_when_it_should(device, integrator, error):
    # Stiffness, mass and rest length in turn, against the exact solution of each stretch of time.
    changes = [
        at(0.5, stiffness=4 * K),
        at(0.8, mass=2 * M, group=[1]),
        at(1.2, rest_length=lambda length: 0.9 * length),
    ]
    simulation = simulate(swing(), device, *changes, integrator=integrator, substeps=300)
    simulation.step(20)
    state = swung((1.0 + STRETCH, 0.0), 0.5, k=K)
    state = swung(state, 0.3, k=4 * K)
    state = swung(state, 0.4, k=4 * K, m=2 * M)
    state = swung(state, 0.8, k=4 * K, m=2 * M, rest=0.9)
    # With ω h = 0.006 over 2 s: the error in phase of RK4, (ωh)⁴ ωt/120, of 4e-10; of Euler a shift by h/2 at each
    # change, and ωh/2 in amplitude. Times an amplitude of 0.3 m.
    assert present(simulation)[0] == pytest.approx(state[0], abs=error)
    assert present(simulation)[1] == pytest.approx(state[1], abs=20 * error)  # times ω


@pytest.mark.parametrize(("time", "frame"), [(0.0, 0), (0.21, 3), (0.1 + 0.2, 3)])
def test_a_change_comes_with_the_first_frame_from_its_time_on(device, time, frame):
    # 0.1 + 0.2 is a bit more than 0.3, and 3 frames of 0.1 s are meant all the same.
    simulation = simulate(swing(), device, at(time, stiffness=2 * K))
    for k in range(9):
        assert simulation.frame_index == k
        simulation.step()
        assert (simulation.system.stiffness[0] == 2 * K) == (k >= frame)


@pytest.mark.parametrize("fps", [10, 24, 60, 1000 / 3])
@pytest.mark.parametrize("k", [0, 1, 3, 7, 10**6, 10**9])
def test_due_is_the_first_frame_from_its_time_on(k, fps):
    for time in (k / fps, k * (1 / fps), sum([1 / fps] * k) if k < 100 else k / fps):  # rounded differently
        assert at(time).is_due(k, fps)
        assert not at(time).is_due(k - 1, fps)
    assert not at((k + 1e-5) / fps).is_due(k, fps)  # later by more than a millionth of a frame


def test_places_and_speeds_go_on_through_a_change(device):
    simulation = simulate(swing(), device, at(0.3, stiffness=100 * K), substeps=200)
    simulation.step(3)
    before = simulation.frame()
    other = simulate(simulation.snapshot().replace(stiffness=100 * K), device, substeps=200)
    simulation.step()
    other.step()
    np.testing.assert_array_equal(simulation.frame().position, other.frame().position)
    np.testing.assert_array_equal(simulation.frame().velocity, other.frame().velocity)
    assert simulation.time == pytest.approx(0.4)
    assert not np.array_equal(before.position, simulation.frame().position)


def test_changes_come_in_the_order_of_their_times(device):
    # However they are given; those of one time in the order in which they are given.
    simulation = simulate(
        swing(),
        device,
        at(0.2, stiffness=lambda k: 3 * k),
        at(0.1, stiffness=10.0),
        at(0.2, stiffness=lambda k: k + 1),
        at(0.2, mass=lambda mass: mass + 1.0, group=[1]),
    )
    simulation.step(4)
    assert simulation.system.stiffness[0] == 31.0
    np.testing.assert_array_equal(simulation.system.mass, [math.inf, M + 1.0])


def test_functions_see_the_values_of_their_time(device):
    seen = []

    def double(values: np.ndarray) -> np.ndarray:
        seen.append(np.array(values))
        return 2 * values

    simulation = simulate(
        chain(4, dim=2), device, at(0.1, stiffness=double), at(0.2, stiffness=double, group=[0, 1])
    )
    seen.clear()  # they were tried on the system as it was given
    simulation.step(3)
    np.testing.assert_array_equal(seen[0], [1000.0] * 3)
    np.testing.assert_array_equal(seen[1], [2000.0])  # of those meant alone
    np.testing.assert_array_equal(simulation.system.stiffness, [4000.0, 2000, 2000])


@pytest.mark.parametrize(
    "group",
    ["middle", [1, 2, 3], np.array([3, 2, 1]), np.array([False, True, True, True, False]), slice(1, 4)],
    ids=["name", "list", "array", "mask", "slice"],
)
def test_a_group_is_its_particles_and_the_connections_between_them(device, group):
    row = chain(5, dim=1).replace(groups={"middle": [1, 2, 3]})
    if isinstance(group, slice):
        group = np.arange(5)[group]
    changes = [at(0.1, group=group, mass=[2.0, 3.0, 4.0], stiffness=50.0, damping=[0.1, 0.2], rest_length=0.8)]
    simulation = simulate(row, device, *changes)
    simulation.step(2)
    now = simulation.system
    np.testing.assert_array_equal(now.mass, [1, 2, 3, 4, 1])
    np.testing.assert_array_equal(now.stiffness, [1000, 50, 50, 1000])
    np.testing.assert_array_equal(now.damping, [0, 0.1, 0.2, 0])
    np.testing.assert_array_equal(now.rest_length, [1, 0.8, 0.8, 1])
    np.testing.assert_array_equal(now.original_length, now.rest_length)


def test_freezing_keeps_the_shape(device):
    # A stretched row, whose left part forgets what it was: its springs are slack from then on.
    row = chain(5, dim=2).replace(groups={"left": [0, 1, 2]})
    row = row.replace(position=1.2 * row.position)
    simulation = simulate(row.pin(slice(None)), device, at(0.1, group="left", set_rest_shape=True))
    simulation.step(2)
    np.testing.assert_allclose(simulation.system.rest_length, [1.2, 1.2, 1, 1], rtol=4 * EPS64)
    # Half k (0.2 m)² of each of the others.
    assert simulation.measure().elastic_energy == pytest.approx(2 * 1000 * 0.2**2 / 2, rel=40 * EPS64)
    simulation.change(set_rest_shape=True, stiffness=500.0)
    assert simulation.measure().elastic_energy == 0.0  # lengths along an axis are exact
    np.testing.assert_array_equal(simulation.system.stiffness, 500.0)


def test_an_infinite_mass_pins_and_a_finite_one_lets_go(device):
    changes = [at(0.2, pin=[1]), at(0.5, group=[1], mass=M)]
    simulation = simulate(swing(), device, *changes, substeps=300)
    simulation.step(2)
    held = simulation.frame().position[1]
    assert simulation.frame().velocity[1, 0] != 0.0
    for _ in range(3):
        simulation.step()
        np.testing.assert_array_equal(simulation.frame().position[1], held)
        assert not simulation.frame().velocity.any()
    simulation.step(4)
    # It swings on from rest where it was held. RK4's error in phase, (ωh)⁴ ωt/120, is 1e-11.
    assert present(simulation)[0] == pytest.approx(swung((float(held[0]), 0.0), 0.4, k=K)[0], abs=1e-9)


def test_a_stiffer_body_gets_more_substeps(device):
    # Unwatched: what the stability limit asks for, and no more.
    options = {"integrator": SymplecticEuler(), "energy_limit": math.inf}
    simulation = simulate(swing(), device, at(0.3, stiffness=100 * K), at(0.6, stiffness=K), **options)
    counts = []
    for _ in range(9):
        simulation.step()
        counts.append(simulation.substeps)
    few = counts[0]
    assert counts == [few] * 3 + counts[3:4] * 3 + [few] * 3
    # ω grows tenfold; both are rounded up.
    assert 10 * (few - 1) < counts[3] <= 10 * few
    assert str(simulation.choice.substeps) in str(simulation.choice)


def test_forced_substeps_that_do_no_longer_are_refused_until_they_do(device):
    simulation = simulate(swing(), device, at(0.2, stiffness=1e4 * K), substeps=4, integrator=SymplecticEuler())
    simulation.step(2)
    kept = simulation.frame()
    for _ in range(2):  # the change has not been passed over
        with pytest.raises(UnstableStep, match=r"after the change at 0\.2 s substeps is 4; at least"):
            simulation.step()
    assert simulation.time == kept.time
    np.testing.assert_array_equal(simulation.frame().position, kept.position)
    np.testing.assert_array_equal(simulation.frame().velocity, kept.velocity)
    assert simulation.system.stiffness[0] == K


def test_reset_runs_the_schedule_again(device):
    changes = [at(0.2, stiffness=9 * K), at(0.4, group=[1], mass=lambda mass: 2 * mass)]
    changes += [at(0.6, set_rest_shape=True)]
    simulation = simulate(swing(), device, *changes)

    def run() -> list:
        result = []
        for _ in range(8):
            simulation.step()
            now = simulation.snapshot()
            result.append([now.position, now.velocity, now.mass, now.stiffness, now.rest_length])
        return result

    first = run()
    simulation.reset()
    assert simulation.time == 0.0
    assert simulation.system.stiffness[0] == K
    np.testing.assert_array_equal(simulation.frame().position, swing().position)
    for before, again in zip(first, run(), strict=True):  # one connection a particle: sums have one order
        for a, b in zip(before, again, strict=True):
            np.testing.assert_array_equal(a, b)


def test_what_is_not_changed_stays_as_it_is(device):
    # A change that changes nothing, half way: positions lose nothing by going through the host.
    body = problems.tumbling_box(damping=0.2)
    options = {"integrator": SymplecticEuler(), "substeps": 40, "precision": "float32-compensated"}
    plain, changed = (simulate(body, device, *changes, **options) for changes in ([], [at(0.2, stiffness=10.0)]))
    for simulation in (plain, changed):
        simulation.step(4)
    # At most another order of sums: 160 substeps of roundings of 1 m/s.
    atol = 160 * 10 * problems.EPS32
    np.testing.assert_allclose(changed.frame().position, plain.frame().position, rtol=0, atol=atol)


def test_a_yielding_body_keeps_its_history_elsewhere(device):
    # All has yielded; then a group is given new rest lengths, which are new for it alone.
    row = chain(5, dim=1).replace(yield_strain=0.05, relaxation_time=0.0, groups={"left": [0, 1, 2]})
    row = row.replace(position=1.2 * row.position).pin(slice(None))
    simulation = simulate(row, device, at(0.2, group="left", rest_length=1.1), integrator=SymplecticEuler())
    simulation.step(2)
    np.testing.assert_allclose(simulation.snapshot().rest_length, 1.15, rtol=0, atol=4 * EPS64)
    simulation.step()
    now = simulation.snapshot()
    # The left springs yield again: 1.2 − 0.05 · 1.1; the right ones have 1.2 − 0.05 · 1.
    np.testing.assert_allclose(now.rest_length, [1.145, 1.145, 1.15, 1.15], rtol=0, atol=4 * EPS64)
    np.testing.assert_array_equal(now.original_length, [1.1, 1.1, 1.0, 1.0])
    simulation.change(stiffness=500.0)
    np.testing.assert_array_equal(simulation.system.original_length, [1.1, 1.1, 1.0, 1.0])
    np.testing.assert_allclose(simulation.system.rest_length, now.rest_length, rtol=0, atol=2 * EPS64)


def test_groups_outlive_what_is_done_to_systems():
    a = chain(3, dim=2).named("row")
    b = chain(2, dim=2).replace(groups={"row": [1], "end": [0]})
    both = a + b
    assert list(np.flatnonzero(both.group("row"))) == [0, 1, 2, 4]
    assert list(np.flatnonzero(both.group("end"))) == [3]
    assert list(np.flatnonzero((b + a).group("row"))) == [1, 2, 3, 4]
    assert list(np.flatnonzero((both + both).group("end"))) == [3, 8]
    moved = both.translate((1, 2)), both.rotate(0.5), both.spin(1.0), both.with_velocity((1, 0))
    for other in (*moved, both.pin(0), both.set_rest_shape(), both.named("all"), both.replace(mass=2.0)):
        assert list(np.flatnonzero(other.group("row"))) == [0, 1, 2, 4]
    assert both.named("all").group("all").all()
    assert set(both.named("all").groups) == {"row", "end", "all"}


def test_a_change_at_once_is_as_one_of_a_schedule(device):
    scheduled = simulate(swing(), device, at(0.2, group=[1], mass=2 * M, stiffness=2 * K))
    at_once = simulate(swing(), device)
    scheduled.step(2)
    at_once.step(2)
    at_once.change(group=[1], mass=2 * M, stiffness=2 * K)
    assert at_once.system.stiffness[0] == K  # of no connection are both ends meant
    scheduled.step(3)
    at_once.step(3)
    np.testing.assert_array_equal(at_once.frame().position, scheduled.frame().position)
    np.testing.assert_array_equal(at_once.frame().velocity, scheduled.frame().velocity)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: at(1.0, group="scoop", mass=1.0), "group is 'scoop'; it must be one of 'row'"),
        (lambda: at(1.0, group=[0, 7], mass=1.0), "group does not index 3 particles"),
        (lambda: at(1.0, group=[0.5], mass=1.0), "group does not index 3 particles"),
        (lambda: at(1.0, mass=-1.0), "mass"),
        (lambda: at(1.0, stiffness=[1, 2, 3]), "stiffness has shape (3,); it must be one number or 2 numbers"),
        (lambda: at(1.0, group=[0, 1], stiffness=[1.0, 2.0]), "stiffness has shape (2,)"),
        (lambda: at(1.0, rest_length=0.0), "rest_length"),
        (lambda: at(1.0, damping=lambda b: b - 1), "damping"),
        (lambda: "at(1.0)", "schedule[0] is 'at(1.0)'; it must be a Change, such as at(1.0, mass=2.0)"),
    ],
)
def test_what_cannot_be_is_said_before_anything_runs(change, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Simulation(chain(3).named("row"), device="cpu", schedule=[change()])


def test_what_a_scene_is_made_of_is_checked_when_it_is_made():
    body = box((3, 3, 3))
    with pytest.raises(ValueError, match=r"schedule\[0\] is 3; it must be a Change"):
        Scene(system=body, schedule=[3])
    with pytest.raises(ValueError, match=r"colliders\[0\] is 3; it must be a Collider"):
        Scene(system=body, colliders=[3])
    with pytest.raises(ValueError, match=r"schedule is .*it must be a sequence"):
        Simulation(body, schedule=at(0.1, mass=2.0), device="cpu")
    with pytest.raises(ValueError, match="group is 'x'; it must be one of those that exist: there are none"):
        body.group("x")


def test_nobody_is_changed_where_nobody_is_meant():
    body = box((3, 3, 3))
    np.testing.assert_array_equal(at(0.0, mass=5.0, group=[]).applied_to(body).mass, body.mass)
