"""Gravity and loads that change on the run, and gravity as a function of time."""

import math

import numpy as np
import pytest
from problems import EPS64

import msdwarp as msd

METHODS = [msd.SymplecticEuler(), msd.Leapfrog(), msd.RK4()]  # test_throwing.py has each method


def free(mass=(1.0, 2.5)) -> msd.System:
    """Return two particles that nothing joins, with a connection that hardly pulls, so that RKC2 has a step."""
    return msd.System(
        position=[[0.0, 0, 0], [1.0, 0, 0]], mass=mass, connections=[(0, 1)], stiffness=1e-14, damping=1e-14
    )


def options(device, **more):
    return {"precision": "float64", "fps": 10.0, "substeps": 20, "device": device, "allow_unstable": True, **more}


by_method = pytest.mark.parametrize("method", [msd.SymplecticEuler(), msd.RK4()], ids=str)


def under_gravity_of_time(method, device) -> msd.Simulation:
    """Return a run of 1 s under g(t).

    x'' = g(t) = (sin 2t, 0, −3t), from rest: v = ((1 − cos 2t)/2, 0, −3t²/2), x = ((2t − sin 2t)/4, 0, −t³/2).
    """

    def gravity(t):
        return np.sin(2 * t), 0 * t, -3 * t

    simulation = msd.Simulation(free(), gravity=gravity, integrator=method, **options(device))
    simulation.step(10)
    return simulation


@by_method
def test_gravity_of_time_is_integrated_twice(device, method):
    simulation = under_gravity_of_time(method, device)
    x = simulation.frame().position - free().position
    expected = [(2 - math.sin(2)) / 4, 0.0, -0.5]
    # h = 1/200: of order 1 an error of h/2 times v' dt, at most h (3/2 + 1); RK4 exact to h⁴.
    error = {1: 0.5 / 200 * 2.5, 4: 1e-9}[method.order]
    np.testing.assert_allclose(x, np.tile(expected, (2, 1)), rtol=0, atol=error)


@by_method
def test_what_gravity_of_time_has_done_is_work(device, method):
    # No potential belongs to it, and all of its work is motion.
    found = under_gravity_of_time(method, device).measure()
    assert found.gravitational_energy == 0
    kinetic = 0.5 * 3.5 * (((1 - math.cos(2)) / 2) ** 2 + 1.5**2)
    assert found.kinetic_energy == pytest.approx(kinetic, rel=0.01)  # h P·g / K = 0.7 %, where velocities lag
    assert found.external_work == pytest.approx(found.kinetic_energy, rel=0.01)


@by_method
def test_a_size_of_gravity_may_be_a_function_of_time(device, method):
    system = free(mass=(1.0, np.inf))
    constant, of_time = (
        msd.Simulation(system, gravity=g, integrator=method, **options(device)) for g in (4.0, lambda t: 4.0)
    )
    for one in (constant, of_time):
        one.step(10)
    np.testing.assert_allclose(of_time.frame().position, constant.frame().position, rtol=0, atol=200 * 4 * EPS64)
    np.testing.assert_array_equal(of_time.frame().position[1], [1.0, 0, 0])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_gravity_changes_in_flight(method, plain_device):
    # Half a second under g, then half of one under g'. Symplectic Euler starts at v rather than at v − h a/2: h/2
    # times v' too far in each half.
    simulation = msd.Simulation(free(), gravity=8.0, integrator=method, **options(plain_device))
    simulation.step(5)
    simulation.change(gravity=(3.0, 0.0, 2.0))
    simulation.step(5)
    g, other = np.array([0, 0, -8.0]), np.array([3.0, 0.0, 2.0])
    v = 0.5 * g + 0.5 * other
    x = 0.125 * g + 0.25 * g + 0.125 * other
    atol = 8.0 * 0.5 / 200 if method == msd.SymplecticEuler() else 200 * 20 * EPS64
    np.testing.assert_allclose(simulation.frame().velocity, np.tile(v, (2, 1)), rtol=0, atol=atol)
    np.testing.assert_allclose(
        simulation.frame().position - free().position, np.tile(x, (2, 1)), rtol=0, atol=atol
    )


def bouncing(device, **more) -> msd.Simulation:
    block = msd.box((3, 3, 3), 0.1, stiffness=2000.0, damping=5.0)
    return msd.Simulation(block, colliders=[msd.Plane(offset=-0.3)], precision="float64", device=device, **more)


