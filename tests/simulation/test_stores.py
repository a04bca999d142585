"""Bodies at rest whose only energy is in one thing: angles, cells, gas, attachments, obstacles, contact."""

import math

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.world import volume

FREQUENCY = 5.0
OMEGA = 2 * math.pi * FREQUENCY
MASS, SIZE = 0.1, 0.1
CUBE = SIZE * np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float
)
STIFFNESS = MASS * OMEGA**2


def loose(position, **more) -> msd.System:
    """Return particles without springs."""
    nothing = np.zeros(0)
    return msd.System(
        position=position, mass=MASS, connections=nothing.reshape(0, 2), stiffness=nothing, damping=nothing, **more
    )


def rod() -> msd.System:
    """Return three particles of which the angle swings: θ'' = −6 K θ/(m l²), as θ = (u_a − 2 u_b + u_c)/l."""
    line = msd.chain(3, SIZE, mass=MASS, stiffness=STIFFNESS, damping=0.0)
    return line.replace(angles=msd.Angles(particles=[(0, 1, 2)], stiffness=STIFFNESS * SIZE**2 / 6))


def cell() -> msd.System:
    """Return a cube whose volume swings: ω² = κ/V₀ Σ |∂V/∂x|²/m, and |∂V/∂x| = √3 s²/4 at each of 8 corners."""
    modulus = STIFFNESS / (8 * 3 / 16 * SIZE)
    return loose(CUBE, cells=msd.Cells(corners=np.arange(8)[None], rest_volume=SIZE**3, modulus=modulus))


def balloon() -> tuple[msd.System, float]:
    """Return a shell without springs, and the pressure with which its volume swings: ω² = p/V Σ |∂V/∂x|²/m."""
    skin = msd.shell(msd.icosphere(SIZE, 1), total_mass=MASS * 42, stiffness=0.0, damping=0.0)
    corner = skin.surface.particle[skin.surface.triangles]
    return skin, STIFFNESS * volume(corner, skin.position) / (gradient(skin) ** 2).sum()


def gradient(skin: msd.System) -> np.ndarray:
    """Return the derivatives of the volume in a closed surface by the places of its particles [m²]."""
    found, (a, b, c) = np.zeros_like(skin.position), skin.surface.particle[skin.surface.triangles].T
    x = skin.position - skin.position.mean(axis=0)
    for one, two, three in ((a, b, c), (b, c, a), (c, a, b)):
        np.add.at(found, one, np.cross(x[two], x[three]) / 6)
    return found


NAMES = ["angles", "cells", "gas", "actuators", "attachments", "soft obstacles", "stiff"]


def scene(store: str, amplitude: float) -> tuple[msd.System, np.ndarray, dict]:
    """Return bodies of which one is displaced from its equilibrium, this equilibrium, and loads and obstacles."""
    skin, pressure = balloon()
    stiff = msd.chain(
        2, SIZE, mass=MASS, stiffness=50 * STIFFNESS, damping=0.0
    )  # sets a step for which ω h is small
    muscle = msd.chain(2, SIZE, mass=MASS, stiffness=STIFFNESS / 2, damping=0.0)
    bodies = [rod(), cell(), skin, muscle, loose([[0.0, 0, 0]]), loose([[0.0, 0, 0]]), stiff]
    high = [0.0 if name == "soft obstacles" else 0.5 for name in NAMES]
    placed = [one.translate((0.5 * k - 1.5, 0, high[k])).named(NAMES[k]) for k, one in enumerate(bodies)]
    system = sum(placed[1:], placed[0])
    of = {name: system.groups[name] for name in NAMES}
    shape = {
        "angles": np.outer((1.0, -2.0, 1.0), (0, 0, 1)),
        "cells": 2 * CUBE / SIZE - 1,
        "gas": gradient(skin) / np.abs(gradient(skin)).max(),
        "attachments": np.array([[1.0, 0, 0]]),
        "soft obstacles": np.array([[0, 0, -1.0]]),
        "actuators": np.outer((1.0, -1.0), (1.0, 0, 0)) / 2,
    }[store]
    rest = system.position[of[store]]
    loads = [
        msd.EnclosedGas(0.0, on=of["gas"], outside=pressure, volume=volume(skin.surface.triangles, skin.position)),
        msd.Attachment(to=system.position[of["attachments"]][0], stiffness=STIFFNESS, on=of["attachments"]),
        msd.Actuator(-amplitude / SIZE if store == "actuators" else 0.0, on=of["actuators"]),
    ]
    if store == "actuators":
        rest = rest + amplitude * shape
    else:
        position = system.position.copy()
        position[of[store]] += amplitude * shape
        system = system.replace(position=position)
    floor = msd.Plane((0, 0, 1), stiffness=STIFFNESS, ramp=1e-7)
    return system, rest, {"loads": loads, "colliders": [floor], "gravity": 0.0}


