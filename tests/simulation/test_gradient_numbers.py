"""Derivatives by numbers of loads and obstacles: central differences, closed forms, and twice to the last bit."""

import dataclasses
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from differences import FRAMES, METHODS, SOFT, STEP, at_end, block, loss, rounding, simulation
from test_gradient_effects import EFFECTS, method_for

import msdwarp as msd
from msdwarp import RK4, Leapfrog, Plane, Simulation, System

OBSTACLE = ["stiffness", "ramp", "dissipation", "friction", "rest_speed"]
NUMBERS = {
    "soft obstacles": [
        *(f"colliders[0].{name}" for name in (*OBSTACLE, "offset")),
        "colliders[1].position",
        "colliders[1].friction",
    ],
    "wind on a sheet": [f"loads[0].{name}" for name in ("velocity", "drag", "lift", "density")],
    "closed surfaces": [
        *(f"loads[0].{name}" for name in ("drag", "lift", "density")),
        *(f"loads[1].{name}" for name in ("pressure", "outside", "volume", "exponent")),
        *(f"loads[{k}].pressure" for k in (2, 3, 4)),
    ],
    "loads on particles": [
        "loads[1].force",
        "loads[2].force",
        "loads[3].velocity",
        "loads[3].drag",
        *(f"loads[4].{name}" for name in ("to", "stiffness", "damping", "rest_length")),
        *(f"loads[5].{name}" for name in ("to", "stiffness", "damping")),
    ],
}


def changed(options: dict[str, Any], name: str, change: Callable[[Any], Any]) -> dict[str, Any]:
    """Return the options of a simulation with a number changed, such as "loads[0].drag"."""
    where, k, field = re.split(r"\[|\]\.", name)
    several = list(options[where])
    one = several[int(k)]
    several[int(k)] = dataclasses.replace(one, **{field: change(getattr(one, field))})
    return options | {where: several}


def check(body: System, name: str, gradient: msd.Gradient, **options: Any) -> None:
    """Compare a derivative in a random direction with a central difference, see `differences.check`."""
    found, times = gradient[name], gradient.times.get(name)
    way = np.random.default_rng(1).normal(size=found.shape[times is not None :])
    terms = found * way if times is None else found * np.multiply.outer(np.sin(50 * times + 1), way)
    values, scale = [], 1.0

    def moved(given: Any, step: float) -> Any:
        nonlocal scale
        if callable(given):
            scale = np.abs(given(0.01)).max()
            return lambda t: np.asarray(given(t)) + step * scale * math.sin(50 * t + 1) * way
        scale = np.abs(given).max()
        return (np.asarray(given) + step * scale * way).tolist()

    for step in (STEP, -STEP):
        others = changed(options, name, lambda given, step=step: moved(given, step))
        _, frames = simulation(body, **others).differentiated(FRAMES, ())
        values.append(loss(frames)[0])
    # The losses of both sides are rounded; the error of the difference itself is of second order in the step.
    tolerance = 1e-6 * scale * abs(terms).max() + rounding(frames) / STEP
    assert scale * terms.sum() == pytest.approx((values[0] - values[1]) / (2 * STEP), rel=0, abs=tolerance), name


@pytest.mark.slow
@pytest.mark.parametrize("effect", NUMBERS)
def test_derivatives_by_numbers_are_those_of_central_differences(effect, plain_device):
    change, options = EFFECTS[effect]
    body, options = change(block()), options | {"integrator": method_for(effect), "device": plain_device}
    gradient = simulation(body, **options).gradient(loss, FRAMES, by=NUMBERS[effect])
    for name in NUMBERS[effect]:
        check(body, name, gradient, **options)


@pytest.mark.slow
def test_a_method_of_several_stages_has_derivatives_by_numbers(plain_device):
    loads = [msd.Wind((3.0, 1.0, -2.0), area=0.01), msd.Force(lambda t: (0.0, 40 * t, 0.0))]
    how = {"fps": 180.0, "substeps": 4, "integrator": RK4(), "device": plain_device}
    options = {"loads": loads, "colliders": [Plane((0.1, 0, 1), -0.1, **SOFT)], **how}
    names = ["loads[0].velocity", "loads[1].force", "colliders[0].friction"]
    gradient = simulation(block(), **options).gradient(loss, FRAMES, by=names)
    assert gradient["loads[1].force"].shape == (4 * 4 * FRAMES + 1, 3)
    for name in names:
        check(block(), name, gradient, **options)


