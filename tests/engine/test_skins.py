"""Wind and pressure on skins: surfaces whose vertices are mixtures of particles; and on any closed one."""

import math

import numpy as np
import pytest
from surfaces import area_vectors, triangles_of, volume

from msdwarp import (
    RK4,
    EnclosedGas,
    Pressure,
    Simulation,
    Wind,
    ball,
    box,
    cone,
    cylinder,
    sheet,
)
from msdwarp.bodies import facets_of
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds

RHO, G = 1.225, 9.82
BODIES = {
    "ball": lambda **how: ball(0.5, 0.25, mass=0.01, stiffness=300.0, **how),
    "cylinder": lambda **how: cylinder(0.3, 0.8, 0.2, mass=0.01, stiffness=300.0, **how),
    "cone": lambda **how: cone(0.4, 0.8, 0.2, mass=0.01, stiffness=300.0, **how),
}


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "device": device, **more}


def forces(system, loads, device) -> np.ndarray:
    """Return the force on each particle [N]: what it gets in a substep of a microsecond.

    A velocity of 1 m/s is rounded to 2e-16: over a microsecond, of 0.1 kg, to 1e-11 N.
    """
    simulation = Simulation(system, loads=loads, **options(device, fps=1e6, substeps=1))
    simulation.step()
    return 1e6 * system.mass[:, None] * (simulation.frame().velocity - system.velocity)


@pytest.mark.parametrize("name", BODIES)
def test_facets_are_what_is_drawn(name):
    system = BODIES[name]()
    facets = facets_of(system)
    assert facets.mixed
    assert facets.closed.all()
    # Of what is drawn but for triangles without an area, vertex by vertex the same mixtures.
    drawn = triangles_of(system)
    drawn = drawn[np.linalg.norm(area_vectors(system), axis=1) > 0]
    np.testing.assert_allclose(facets.points(system.position)[facets.corner], drawn, rtol=0, atol=1e-15)
    half = facets.of(system.position[:, 2] > 0)
    assert 0 < len(half.corner) < len(facets.corner)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ball", "box"])
def test_pressure_moves_no_closed_body(device, name):
    # Σ a = 0 and Σ x × a = 0 over a closed surface, and weights reproduce places: momenta stay, but for rounding
    # of forces of up to 10 N that sum to nothing, for 0.1 s.
    block = box((4, 4, 4), 0.1, mass=0.01, stiffness=200.0, damping=0.1)
    body = (block if name == "box" else BODIES[name](damping=0.1)).rotate(0.3, axis=(1, 2, 3))
    loads = [Pressure(lambda t: 50 * np.sin(30 * t)), EnclosedGas(100.0)]
    simulation = Simulation(body, loads=loads, **options(device, fps=600.0))
    simulation.step(60)
    measures = simulation.measure()
    assert abs(measures.external_work) > 1e-5
    assert np.abs(measures.momentum).max() < 1e-13
    assert np.abs(measures.angular_momentum).max() < 1e-13


@pytest.mark.parametrize("name", BODIES)
def test_the_force_of_wind_is_the_sum_over_facets(device, name):
    system = BODIES[name]().with_velocity((0.5, -1.0, 0.2))
    air, drag, lift = np.array([4.0, 1.0, -2.0]), 0.8, 0.3
    found = forces(system, [Wind(air, drag=drag, lift=lift)], device)
    a, u = area_vectors(system), np.array([0.5, -1.0, 0.2]) - air
    through, speed, area = a @ u, np.linalg.norm(u), np.linalg.norm(a, axis=1)
    windward = (through > 0) & (area > 0)
    a, through, n = a[windward], through[windward, None], a[windward] / area[windward, None]
    each = -0.5 * RHO * (drag * through * u + lift * through * (speed * n - (n @ u)[:, None] * u / speed))
    # Of some hundred particles that are rounded as `forces` says.
    np.testing.assert_allclose(found.sum(axis=0), each.sum(axis=0), rtol=0, atol=1e-9)
    # And their torque: a force at the centre of its triangle is what its mixtures of particles get.
    torque = np.cross(triangles_of(system)[windward].mean(axis=1), each).sum(axis=0)
    np.testing.assert_allclose(np.cross(system.position, found).sum(axis=0), torque, rtol=0, atol=1e-9)


