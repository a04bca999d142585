"""Wind on surfaces and on particles: terminal speeds, no force at rest, work, momentum, and how it is refused."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import EPS64

from msdwarp import Simulation, SymplecticEuler, System, UnstableStep, Wind, chain, sheet, stability_limit
from msdwarp.bodies import facets_of
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds

RHO, DRAG, G = 1.225, 1.2, 9.82


def falling_sheet() -> System:
    """Return a flat sheet whose masses are as the areas around its particles, so that it falls flat."""
    cloth = sheet((7, 7), 0.1, stiffness=200.0, damping=0.2)
    share = np.bincount(facets_of(cloth).corner.ravel(), minlength=cloth.particle_count) / 3
    return cloth.replace(mass=0.1 * share / share.sum())


def terminal(mass: float, area: float) -> float:
    """Return v where ½ ρ C_d A v² = m g."""
    return math.sqrt(2 * mass * G / (RHO * DRAG * area))


@pytest.mark.slow
@pytest.mark.parametrize("rising", [0.0, 0.7])
def test_a_sheet_falls_at_its_terminal_speed(device, rising):
    # v = v_t tanh(g t / v_t) from rest in air at rest; after 3 s, 24 times v_t / g, that is v_t to e^-48.
    how = {"gravity": G, "device": device, "precision": "float64", "substeps": 30}
    simulation = Simulation(falling_sheet(), loads=[Wind((0, 0, rising), drag=DRAG)], **how)
    simulation.step(180)
    v = simulation.frame().velocity
    np.testing.assert_allclose(v[:, 2], rising - terminal(0.1, 0.36), rtol=1e-6)
    assert np.abs(v[:, :2]).max() < 1e-9
    measures = simulation.measure()
    # What gravity gives and is not kinetic, air has taken: first order in h, h/2 of a fall of g.
    if rising == 0.0:
        fallen = simulation.frame().position[:, 2].mean()
        spent = 0.1 * G * fallen + measures.kinetic_energy
        assert measures.external_work == pytest.approx(spent, rel=0.01)


def test_particles_fall_at_theirs(device):
    rope = chain(5, 0.2, mass=0.01)
    area = [0.01, 0.02, 0.01, 0.02, 0.01]
    loose = rope.replace(stiffness=0.0)
    how = {"gravity": G, "device": device, "precision": "float64", "substeps": 30}
    simulation = Simulation(loose, loads=[Wind((0, 0, 0), drag=DRAG, area=area)], **how)
    simulation.step(300)
    expected = [-terminal(0.01, a) for a in area]
    np.testing.assert_allclose(simulation.frame().velocity[:, 2], expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("area", [None, 0.01])
def test_what_moves_with_the_air_feels_nothing(device, area):
    cloth = sheet((4, 4), 0.1, mass=0.01, stiffness=0.0).rotate(0.4, axis=(1, 2, 0))
    cloth = cloth.with_velocity((3.0, 1.0, -2.0))
    how = {"gravity": 0.0, "device": device, "precision": "float64", "substeps": 5}
    simulation = Simulation(cloth, loads=[Wind((3.0, 1.0, -2.0), area=area)], **how)
    simulation.step(2)
    if area is None:  # the mean of three velocities is not quite each of them: (a + a + a) / 3
        np.testing.assert_allclose(simulation.frame().velocity, cloth.velocity, rtol=0, atol=1e-14)
    else:
        np.testing.assert_array_equal(simulation.frame().velocity, cloth.velocity)


@wp.func
def vortex(x: Any, t: Any):
    return type(x)(-x[1], x[0], type(t)(0.0))


def test_a_wind_of_place_pushes_by_the_air_where_things_are(plain_device):
    # From rest F = ½ ρ C_d A |w| w on a particle, and ½ ρ C_d |w·a| w on a triangle, with w at its centre.
    cloth = sheet((3, 4), 0.1, mass=0.01, stiffness=0.0).rotate(1.0, axis=(1, 2, 0)).translate((0.5, 0.2, 0))
    row = chain(3, 0.3, mass=0.01, stiffness=0.0).translate((0, 0.4, 0))
    x, corner = np.concatenate([cloth.position, row.position]), facets_of(cloth).corner
    a = 0.5 * np.cross(x[corner[:, 1]] - x[corner[:, 0]], x[corner[:, 2]] - x[corner[:, 0]])
    w, centre = (np.stack([-p[:, 1], p[:, 0], 0 * p[:, 0]], axis=1) for p in (x, x[corner].mean(axis=1)))
    force = 0.05 * np.linalg.norm(w, axis=1, keepdims=True) * w
    force[: len(cloth.position)] = 0.0
    for k in range(3):
        np.add.at(force, corner[:, k], np.abs((centre * a).sum(axis=1, keepdims=True)) * centre / 3)
    loads = [Wind(vortex, on="cloth", drag=DRAG, lift=0.0), Wind(vortex, on="row", drag=DRAG, area=0.05)]
    how = {"gravity": 0.0, "device": plain_device, "precision": "float64", "fps": 1e6, "substeps": 1}
    simulation = Simulation(cloth.named("cloth") + row.named("row"), loads=loads, **how)
    simulation.step()
    # Places of 1 m are rounded, of triangles of 0.1 m: to some 1e-15 of 0.1 m of their sides.
    np.testing.assert_allclose(
        simulation.frame().velocity, 0.5 * RHO * DRAG * force / 0.01 * 1e-6, rtol=1e-13, atol=1e-20
    )


@wp.func
def gust_of_place(x: Any, t: Any):
    return type(x)(wp.where(t > type(t)(0.5), type(t)(60.0), type(t)(0.0)), type(t)(0.0), type(t)(0.0))


GUSTS = [lambda t: (60.0 if t > 0.5 else 0.0, 0, 0), gust_of_place]


def in_wind(velocity, device, **how):
    """Return the simulation of a light particle: its drag alone limits the step."""
    body = System(position=np.zeros((1, 3)), mass=1e-4)
    return Simulation(body, loads=[Wind(velocity, area=0.01)], gravity=0.0, device=device, **how)


@pytest.mark.slow
@pytest.mark.parametrize("gust", GUSTS, ids=["of time", "of place"])
def test_the_step_is_stable_in_a_gust_to_come(plain_device, gust):
    steady, gusty = (in_wind(velocity, plain_device) for velocity in ((60.0, 0, 0), gust))
    assert gusty.substeps == steady.substeps > 20 * in_wind((0.0, 0, 0), plain_device).substeps
    gusty.step(45)
    assert gusty.substeps == steady.substeps  # no frame grew, and none was repeated
    assert 0 < gusty.frame().velocity[0, 0] < 60.0


def test_a_gust_that_the_bound_did_not_know_doubles_the_stable_substeps(plain_device):
    steady = in_wind((60.0, 0, 0), plain_device).substeps
    gusty = in_wind(lambda t: (60.0 if t > 1.5 else 0.0, 0, 0), plain_device)
    assert gusty.substeps < 0.1 * steady
    gusty.step(95)
    # In the frame of the gust alone: twice what is stable then, once or twice.
    assert steady <= max(count for _, count in gusty.substep_history) <= 4 * steady


def test_a_changed_scene_is_bounded_by_the_wind_of_its_time(plain_device):
    # Past the second after the start that the first bound looks at.
    late = in_wind(lambda t: (60.0 if t > 1.5 else 0.0, 0, 0), plain_device, substeps=300)
    late.step(120)
    with pytest.raises(UnstableStep, match="substeps is 300"):
        late.change(mass=0.9e-4)


def test_lift_is_across_the_flow(plain_device):
    # At 45° to the flow a plate feels ½ρ C_l A u² sin 45° cos 45° across it, and ½ρ C_d A u² sin 45° along it.
    plate = falling_sheet().rotate(-0.25 * math.pi, axis=(0, 1, 0), about=(0, 0, 0))
    how = {"gravity": 0.0, "device": plain_device, "precision": "float64", "fps": 1e6, "substeps": 1}
    wind = Wind((4.0, 0, 0), drag=DRAG, lift=0.8)
    simulation = Simulation(plate, loads=[wind], **how)
    simulation.step()
    force = simulation.measure().momentum / 1e-6
    half = 0.5 * RHO * 0.36 * 16
    expected = [DRAG * half * math.sqrt(0.5), 0.0, 0.8 * half * 0.5]
    assert abs(force[2]) == pytest.approx(expected[2], rel=1e-6)
    assert force[0] == pytest.approx(expected[0], rel=1e-6)
    assert abs(force[1]) < 1e-9


@wp.func
def gale(x: Any, t: Any):
    return type(x)(type(t)(50.0), type(t)(0.0), type(t)(0.0))


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(50.0, 0, 0), gale])
def test_the_bound_knows_the_resistance(plain_device, velocity):
    # ∂F/∂v = ρ C_d A |u| on a particle; the bound of the rate may be twice that over its mass.
    body = System(position=np.zeros((1, 3)), mass=0.02)
    system_rates = Simulation(body, loads=[Wind(velocity, drag=DRAG, lift=0.0, area=0.05)], device=plain_device)
    rate = rate_bounds(system_rates.system, system_rates.assembly, system_rates.state).damping
    steepest = RHO * DRAG * 0.05 * 50 / 0.02
    assert steepest <= rate * (1 + 4 * EPS64) <= 2 * steepest * (1 + 1e-12)
    assert stability_limit(body, SymplecticEuler()) == math.inf  # without wind nothing limits it
    system_rates.step(60)
    assert np.abs(system_rates.frame().velocity[0, 0]) < 50


@pytest.mark.parametrize(
    ("system", "load", "message"),
    [
        (chain(3), lambda: Wind((1.0, 0, 0)), r"loads\[0\]\.area is None; it must be the area of each particle"),
        (chain(3), lambda: Wind((1.0, 0), area=1.0), r"loads\[0\]\.velocity has 2 numbers; it must have 3"),
        (sheet((3, 3)), lambda: Wind((1.0, 0, 0), on=[0, 1]), r"loads\[0\]\.area is None"),
    ],
)
def test_wind_is_refused_by_name(system, load, message):
    with pytest.raises(ValueError, match=message):
        Simulation(system, loads=[load()], device="cpu")


def test_two_winds_blow_on_two_bodies(plain_device):
    both = sheet((3, 3), 0.1, mass=0.01).named("a") + sheet((3, 3), 0.1, mass=0.01).translate((5, 0, 0)).named("b")
    loads = [Wind((0, 0, 3.0), on="a"), Wind((0, 0, -3.0), on="b")]
    simulation = Simulation(both, loads=loads, gravity=0.0, device=plain_device, precision="float64", substeps=10)
    simulation.step(10)
    v = simulation.frame().velocity[:, 2]
    # The other one lies 5 m off, where places are rounded to 9e-16 m, k/m times which is 9e-12 m/s², 10 times.
    np.testing.assert_allclose(v[:9], -v[9:], rtol=0, atol=1e-11)
    assert v[:9].min() > 0.1
