"""Plates: sheets that resist bending, simply supported, clamped and free, against Kirchhoff's theory."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from elasticity import deflection_matrix
from numpy.polynomial import legendre
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve
from scipy.special import iv, ivp, jv, jvp

from msdwarp import Force, Material, Simulation, System, cloth, lattice, modes, sheet

SIDE, RIGIDITY, LOAD, THICKNESS = 1.0, 0.5, 0.05, 0.01
DENSITY = 2.0
"""Mass per area [kg/m²]."""
PAPER = Material(density=DENSITY / THICKNESS, youngs_modulus=RIGIDITY * 12 * (1 - 1 / 9) / THICKNESS**3)
SOLID = {"material": PAPER, "thickness": THICKNESS, "bending": "material"}
NUMBERS = {"stiffness": 5e4, "bending": RIGIDITY}


def of_number(across: int, spacing: float, **kind) -> System:
    weight = np.ones(across + 1)
    weight[[0, -1]] = 0.5  # a particle has the mass of the cells about it
    mass = (DENSITY * spacing**2 * np.outer(weight, weight)).ravel()
    return sheet((across + 1, across + 1), spacing, mass=mass, **NUMBERS, **kind)


def of_material(across: int, spacing: float) -> System:
    return sheet((across + 1, across + 1), spacing, **SOLID)


def of_cloth(across: int, spacing: float) -> System:
    half = across * spacing / 2
    outline = [[-half, -half], [half, -half], [half, half], [-half, half]]
    return cloth(outline, spacing, **SOLID)


KINDS = {"number": of_number, "material": of_material, "cloth": of_cloth}
every_kind = pytest.mark.parametrize("make", KINDS.values(), ids=KINDS.keys())
RIMS = ("supported", "clamped", "free")


def plate(make: Callable, cells: int, rim: str, **kind) -> tuple[System, np.ndarray, int]:
    """Return (square sheet, which particles can move, cells on a side) with `cells` between its rims.

    Two pinned rows clamp midway between them.
    """
    across = cells + (rim == "clamped")
    system = make(across, SIDE / cells, **kind)
    distance = across / 2 - np.abs(system.position[:, :2]).max(axis=1) * cells / SIDE
    return system, distance > {"supported": 0.5, "clamped": 1.5, "free": -0.5}[rim], across


def sag(make: Callable, cells: int, rim: str, **kind) -> float:
    """Return the deflection of the middle under an even load [m], to first order."""
    system, free, across = plate(make, cells, rim, **kind)
    down = np.zeros(len(free))
    down[free] = spsolve(deflection_matrix(system)[free][:, free], np.full(free.sum(), LOAD * (SIDE / cells) ** 2))
    if across % 2 == 0:
        return float(down[len(down) // 2])
    near = np.array([-1, 9, 9, -1]) / 16  # a cubic through the four lines about the middle
    four = slice(across // 2 - 1, across // 2 + 3)
    return float(near @ down.reshape(across + 1, -1)[four, four] @ near)


def frequencies(system: System, free: np.ndarray) -> np.ndarray:
    """Return the angular frequencies of nine small vibrations of a sheet [1/s], ascending."""
    return 2 * math.pi * modes(system if free.all() else system.pin(~free), 9).frequencies


SAGS = {"supported": 0.00406235, "clamped": 0.00126532}
"""Deflection of the middle over q a⁴/D (Timoshenko & Woinowsky-Krieger, Theory of plates and shells, § 30, 44)."""


@every_kind
@pytest.mark.parametrize("rim", SAGS)
def test_a_held_plate_sags_as_kirchhoff_says(make, rim):
    theory = SAGS[rim] * LOAD * SIDE**4 / RIGIDITY
    error = [abs(sag(make, cells, rim) / theory - 1) for cells in (8, 16, 32)]
    # Of second order: 2.3 and 0.25 % at 16 cells.
    assert error[1] < 0.03
    assert error[1] < error[0] / 3
    assert error[2] < error[1] / 3


def free_plate(poissons_ratio: float, degree: int = 10) -> np.ndarray:
    """Return λ = ω a² √(ρ t/D) of a free square plate by Ritz's method, with Legendre polynomials."""
    x, weight = legendre.leggauss(2 * degree)
    basis = [legendre.legval(x, legendre.legder(np.eye(degree), m=k)) for k in range(3)]

    def gram(a: int, b: int, c: int, d: int) -> np.ndarray:
        return np.kron((basis[a] * weight) @ basis[b].T, (basis[c] * weight) @ basis[d].T)

    energy = gram(2, 2, 0, 0) + gram(0, 0, 2, 2) + poissons_ratio * (gram(2, 0, 0, 2) + gram(0, 2, 2, 0))
    energy += 2 * (1 - poissons_ratio) * gram(1, 1, 1, 1)
    return 4 * np.sqrt(np.abs(eigh(energy, gram(0, 0, 0, 0), eigvals_only=True)))


