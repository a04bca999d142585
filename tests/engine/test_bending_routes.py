"""Sheets that resist bending: the stencil reaches second neighbours, and algorithms move them alike."""

import math

import numpy as np
import pytest
from stencils import lattice_of
from tangles import FAR, PRECISIONS, assert_forces_are_right, every_route, moving

from msdwarp import Ensemble, Material, Simulation, System, box, lattice, sheet
from msdwarp.engine.model.lattice import NotALattice, find_lattice

CONSTANTS = {"stiffness": 300.0, "damping": 0.5, "mass": 0.1, "bending": 5.0}
NOTCHED = np.ones((7, 6), dtype=bool)
NOTCHED[5:, :2] = False
SHEETS = {
    "sheet 8": sheet((7, 6), **CONSTANTS),
    "sheet 4": sheet((5, 7), neighbors=4, **CONSTANTS),
    "three by three": sheet((3, 3), **CONSTANTS),
    "one cell wide": sheet((2, 6), **CONSTANTS),
    "notched": lattice(NOTCHED, **CONSTANTS),
    "two": sheet((5, 4), **CONSTANTS) + sheet((5, 4), **CONSTANTS).translate((0, 0, 3)),
    "beside a box": box((3, 3, 3), neighbors=6) + sheet((5, 4), **CONSTANTS).translate((0, 0, 5)),
}
every_sheet = pytest.mark.parametrize("name", SHEETS)


@every_sheet
def test_a_stencil_reads_the_connections_and_nothing_else(name):
    lattice_of(SHEETS[name])


@pytest.mark.parametrize(
    "values", [np.linspace(0.1, 0.5, 300), np.array([0.1, 0.5])], ids=["springs", "particles"]
)
def test_a_sheet_of_too_many_kinds_is_no_lattice(values):
    damping = np.random.default_rng(1).choice(values, sheet((40, 35)).connection_count)
    # Of one kind, along each axis a particle is one of the three next to either rim, or farther inside.
    assert find_lattice(sheet((40, 30), **CONSTANTS)).kind.max() + 1 == 49
    with pytest.raises(NotALattice, match="in more than 256 ways"):
        find_lattice(sheet((40, 35), **CONSTANTS | {"damping": damping}))


@pytest.mark.slow
@pytest.mark.parametrize("break_strain", [0.05, np.inf])
def test_a_stencil_of_kinds_moves_and_tears_worlds_as_scattering_does(break_strain):
    body = SHEETS["sheet 8"].pin(np.arange(42) < 7)
    body = body.replace(break_strain=np.where(body.between_neighbors, break_strain, np.inf))
    worlds, how = {"gravity": [40.0, 20.0]}, {"device": "cpu", "precision": "float64", "substeps": 40}
    found = []
    for force_algorithm in ("scatter", "stencil"):
        one = Simulation(body, gravity=40.0, force_algorithm=force_algorithm, **how)
        both = Ensemble(body, 2, **worlds, force_algorithm=force_algorithm, **how)
        one.step(20)
        both.step(20)
        found.append(np.stack([one.frame().position, *both.frame().position]))
        assert np.isfinite(one.snapshot().broken_at).any() == np.isfinite(break_strain)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-10)  # 800 substeps of positions of 5 m, rounded
    np.testing.assert_allclose(found[1][0], found[1][1], rtol=0, atol=1e-10)


@pytest.mark.slow
@every_route
@every_sheet
@pytest.mark.each_value
def test_forces_by_route(plain_device, name, force_algorithm):
    assert_forces_are_right(moving(SHEETS[name]), plain_device, "float64", force_algorithm)


@every_route
@pytest.mark.parametrize("precision", [p for p in PRECISIONS if p != "float64"])
@pytest.mark.each_value
def test_forces_by_route_in_single_precision(plain_device, precision, force_algorithm):
    system = moving(SHEETS["sheet 8"])
    far = system.translate(FAR) if precision == "float32-compensated" else system
    assert_forces_are_right(far, plain_device, precision, force_algorithm)


def rolled(system: System) -> System:
    """Return a sheet rolled along x, which unrolls."""
    x = np.array(system.position)
    radius = 0.25 * np.ptp(x[:, 0])
    x[:, 2], x[:, 0] = radius * (1 - np.cos(x[:, 0] / radius)), radius * np.sin(x[:, 0] / radius)
    return system.replace(position=x)


