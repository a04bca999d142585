"""Dampers of cells: what they make of a material's damping, and what steps they ask for."""

import math
from dataclasses import replace

import numpy as np
import problems
import pytest
import volumes

from msdwarp import RK4, SILICONE, Material, Simulation, SymplecticEuler, System, UnstableStep, box

STUFF = Material(density=1000.0, youngs_modulus=1e5, damping_ratio=0.05)


def heat(system: System, rate: np.ndarray) -> float:
    """Return the power that dampers dissipate at a homogeneous velocity gradient [W]."""
    x, v = system.position, system.position @ rate
    return -float(((volumes.forces(system, x, v) + problems.forces(system, x, v)) * v).sum())


@pytest.mark.parametrize("ratio", [0.3, 0.35, 0.4, 0.45, 0.49])
def test_a_stretched_bar_is_damped_as_asked_for_and_shear_within_3_percent(ratio):
    # A Kelvin-Voigt body with β = 2 ζ/ω₁: β E ε'² and β μ γ'² by volume. Above 1/3 cells are damped less.
    # The reference takes slopes of energies by complex steps and differences: 1e-8.
    bar = box((5, 3, 3), 0.1, material=replace(STUFF, poissons_ratio=ratio))
    time, volume = 2 * STUFF.damping_ratio * 0.4 / (np.pi * STUFF.wave_speed), 0.4 * 0.2 * 0.2
    stretched, sheared = np.diag([1.0, -ratio, -ratio]), np.outer((1.0, 0, 0), (0, 1.0, 0))
    assert heat(bar, stretched) == pytest.approx(time * STUFF.youngs_modulus * volume, rel=1e-7)
    shear = STUFF.youngs_modulus / (2 * (1 + ratio))
    assert 1 - 1e-7 < heat(bar, sheared) / (time * shear * volume) < (1.03 if ratio > 1 / 3 else 1 + 1e-7)


def in_full(body: System) -> System:
    """Return a body of SILICONE with all dampers in proportion to stiffness."""
    time = SILICONE.damping_time(np.ptp(body.position, axis=0).max())
    cells = replace(body.cells, damping=time * body.cells.modulus)
    return body.replace(damping=time * body.stiffness, cells=cells)


def test_dampers_of_almost_incompressible_cells_hardly_shorten_the_step():
    finger = box((3, 3, 41), 0.01, material=SILICONE).named("finger")
    undamped = finger.replace(cells=replace(finger.cells, damping=0.0))
    how = {"device": "cpu", "precision": "float64"}
    ours, fewest, most = (Simulation(one, **how) for one in (finger, undamped, in_full(finger)))
    assert ours.substeps <= 1.1 * fewest.substeps
    assert most.substeps > 10 * ours.substeps
    # What asks for them is told: with all dampers it is that of the cells.
    assert "by part: damping of the cells of 'finger' " in str(most.choice)
    assert "by part: cells of 'finger' " in str(ours.choice)
    message = r"by part: damping of the cells of 'finger' \d+, cells of 'finger' \d+"
    with pytest.raises(UnstableStep, match=message):
        Simulation(in_full(finger), substeps=20, **how)


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=str)
def test_a_bar_that_swings_sideways_decays_as_with_all_dampers(method):
    bar = box((9, 3, 3), 0.02, material=SILICONE)
    along = (bar.position[:, 0] - bar.position[:, 0].mean()) / np.ptp(bar.position[:, 0])
    bent = bar.with_velocity(np.outer(0.2 * (along**2 - (along**2).mean()), (0, 0, 1.0)))
    left = []
    for body in (bent, in_full(bent)):
        simulation = Simulation(body, gravity=0.0, integrator=method, device="cpu", precision="float64", fps=240.0)
        start = simulation.measure().energy
        simulation.step(120)
        left.append(math.log(start / simulation.measure().energy))
    # Bending is stretching by layers, whose damping is the same; shear adds up to 0.7 %, steps as much.
    assert left[0] > 1.5
    assert left[0] == pytest.approx(left[1], rel=0.015)