LEISSA = {"supported": [2 * math.pi**2, 5 * math.pi**2], "clamped": [35.985, 73.394]}
"""λ of two frequencies (Leissa, The free vibration of rectangular plates, J. Sound Vib. 31 (1973) 257)."""


@pytest.mark.parametrize("make", [of_number, of_material])
@pytest.mark.parametrize("rim", RIMS)
def test_a_plate_rings_as_kirchhoff_says(make, rim):
    error = []
    for cells in (8, 16):
        found = frequencies(*plate(make, cells, rim)[:2]) * SIDE**2 * math.sqrt(DENSITY / RIGIDITY)
        if rim == "free":  # behind six motions of a rigid body
            assert found[5] < 1e-3
            theory, found = free_plate(1 / 3)[3:6], found[6:9]
        else:
            theory, found = LEISSA[rim], found[[0, 1]]
        error.append(np.abs(found / theory - 1).max())
    assert error[1] < 0.03  # 1.5 % of the first, 2.4 % of the second, at 16 cells
    assert error[1] < error[0] / 3  # of second order


def test_leissas_free_plate_is_ritzs():
    assert free_plate(0.3)[3:6] == pytest.approx([13.468, 19.596, 24.271], rel=1e-4)  # his, for a ratio of 0.3


def test_a_plate_of_4_neighbours_is_a_grid_of_beams():
    # D (w_xxxx + w_yyyy) = q, with no resistance to twist: Navier's series.
    odd = np.arange(1, 60, 2)
    m, n = np.meshgrid(odd, odd)
    sign = (-1.0) ** ((m + n) // 2 - 1)
    theory = 16 * LOAD * SIDE**4 / (math.pi**6 * RIGIDITY) * (sign / (m * n * (m**4 + n**4))).sum()
    error = [abs(sag(of_number, cells, "supported", neighbors=4) / theory - 1) for cells in (8, 16, 32)]
    assert error[1] < 0.01
    assert error[1] < error[0] / 3
    assert error[2] < error[1] / 3


def disc(across: int) -> np.ndarray:
    """Return the mask of the cells whose middle is within a circle."""
    middle = (np.arange(across) + 0.5) / across - 0.5
    cells = np.pad(middle[:, None] ** 2 + middle**2 < 0.25, 1)
    return cells[1:, 1:] | cells[1:, :-1] | cells[:-1, 1:] | cells[:-1, :-1]


def free_disc(poissons_ratio: float, n: int = 2) -> float:
    """Return λ² = ω R² √(ρ t/D) of a free disc with n nodal diameters: no moment, no shear at its rim."""

    def condition(k: float) -> float:
        rows = []
        for value, slope, sign in ((jv, jvp, -1), (iv, ivp, 1)):
            w, first, second = value(n, k), k * slope(n, k), k**2 * slope(n, k, 2)
            moment = second + poissons_ratio * (first - n**2 * w)
            rows.append((moment, sign * k**2 * first - n**2 * (1 - poissons_ratio) * (first - w)))
        return float(np.linalg.det(rows))

    return brentq(condition, 2.0, 2.6) ** 2


def test_a_free_disc_rings_as_a_plate():
    # Its rim is a staircase: of first order, by the radius of a disc of equal area.
    error = []
    for across in (16, 32):
        system = lattice(disc(across), SIDE / across, **SOLID)
        radius = math.sqrt(system.mass.sum() / DENSITY / math.pi)
        found = frequencies(system, np.ones(system.particle_count, dtype=bool))[6:8]
        error.append(np.abs(found * radius**2 * math.sqrt(DENSITY / RIGIDITY) / free_disc(1 / 3) - 1).max())
    assert error[0] < 0.04
    assert error[1] < 0.02


def test_a_loaded_plate_settles_where_theory_has_it():
    cells = 16
    system, free, _ = plate(of_material, cells, "supported")
    load = Force((0.0, 0.0, -LOAD * (SIDE / cells) ** 2), on=free)
    how = {"gravity": 0.0, "loads": [load], "device": "cpu", "precision": "float64"}
    simulation = Simulation(system.pin(~free), **how)
    simulation.settle(1e-9)
    found = -simulation.frame().position[:, 2].min()
    # 2.3 % of second order, and less by its membrane: the rim cannot move inwards.
    assert found == pytest.approx(SAGS["supported"] * LOAD * SIDE**4 / RIGIDITY, rel=0.05)
