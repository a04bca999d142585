"""Bars of a material: they stretch, bend, ring and hang as the textbook says, and err as stated."""

import itertools
import math

import numpy as np
import pytest
from elasticity import SOLID, displacement, rigid_motions, stiffness_matrix

from msdwarp import Leapfrog, Material, Simulation, System, box, sheet


@pytest.mark.parametrize("across", [1, 2, 3])
def test_a_bar_of_any_width_stretches_exactly(across):
    # Pulled at both ends by forces that are spread as the mass is.
    system = box((7, across + 1, across + 1), 0.1, material=SOLID)
    x = system.position
    force = np.zeros(x.shape)
    for side in (-1, 1):
        end = np.isclose(x[:, 0], side * 0.3)
        force[end, 0] = side * system.mass[end] / system.mass[end].sum()
    u = displacement(system, force, rigid_motions(x, system.mass))
    strain = 1 / (SOLID.youngs_modulus * (0.1 * across) ** 2)
    expected = strain * x * np.array([1, -1 / 4, -1 / 4])
    # A linear system of condition about 1e4.
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-10 * 0.3 * strain)


def bar(dim: int, cells: int, ratio: int) -> System:
    """Return a bar along x of so many cells in height, 1 m high and wide (or thick) and `ratio` times as long."""
    a = 1 / cells
    if dim == 2:
        return sheet((ratio * cells + 1, cells + 1), a, material=SOLID, thickness=1.0, dim=2)
    return box((ratio * cells + 1, cells + 1, cells + 1), a, material=SOLID)


@pytest.mark.parametrize(("dim", "cells"), [(2, 1), (2, 2), (2, 3), (2, 8), (3, 1), (3, 2), (3, 3)])
def test_a_bar_resists_bending_as_stated(dim, cells):
    # Moments at both ends; the curvature is that of the middle, a height from either end of what is measured.
    system, ratio = bar(dim, cells, 6), 6
    x, z = system.position, system.position[:, -1]
    force = np.zeros(x.shape)
    for side in (-1, 1):
        end = np.isclose(x[:, 0], side * ratio / 2)
        force[end, 0] = side * (system.mass * z)[end] / (system.mass * z**2)[end].sum()
    u = displacement(system, force, rigid_motions(x, system.mass))

    def turn(where: float) -> float:
        section = np.isclose(x[:, 0], where)
        moment = system.mass[section] * z[section]
        return (moment @ u[section, 0]) / (moment @ z[section])

    curvature = turn(1.0) - turn(-1.0)
    excess = 2 / (curvature * SOLID.youngs_modulus / 12) - 1
    if dim == 2:
        # What the ends disturb has died away to 1e-6 two heights on.
        assert excess * cells**2 == pytest.approx(5 / 4, rel=1e-5)
    else:
        assert 1 < excess * cells**2 < 11 / 10


def longitudinal_mode(system: System) -> tuple[float, np.ndarray]:
    """Return the frequency [rad/s] and the shape of the mode nearest to that of a free bar along z."""
    x = system.position
    root = np.sqrt(np.repeat(system.mass, 3))
    squares, shapes = np.linalg.eigh(stiffness_matrix(system).toarray() / np.outer(root, root))
    wanted = np.zeros(x.shape)
    wanted[:, 2] = np.sin(np.pi * x[:, 2] / np.ptp(x[:, 2]))
    k = int(np.argmax(np.abs((wanted.ravel() * root) @ shapes)))
    return math.sqrt(squares[k]), (shapes[:, k] / root).reshape(x.shape)


def settled(system: System, device: str, material: Material) -> np.ndarray:
    """Return where a body of material hangs after a hundred times the time that waves take through it."""
    length = np.ptp(system.position[:, 2])
    duration = 20 * length / material.wave_speed
    sim = Simulation(system, gravity=9.82, device=device, precision="float64", fps=20 / duration)
    *_, last = sim.frames(duration)
    return last.position


@pytest.mark.slow
def test_a_simulated_bar_hangs_as_the_textbook_says(device):
    material = Material(1000.0, 1e9, 1.0)
    system = box((2, 2, 9), 1 / 8, material=material)
    z = system.position[:, 2]
    top, bottom = z == z.max(), z == z.min()
    x = settled(system.pin(top), device, material)
    stretch = -np.mean(x[bottom, 2] - z[bottom])
    expected = 1000.0 * 9.82 / (2 * 1e9)
    # Pinned particles keep it from contracting at its top: over about its width of ⅛ it stretches by less.
    assert stretch == pytest.approx(expected, rel=0.02)
    force, conditions = np.zeros(x.shape), []
    force[:, 2] = -9.82 * system.mass
    for p, k in itertools.product(np.flatnonzero(top), range(3)):
        condition = np.zeros(x.shape)
        condition[p, k] = 1.0
        conditions.append(condition)
    static = -displacement(system, force, conditions)[bottom, 2].mean()
    assert stretch == pytest.approx(static, rel=1e-5)  # it is strained by 1e-5, and has settled to 1.5e-7


def test_a_simulated_bar_rings_and_fades_as_the_textbook_says(device):
    material = Material(1000.0, 1e6, 0.05)
    a, cells = 1 / 12, 12
    system = box((2, 2, cells + 1), a, material=material)
    omega, shape = longitudinal_mode(system)
    start = 1e-5 * shape / np.abs(shape).max()  # a strain of 1e-5, of which nothing is seen but the linear part
    sim = Simulation(
        system.with_velocity(omega * start),
        integrator=Leapfrog(),
        gravity=0.0,
        device=device,
        precision="float64",
        fps=1000,
        safety=0.2,
    )
    # Three periods of 63 ms, seen in the shape of the mode alone.
    q = [float((system.mass[:, None] * shape * (f.position - system.position)).sum()) for f in sim.frames(0.19)]
    # Samples of a damped oscillation follow q'' = a q' + b q, with the two roots exp((−ζω ± iω') Δt).
    (first, second), *_ = np.linalg.lstsq(np.stack([q[1:-1], q[:-2]], axis=1), np.array(q[2:]), rcond=None)
    root = np.log(np.roots([1, -first, -second]).astype(complex)[0]) * 1000
    textbook = np.pi * material.wave_speed  # L = 1
    # 5 substeps a frame are h = 0.2 ms; where a damper acts leapfrog errs by ω h ζ/2 = 5e-4.
    assert abs(root) == pytest.approx(omega, rel=1e-3)
    # The bar is slow by 0.29 % (see above), and ζ is in proportion to the frequency.
    assert abs(root) == pytest.approx(textbook, rel=4e-3)
    assert -root.real / abs(root) == pytest.approx(0.05, rel=4e-3)