@pytest.mark.slow
def test_a_change_of_gravity_is_the_same_by_every_way(device):
    # Bit for bit: the kernels are the same, and so are the velocities that they start from.
    quick, anew, resumed = (bouncing(device) for _ in range(3))
    schedule = bouncing(device, schedule=[msd.at(0.2, gravity=(0, 3.0, 5.0))])
    for one in (quick, anew):
        one.step(12)
    quick.change(gravity=(0, 3.0, 5.0))
    anew.change(gravity=(0, 3.0, 5.0), stiffness=2000.0)
    quick.step(4)
    resumed.restore(*quick.checkpoint())
    for one, frames in ((quick, 8), (anew, 12), (schedule, 24), (resumed, 8)):
        one.step(frames)
    # Substeps may be chosen anew where all is built anew; on the CPU, in a fixed order, they are not here.
    atol = 0 if device == "cpu" else 1e-9
    for one in (anew, schedule, resumed):
        np.testing.assert_allclose(quick.frame().position, one.frame().position, rtol=0, atol=atol)
    quick.reset()
    assert list(quick.model.gravity) == [0, 0, -9.82]


def test_gravity_turned_about_again_and_again_is_no_divergence(device):
    # Each change adds to the potential; what the energies are compared with goes along.
    simulation = bouncing(device)
    for k in range(40):
        simulation.change(gravity=((-1.0) ** k * 6.0, 0.0, -9.82 * (1 + k % 3)))
        simulation.step()
    assert np.isfinite(simulation.frame().position).all()


def test_another_force_takes_over_in_place(device):
    group = [1]
    loads = [msd.Force((0.0, 1.0, 0.0)), msd.Force((2.0, 0.0, 0.0), on=group)]
    simulation = msd.Simulation(free(), gravity=0.0, loads=loads, **options(device))
    simulation.step(5)
    stepping, graph = simulation.stepping, simulation.stepping.graph
    simulation.change(loads=[loads[0], msd.Force((0.0, 0.0, 5.0), on=group)])
    assert simulation.stepping is stepping
    assert stepping.graph is graph
    simulation.step(5)
    expected = np.array([[0.0, 1.0, 0.0], [1.0 / 2.5, 1.0 / 2.5, 2.5 / 2.5]])
    # Exact for what is constant; symplectic Euler's velocities are half a substep old.
    np.testing.assert_allclose(simulation.frame().velocity, expected, rtol=0, atol=200 * 8 * EPS64)


def test_a_drive_does_not_begin_anew_when_loads_change(device):
    drive = msd.PrescribedMotion([0], lambda t: (t, 0.0, 0.0))
    driven = msd.Simulation(free(), gravity=0.0, loads=[drive], **options(device))
    driven.step(5)
    driven.change(loads=[drive, msd.Force((0.0, 1.0, 0.0))])
    driven.step(5)
    np.testing.assert_allclose(driven.frame().position[0], [1.0, 0.0, 0.0], rtol=0, atol=1e-12)


@pytest.mark.slow
def test_other_wind_takes_over_in_place(device):
    group = [0]
    how = {"gravity": 0.0, "integrator": msd.RK4(), **options(device)}
    wind = msd.Wind((3.0, 0.0, 0.0), area=0.1, on=group)
    simulation = msd.Simulation(free(), loads=[wind], **how)
    simulation.step(2)
    stepping, before = simulation.stepping, simulation.snapshot()
    stronger = msd.Wind((9.0, 0.0, 0.0), area=0.1, on=group, drag=2.0)
    simulation.change(loads=[stronger])
    assert simulation.stepping is stepping
    anew = msd.Simulation(before, loads=[stronger], **how)
    for one in (simulation, anew):
        one.step(3)
    np.testing.assert_allclose(simulation.frame().velocity, anew.frame().velocity, rtol=1e-13, atol=1e-15)


@pytest.mark.slow
def test_other_loads_take_over_altogether(device):
    how = {"gravity": 0.0, "integrator": msd.RK4(), **options(device)}
    simulation = msd.Simulation(free(), loads=[msd.Wind((3.0, 0.0, 0.0), area=0.1, on=[0])], **how)
    simulation.step(2)
    simulation.change(loads=[])
    rest = simulation.frame().velocity
    assert rest[0, 0] > 0
    simulation.step(3)
    np.testing.assert_allclose(simulation.frame().velocity, rest, rtol=0, atol=1e-12)  # the faint spring
    simulation.change(loads=[msd.Force(lambda t: (0.0, 1.0, 0.0))])
    simulation.step(1)
    np.testing.assert_allclose(simulation.frame().velocity[:, 1], [0.1, 0.04], rtol=1e-12)