def test_wind_sees_how_a_skin_turns(device):
    # Around its axis a cylinder turns with no drag to speak of but at its rough edge: a turn about another one is
    # slowed, as its triangles go through the air that rests, by their own speeds.
    system = BODIES["cylinder"]()
    rate = np.array([3.0, 0.0, 0.0])
    spinning = system.with_velocity(np.cross(rate, system.position))
    found = forces(spinning, [Wind((0, 0, 0), drag=1.0, lift=0.0)], device)
    centre, a = triangles_of(system).mean(axis=1), area_vectors(system)
    u = np.cross(rate, centre)
    through = np.maximum((u * a).sum(axis=1), 0.0)
    each = -0.5 * RHO * through[:, None] * u
    torque = np.cross(centre, each).sum(axis=0)
    assert torque[0] < -0.01
    np.testing.assert_allclose(np.cross(system.position, found).sum(axis=0), torque, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("exponent", "gas"),
    [
        pytest.param(None, False, marks=pytest.mark.slow),
        pytest.param(1.0, True, marks=pytest.mark.slow),
        (1.4, True),
    ],
    ids=["given", "1", "1.4"],
)
def test_the_work_of_pressure_is_p_dv(device, exponent, gas):
    # p ΔV; p V ln(V'/V); p V (1 − (V/V')^(γ−1))/(γ − 1). RK4, with hω of 0.1: some (hω)⁵ of what
    # swings, seen 1e-7.
    body, pressure = BODIES["ball"](damping=1.0), 400.0
    load = EnclosedGas(pressure, outside=0.0, exponent=exponent) if gas else Pressure(pressure)
    simulation = Simulation(body, loads=[load], integrator=RK4(), **options(device, fps=600.0, substeps=6))
    simulation.step(20)
    before, after = volume(body), volume(simulation.snapshot())
    assert after > 1.01 * before
    expected = {
        None: pressure * (after - before),
        1.0: pressure * before * math.log(after / before),
        1.4: pressure * before * (1 - (before / after) ** 0.4) / 0.4,
    }[exponent]
    found = simulation.measure()
    assert found.external_work == pytest.approx(expected, rel=1e-6)


def test_of_a_closed_body_and_an_open_one_each_feels_its_own(device):
    # One system and one wind: the lid of a box feels the wind once, on top; a sheet of its size feels it as much.
    block = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0)
    both = block + sheet((3, 3), 0.1, mass=0.01).translate((2, 0, 0))
    found = forces(both, [Wind((0.0, 0.0, -4.0), drag=1.1, lift=0.0)], device)
    expected = -0.5 * RHO * 1.1 * 0.04 * 16
    for mine in (slice(0, 27), slice(27, None)):
        np.testing.assert_allclose(found[mine].sum(axis=0), [0, 0, expected], rtol=0, atol=1e-10)
    floor = np.flatnonzero(np.isclose(block.position[:, 2], block.position[:, 2].min()))
    np.testing.assert_allclose(found[floor], 0.0, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_the_bound_knows_a_skin_of_gas(plain_device):
    # A gas of stiffness γ p / V for its volume: the rate of Σ |∂V/∂x|²/m, by differences of the volume.
    system, outside = BODIES["cylinder"](), 1e6
    simulation = Simulation(system, loads=[EnclosedGas(0.0, outside=outside)], **options(plain_device))
    rate = rate_bounds(simulation.system, simulation.assembly, simulation.state).effect_stiffness
    surface, slope, before = system.surface, np.zeros(system.position.shape), volume(system)
    for i, k in np.ndindex(*slope.shape):
        moved = system.position.copy()
        moved[i, k] += 1e-4
        after = np.linalg.det(surface.points(moved)[surface.triangles]).sum() / 6
        slope[i, k] = (after - before) / 1e-4
    exact = outside / volume(system) * float(((slope**2).sum(axis=1) / system.mass).sum())
    assert exact * (1 - 1e-3) < rate < 1.01 * exact  # a step of 1e-4 of 0.2 m
    simulation.step(2)  # some hundred substeps: where one is too long, what is rounded grows in each
    assert simulation.measure().kinetic_energy < 1e-9


def test_what_has_no_surface_there_is_refused():
    body = BODIES["ball"]()
    inside = np.argsort(np.linalg.norm(body.position, axis=1))[:3]
    with pytest.raises(ValueError, match=r"loads\[0\]\.on is .*; it must hold the corners of a surface in space"):
        Simulation(body, loads=[Pressure(1.0, on=inside)], device="cpu")
    with pytest.raises(ValueError, match=r"loads\[0\]\.area is None"):
        Simulation(body, loads=[Wind((1.0, 0, 0), on=inside)], device="cpu")
    with pytest.raises(ValueError, match="the surface there must be closed"):
        Simulation(body, loads=[EnclosedGas(1.0, on=body.position[:, 2] > 0)], device="cpu")
