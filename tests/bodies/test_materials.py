"""Materials: a lattice has the modulus, the mass and the damping that were asked for, and errs as stated."""

import itertools
import math

import numpy as np
import pytest
from elasticity import AREA, SOLID, stiffness_matrix

from msdwarp import STEEL_WIRE, Material, System, box, chain, lattice, sheet

THICKNESS = 0.02

ANGLE = np.ones((5, 4, 3), dtype=bool)
ANGLE[2:, 2:] = False  # two bars at right angles: a corner that points inwards
FRAME = np.ones((6, 5), dtype=bool)
FRAME[2, 2] = False  # a hole of four cells

BODIES = {
    "box": box((4, 3, 5), 0.1, material=SOLID),
    "cell": box((2, 2, 2), 0.1, material=SOLID),
    "angle": lattice(ANGLE, 0.1, material=SOLID),
    "sheet": sheet((4, 3), 0.1, material=SOLID, thickness=THICKNESS, dim=2),
    "frame": lattice(FRAME, 0.1, material=SOLID, thickness=THICKNESS, dim=2),
    "box of 6": box((4, 3, 5), 0.1, neighbors=6, material=SOLID),
    "sheet of 4": sheet((4, 3), 0.1, neighbors=4, material=SOLID, thickness=THICKNESS, dim=2),
    "chain": chain(4, 0.1, material=SOLID, area=AREA, dim=1),
}
VOLUMES = {
    "box": 3 * 2 * 4 * 0.1**3,
    "cell": 0.1**3,
    "angle": (4 * 3 - 3 * 2) * 2 * 0.1**3,
    "sheet": 3 * 2 * 0.1**2 * THICKNESS,
    "frame": (5 * 4 - 4) * 0.1**2 * THICKNESS,
    "box of 6": 3 * 2 * 4 * 0.1**3,
    "sheet of 4": 3 * 2 * 0.1**2 * THICKNESS,
    "chain": 0.3 * AREA,
}


def energy(system: System, strain: np.ndarray) -> float:
    """Return the energy of a homogeneous strain [J], by the stiffness matrix."""
    u = (system.position @ strain).ravel()
    return float(u @ (stiffness_matrix(system) @ u)) / 2


def expected_energy(name: str, strain: np.ndarray) -> float:
    """Return ½ V ε:C:ε of the elastic body that a lattice stands for."""
    e, volume = SOLID.youngs_modulus, VOLUMES[name]
    square, trace = (strain**2).sum(), np.trace(strain)
    if name in ("box", "cell", "angle"):  # ν = 1/4: λ = μ = 2/5 E
        density = 0.4 * e * (trace**2 / 2 + square)
    elif name in ("sheet", "frame"):  # plane stress with ν = 1/3: E/(1 − ν²) ((1 − ν) ε:ε + ν (tr ε)²)/2
        density = e / (1 - 1 / 9) * (2 / 3 * square + 1 / 3 * trace**2) / 2
    else:  # springs along the axes alone
        density = e * (np.diag(strain) ** 2).sum() / 2
    return volume * density


@pytest.mark.parametrize("name", BODIES)
def test_the_energy_of_homogeneous_strain_is_that_of_the_elastic_body(name):
    system = BODIES[name]
    dim = system.dim
    random = np.random.default_rng(3).normal(size=(dim, dim))
    unit = np.eye(dim)
    simple = [np.outer(unit[k], unit[m]) for k, m in itertools.combinations_with_replacement(range(dim), 2)]
    for strain in (*simple, random):
        strain = (strain + strain.T) / 2
        # A few hundred terms, all positive, of relative error ε.
        found = energy(system, 1e-3 * strain)
        scale = 1e-6 * SOLID.youngs_modulus * VOLUMES[name]
        assert found == pytest.approx(expected_energy(name, 1e-3 * strain), rel=1e-12, abs=1e-13 * scale)