def meeting() -> msd.System:
    """Return two particles that come towards each other along x, and would meet in the middle after 0.5 s."""
    position, velocity = [[-0.5, 0, 0], [0.5, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]]
    return msd.System(position=position, velocity=velocity, mass=1.0, connections=np.zeros((0, 2), int))


CONTACT = msd.Contact(thickness=0.1, stiffness=1e4, restitution=1.0, friction=0.0)


def meets(device, contact=()) -> msd.Simulation:
    """Return the run to 0.15 s: the two bounce by 0.45 s, or pass through each other."""
    how = {"gravity": 0.0, "loads": [msd.Force((0.0, 1.0, 0.0))], **options(device, fps=100.0)}
    simulation = msd.Simulation(meeting(), contact=contact, **how)
    simulation.step(15)
    return simulation


@pytest.mark.slow
@pytest.mark.parametrize(("before", "after", "speed"), [((), CONTACT, -0.9), (CONTACT, (), 1.0)])
def test_bodies_touch_by_the_rule_of_the_last_change(device, before, after, speed):
    simulation = meets(device, before)
    simulation.change(contact=after)
    simulation.step(65)
    frame = simulation.frame()
    assert frame.velocity[0, 0] == 1.0 if speed > 0 else frame.velocity[0, 0] < speed
    # The force has gone on: y = t²/2, to h/2 of the speed.
    np.testing.assert_allclose(frame.position[:, 1], 0.32, rtol=0, atol=0.8 / 2000)


@pytest.mark.slow
def test_a_reset_takes_back_the_rules_of_contact(device):
    simulation = meets(device)
    simulation.change(contact=CONTACT)
    simulation.reset()
    simulation.step(80)
    assert simulation.frame().velocity[0, 0] == 1.0


@pytest.mark.slow
def test_bodies_touch_still_when_loads_change(device):
    simulation = meets(device, CONTACT)
    effects = simulation.assembly.all
    simulation.change(loads=[msd.Force((0.0, 2.0, 0.0))])
    assert simulation.assembly.all is effects
    simulation.step(5)
    simulation.change(loads=[msd.Wind((0.0, 0.0, 0.0), area=1e-3)])
    assert simulation.assembly.all is not effects
    simulation.step(65)
    assert simulation.frame().velocity[0, 0] < -0.9
    simulation.change(loads=[msd.Contact(exclude=True)])  # what stands among the loads counts as before
    simulation.change(loads=[])
    assert not any(type(one).__name__ == "BodyContact" for one in simulation.assembly.all)


@pytest.mark.parametrize("what", [{"loads": []}, {"contact": CONTACT}], ids=["loads", "contact"])
def test_a_schedule_says_that_it_holds_no_loads(what):
    with pytest.raises(ValueError, match="is given to a schedule, which cannot hold it"):
        msd.at(1.0, **what)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gravity": (1.0, 2.0)}, r"gravity has shape \(2,\)"),
        ({"gravity": np.inf}, "gravity is inf; it must be finite"),
        ({"gravity": lambda t: (1.0, 2.0)}, "gravity has 2 numbers; it must have 3"),
        ({"loads": [3]}, r"loads\[0\] is 3; it must be a Load"),
        ({"loads": [msd.Force((1.0, 2.0))]}, r"loads\[0\].*force"),
        ({"loads": [], "mass": 2.0}, "loads takes the place of all loads; nothing but loads and contact may"),
        (
            {"contact": msd.Contact(), "mass": 2.0},
            "contact takes the place of all rules of contact; nothing but loads and",
        ),
        ({"contact": 3}, r"contact\b.*must be"),
        ({"contact": msd.Contact(groups=("one", "other"))}, "a name in contact.groups is 'one'"),
        ({"contact": CONTACT, "integrator": msd.RKC2()}, "where bodies touch it must be another"),
    ],
)
def test_bad_changes_are_refused_by_name_and_change_nothing(changes, message):
    changes, method = dict(changes), changes.get("integrator")
    changes.pop("integrator", None)
    simulation = msd.Simulation(free(), loads=[msd.Force((0.0, 1.0, 0.0))], integrator=method, **options("cpu"))
    simulation.step(2)
    before, acting = simulation.frame(), simulation.assembly.all
    with pytest.raises(ValueError, match=message):
        simulation.change(**changes)
    np.testing.assert_array_equal(simulation.frame().velocity, before.velocity)
    assert simulation.assembly.all is acting