def test_a_sheet_unrolls_and_keeps_its_momentum(plain_device):
    system = rolled(SHEETS["sheet 8"]).with_velocity((0.1, -0.2, 0.3))
    how = {"gravity": 0.0, "substeps": 20, "precision": "float64"}
    simulation = Simulation(system, device=plain_device, force_algorithm="stencil", **how)
    reference = Simulation(system, device="cpu", force_algorithm="scatter", **how)
    ends = np.arange(42) % 7 == 6, np.arange(42) % 7 == 0

    def width(x: np.ndarray) -> float:
        return float(x[ends[0], 0].mean() - x[ends[1], 0].mean())

    for _ in range(15):
        simulation.step()
        reference.step()
    # A rounding of each of 300 substeps, of positions of about 5 m, and what a stable step makes of it: see
    # `test_routes_move_a_scene_alike`.
    np.testing.assert_allclose(
        simulation.snapshot().position, reference.snapshot().position, rtol=0, atol=1e-12 * 5
    )
    momentum = 0.1 * simulation.snapshot().velocity.sum(axis=0)
    # Forces of some 100 N, in 300 substeps, each rounded by ε.
    np.testing.assert_allclose(momentum, 4.2 * np.array([0.1, -0.2, 0.3]), rtol=0, atol=1e-11)
    # Angular momentum about the centre of mass, of none at the start: the same.
    arm = simulation.snapshot().position - simulation.snapshot().position.mean(axis=0)
    assert np.abs(0.1 * np.cross(arm, simulation.snapshot().velocity - [0.1, -0.2, 0.3]).sum(axis=0)).max() < 1e-11
    assert width(simulation.snapshot().position) > 1.2 * width(system.position)


@pytest.mark.slow
def test_a_strip_swings_about_the_sag_of_a_beam(device):
    # Let go when flat, a strip clamped at one end swings between flat and twice its sag, ρ t g L⁴/(8 D) with
    # D = E t³/12, in its lowest mode for the most part, of ω = 3.516 √(D/(ρ t L⁴)): over a period the mean is the
    # sag, but for the second mode, of 1/40 of the first and 6.27 times its frequency.
    stuff, thickness, spacing, cells = Material(density=1000.0, youngs_modulus=1e6), 0.01, 0.05, 8
    system = sheet((cells + 2, 3), spacing, neighbors=4, material=stuff, thickness=thickness, bending="material")
    column = np.arange(system.particle_count) % (cells + 2)
    length, rigidity = (cells + 0.5) * spacing, 1e6 * thickness**3 / 12
    sag = 1000.0 * thickness * 0.02 * length**4 / (8 * rigidity)
    period = 2 * math.pi / (3.516 * math.sqrt(rigidity / (1000.0 * thickness * length**4)))
    fps = 64 / period
    simulation = Simulation(system.pin(column < 2), gravity=0.02, fps=fps, device=device, precision="float64")
    end = []
    for _ in range(64):
        simulation.step()
        end.append(-simulation.snapshot().position[column == cells + 1, 2].mean())
    # 1/N² = 1.6 % of differences of second order; the period is as much off, and the mean with it by at most that.
    assert np.mean(end) == pytest.approx(sag, rel=0.04)
    assert max(end) == pytest.approx(2 * sag, rel=0.06)
    assert end[-1] < 0.1 * sag


def test_the_largest_strain_is_that_of_connections_between_neighbours(device):
    system = moving(SHEETS["two"])
    measures = Simulation(system, device=device).measure()
    strain = np.abs(system.strain)
    # Positions of up to 6 m, rounded, over lengths of half a metre and more.
    tolerance = 100 * PRECISIONS["float32"]
    assert measures.largest_strain == pytest.approx(strain[system.between_neighbors].max(), rel=tolerance)
    energy = (system.stiffness * (system.length - system.rest_length) ** 2).sum() / 2
    assert measures.elastic_energy == pytest.approx(energy, rel=tolerance)
    flat = Simulation(SHEETS["two"], device=device).measure()
    assert flat.largest_strain < 0.1  # those to second neighbours have 0.75