def slide(t: Any, share: float = 0.0) -> Any:
    return (0.02 * np.sin(30 * t) + share * np.sin(50 * t), 0.1 * t, 0.3 * share * t)


def tumble(t: Any, share: float = 0.0) -> Any:
    turn = (0.5 * np.sin(20 * t) + share * t, 0.1 * t + 0.2 * share * np.sin(10 * t), 3 * t - share * t)
    return (0.02 * np.sin(30 * t), 0.1 * t, share * t * t), turn


@pytest.mark.parametrize("motion", [slide, tumble])
@pytest.mark.parametrize("method", [*METHODS.values(), RK4()])
@pytest.mark.each_value
def test_derivatives_by_motions_are_those_of_central_differences(motion, method, plain_device):
    def run(share: float) -> Simulation:
        drives = [msd.PrescribedMotion([31], slide), msd.PrescribedMotion([30, 12], lambda t: motion(t, share))]
        # Ten substeps: those of symplectic Euler take the velocity from poses between substeps, too.
        how = {"integrator": method, "substeps": 10, "device": plain_device}
        return simulation(block(), loads=drives, **how)

    name, step = "loads[1].motion", 1e-5
    gradient = run(0.0).gradient(loss, FRAMES, by=[name])
    up, down = (np.array([np.hstack(motion(t, share)) for t in gradient.times[name]]) for share in (1.0, -1.0))
    terms = gradient[name] * (up - down) / 2
    values = [loss(run(share).differentiated(FRAMES, ())[1])[0] for share in (step, -step)]
    # As in `check`; leapfrog's velocities at a frame have second differences of poses, 1/3840 s apart. With their
    # weights of 10 these are rounded to 1e-16 m · 10 · 3840²/s² = 1e-8 m/s², times half a substep: 6e-12.
    tolerance = 1e-6 * abs(terms).max() + 6e-12 / step
    assert terms.sum() == pytest.approx((values[0] - values[1]) / (2 * step), rel=0, abs=tolerance)


def test_a_sliding_block_goes_less_far_by_half_of_g_t_squared_for_each_friction(plain_device):
    # It starts where the ground carries it, so N = m g throughout. Friction is less than μ N by (s/u)²/2: 1e-6.
    mass, floor = 2.0, Plane(stiffness=4e4, friction=0.3, rest_speed=1e-3)
    depth = math.sqrt(2 * floor.ramp * mass * 9.82 / 4e4)
    body = System(position=[[0.0, 0, -depth]], velocity=[[3.0, 0, 0]], mass=mass)
    how = {"colliders": [floor], "precision": "float64", "substeps": 40, "device": plain_device}
    run = Simulation(body, integrator=Leapfrog(), **how)
    found = run.gradient(at_end(0), 30, by=["colliders[0].friction", "colliders[0].offset"])
    assert found["colliders[0].friction"] == pytest.approx(-9.82 * 0.5**2 / 2, rel=2e-6)
    assert found.value == pytest.approx(3.0 * 0.5 - 0.3 * 9.82 * 0.5**2 / 2, rel=2e-6)


def test_what_falls_steadily_has_the_derivatives_of_its_terminal_speed(plain_device):
    # ½ ρ C A v² = m g relative to the air, so ∂v/∂C = −v/(2C); the speed settles by e in m v/(2 m g), 0.05 s.
    wind = msd.Wind((0.5, 0.0, 0.3), drag=0.5, area=0.04)
    speed = math.sqrt(2 * 0.001 * 9.82 / (1.225 * 0.5 * 0.04))
    body = System(position=[[0.0, 0, 0]], velocity=[[0.5, 0, 0.3 - speed]], mass=0.001)
    how = {"loads": [wind], "precision": "float64", "substeps": 20, "device": plain_device}
    run, names = Simulation(body, integrator=Leapfrog(), **how), ["loads[0].velocity", "loads[0].drag"]
    found = run.gradient(at_end(2, "velocity"), 120, by=names)
    # After 2 s, forty times that, e^-40 is less than the rounding of 2400 sums.
    assert found["loads[0].drag"] == pytest.approx(speed / (2 * 0.5), rel=1e-9)
    np.testing.assert_allclose(found["loads[0].velocity"], [0, 0, 1], rtol=0, atol=1e-9)