@pytest.mark.parametrize("store", NAMES[:-1])
@pytest.mark.parametrize("amplitude", [1e-5, 1e-3])
def test_what_is_stored_swings_at_its_frequency_with_unchanged_substeps(store, amplitude):
    system, rest, around = scene(store, amplitude)
    simulation = msd.Simulation(system, integrator=msd.Leapfrog(), device="cpu", **around)
    substeps, mine = simulation.substeps, system.groups[store]
    start, angle = system.position[mine] - rest, OMEGA / simulation.fps * np.arange(25)
    found = [1.0]
    for _ in angle[1:]:
        simulation.step()
        now = simulation.frame().position[mine] - rest
        found.append(float((now * start).sum() / (start**2).sum()))
    assert simulation.substeps == substeps
    expected = np.cos(angle)
    if store == "soft obstacles":  # it lets go where it is straight
        expected = np.where(angle < math.pi / 2, expected, math.pi / 2 - angle)
    # Nonlinear terms: 3 % of volume at most. Rounding: float32 has 6e-8 m at 1.5 m, 1e-2 of the smaller amplitude.
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=0.05)


@pytest.mark.parametrize("store", NAMES[:-1])
def test_worlds_go_on_with_what_they_store(store):
    system, _, around = scene(store, 1e-5)
    how = {"integrator": msd.SymplecticEuler(), "precision": "float64", "device": "cpu"}
    ensemble = msd.Ensemble(system, worlds=2, **how, **around)
    ensemble.step(30)
    assert set(ensemble.status) == {"running"}


def test_energy_of_attachments_that_grows_is_found():
    # Steps of 1.1 times the limit 2/ω: (hω)² is 4.84, and amplitudes grow by 2.4 in each substep.
    how = {"loads": [msd.Attachment(to=(1e-5, 0, 0), stiffness=STIFFNESS)], "gravity": 0.0, "precision": "float64"}
    how |= {"fps": OMEGA / 2.2, "substeps": 1, "allow_unstable": True, "device": "cpu"}
    with pytest.raises(msd.SimulationDiverged):
        msd.Simulation(loose([[0.0, 0, 0]]), **how).step(10)
    ensemble = msd.Ensemble(loose([[0.0, 0, 0]]), worlds=2, **how)
    ensemble.step(10)
    assert set(ensemble.status) == {"energy"}


@pytest.mark.parametrize("depth", [1e-5, 5e-4])
def test_ropes_that_are_pressed_together_part_with_what_they_store_and_unchanged_substeps(depth):
    rope = msd.chain(2, SIZE, mass=MASS, stiffness=50 * STIFFNESS, damping=0.0).translate((-SIZE / 2, 0, 0))
    across = rope.rotate(math.pi / 2, about=(0, 0, 0)).translate((0, 0, SIZE / 2 - depth))
    contact = msd.Contact(thickness=SIZE / 2, stiffness=STIFFNESS, restitution=1.0, friction=0.0)
    how = {"contact": contact, "gravity": 0.0, "precision": "float64", "device": "cpu"}
    simulation = msd.Simulation(rope + across, integrator=msd.Leapfrog(), **how)
    substeps, stored = simulation.substeps, simulation.measure().effect_energy
    simulation.step(30)
    assert simulation.substeps == substeps
    # They have parted. The substep in which they do so adds or takes (hω)²/4 of the energy at most, for hω = 0.2.
    assert simulation.measure().effect_energy == 0.0
    assert simulation.measure().kinetic_energy == pytest.approx(stored, rel=0.01)