def test_long_waves_are_as_slow_as_stated():
    # From the connections of the particle in the middle: D(q) u = ω² m u for a wave of wave number q.
    a, s = 0.1, 1 / 4
    system = box((3, 3, 3), a, material=SOLID)
    mine = (system.connections == 13).any(axis=1)
    ends = system.connections[mine]
    apart = system.position[ends[:, 0]] - system.position[ends[:, 1]]
    axis = apart / np.linalg.norm(apart, axis=1)[:, None]
    speed = math.sqrt(1.2 * SOLID.youngs_modulus / SOLID.density)  # λ + 2 μ = 6/5 E
    for direction, factor in (((1, 0, 0), 1), ((1, 1, 0), 3 / 2), ((1, 1, 1), (11 + 10 * s) / 9)):
        n = np.array(direction) / np.linalg.norm(direction)
        q = 0.1 / a
        weight = system.stiffness[mine] * (1 - np.cos(q * apart @ n))
        omega = math.sqrt(n @ (axis.T * weight @ axis) @ n / system.mass[13])
        # The next term is about (q a)²/80 times as large.
        assert (1 - omega / (speed * q)) * 24 / (q * a) ** 2 == pytest.approx(factor, rel=1e-3)


@pytest.mark.parametrize("name", BODIES)
def test_mass_is_density_times_volume(name):
    assert BODIES[name].mass.sum() == pytest.approx(SOLID.density * VOLUMES[name], rel=1e-14)


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_damping_is_that_of_the_slowest_mode_at_any_resolution(spacing):
    material = Material(900.0, 2e5, 0.03)
    system = box((round(0.3 / spacing) + 1, 3, 3), spacing, material=material)
    omega = np.pi * material.wave_speed / 0.3
    np.testing.assert_allclose(system.damping, 2 * 0.03 / omega * system.stiffness, rtol=1e-14)


def test_steel_carries_sound_as_fast_as_it_does():
    # 5100 m/s in a thin bar (Irvine, Damping Properties of Materials, table 2), to two figures.
    assert STEEL_WIRE.wave_speed == pytest.approx(5100, rel=0.02)


def test_bad_materials_are_named():
    with pytest.raises(ValueError, match="density is 0; it must be a number above 0"):
        Material(0.0, 1e6)
    with pytest.raises(ValueError, match="youngs_modulus is inf"):
        Material(1000.0, math.inf)
    with pytest.raises(ValueError, match=r"damping_ratio is -0\.1"):
        Material(1000.0, 1e6, -0.1)


SPIKE = np.zeros((4, 3, 3), dtype=bool)
SPIKE[:2], SPIKE[2, 1, 2] = True, True
APART = np.kron(np.eye(2), np.ones((2, 2))).astype(bool)  # two cells that only a diagonal joins, in no cell


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: box((2, 2, 2), material="rubber"), "material is 'rubber'; it must be a Material"),
        (lambda: box((2, 2, 2), material=SOLID, mass=1.0), r"mass is 1\.0; with a material"),
        (lambda: box((2, 2, 2), material=SOLID, stiffness=1.0), r"stiffness is 1\.0; with a material"),
        (lambda: box((2, 2, 2), material=SOLID, damping=0.0), r"damping is 0\.0; with a material"),
        (lambda: sheet((2, 2), material=SOLID), "thickness is None; with a material it must be"),
        (lambda: sheet((2, 2), thickness=0.1), r"thickness is 0\.1; without a material"),
        (lambda: sheet((2, 2), material=SOLID, thickness=-1), "thickness is -1"),
        (lambda: chain(2, material=SOLID), "area is None"),
        (lambda: chain(2, area=0.1), r"area is 0\.1; without a material"),
        (lambda: lattice(FRAME, material=SOLID), "thickness is None"),
        (lambda: lattice(ANGLE, material=SOLID, thickness=1.0), r"thickness is 1\.0; for a solid body"),
        (lambda: lattice(SPIKE, material=SOLID), r"mask\[2, 1, 2\] is True, but it is a corner of no whole cell"),
        (lambda: lattice(APART, material=SOLID, thickness=0.1), "mask is 2 pieces that no connection joins"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