def test_a_wind_on_no_area_has_derivatives_of_zero(plain_device):
    winds = [msd.Wind((1.0, 0, 0), area=0.01, on=[1]), msd.Wind((2.0, 0, 0), area=0.0, on=[0])]
    body = System(position=[[0.0, 0, 0], [1.0, 0, 0]], mass=0.01)
    run = Simulation(body, loads=winds, precision="float64", substeps=2, device=plain_device)
    found = run.gradient(at_end(0, "velocity"), 1, by=["loads[0].drag", "loads[1].drag"])
    assert found["loads[0].drag"] != 0.0
    assert found["loads[1].drag"] == 0.0


@pytest.mark.parametrize("method", [msd.SymplecticEuler(), Leapfrog()], ids=str)
def test_a_force_moves_by_what_is_left_of_the_time(method, plain_device):
    # F of substep n adds F h/m to the velocities of the N − n substeps that follow. At a later start Leapfrog's
    # velocity of half a substep ago is past, too: its first kick is a whole one.
    force = msd.Force(lambda t: (0.0, 0.0, 1.0 + t), on=[0, 1], total=True)
    body = System(position=[[0.0, 0, 0], [1.0, 0, 0]], mass=2.0)
    how = {"loads": [force], "precision": "float64", "substeps": 10, "device": plain_device}
    run = Simulation(body, integrator=method, **how)
    run.step(2)
    found, h = run.gradient(at_end(2), 3, by=["loads[0].force"]), 1 / 600
    np.testing.assert_allclose(found.times["loads[0].force"], h * np.arange(20, 51), rtol=1e-14)
    wanted = h**2 * np.arange(30, -1, -1) / (2 * 2.0)  # half of the force is on each
    np.testing.assert_allclose(found["loads[0].force"][:, 2], wanted, rtol=1e-12, atol=0)
    assert not found["loads[0].force"][:, :2].any()


@pytest.mark.slow
def test_a_turn_in_the_plane_moves_a_point_along_its_circle(plain_device):
    # x = u + cos θ / 2 at the end, with u and θ then: ∂x/∂u = 1, and ∂x/∂θ = −sin θ / 2.
    body = System(position=[[0.0, 5.0], [0.0, 0.0], [1.0, 0.0]], mass=1.0)
    drive = msd.PrescribedMotion([1, 2], lambda t: ((t, 0.0), 2 * t))
    how = {"loads": [drive], "precision": "float64", "substeps": 10, "device": plain_device}
    found = Simulation(body, integrator=Leapfrog(), **how).gradient(at_end(0), 3, by=["loads[0].motion"])
    by_motion, times = found["loads[0].motion"], found.times["loads[0].motion"]
    assert times[-1] == 3 / 60
    np.testing.assert_allclose(by_motion[-1], [1, 0, -math.sin(2 * times[-1]) / 2], rtol=0, atol=1e-14)
    assert not by_motion[:-1].any()


@pytest.mark.parametrize(
    "name",
    ["colliders[0].restitution", "colliders[1].friction", "loads[0].area", "loads[0].lift", "loads[1].force"],
)
def test_what_has_no_derivative_is_told_with_what_has(name):
    loads = [msd.Wind((1.0, 0, 0), lift=0.0, area=0.01)]
    run = simulation(block(), colliders=[Plane(offset=-1.0, **SOFT)], loads=loads, device="cpu")
    message = r"by\[1\] is '(loads|colliders).*'; it must be one of 'position'.*'colliders\[0\].friction'.*"
    with pytest.raises(ValueError, match=message + r"'loads\[0\].density'"):
        run.gradient(loss, 2, by=("position", name))
