"""Bending: a sheet with springs to second neighbours is a plate, with the errors that its module states."""

import math
import re

import numpy as np
import problems
import pytest
from elasticity import deflection_matrix
from scipy.sparse.linalg import spsolve

from msdwarp import Material, System, cloth, lattice, sheet

PAPER = Material(density=700.0, youngs_modulus=2e9, damping_ratio=0.01)
THICKNESS, SPACING = 2e-3, 0.01
RIGIDITY = PAPER.flexural_rigidity(THICKNESS)
SOLID = {"material": PAPER, "thickness": THICKNESS, "bending": "material"}
CONSTANTS = {"stiffness": 3e6, "damping": 20.0, "mass": 1e-4, "bending": RIGIDITY}
EPS = np.finfo(float).eps


def flat_forces(system: System) -> np.ndarray:
    return problems.forces(system, system.position, system.velocity)


def largest_force(system: System) -> float:
    return float((system.stiffness * np.abs(system.length - system.rest_length)).max())


def energy(system: System) -> float:
    return float((system.stiffness * (system.length - system.rest_length) ** 2).sum() / 2)


def test_rigidity_is_of_a_plate_with_the_ratio_of_the_lattice():
    assert PAPER.flexural_rigidity(2e-3) == pytest.approx(2e9 * 8e-9 / (12 * (1 - 1 / 9)), rel=4 * EPS)
    assert PAPER.flexural_rigidity(2e-3, diagonals=False) == pytest.approx(2e9 * 8e-9 / 12, rel=4 * EPS)


@pytest.mark.parametrize("none", [None, 0, 0.0])
def test_without_bending_a_sheet_is_what_it_was(none):
    outline = [[0, 0], [1, 0], [1, 0.6], [0, 0.6]]
    for make in (lambda **b: sheet((5, 4), 0.1, **b), lambda **b: cloth(outline, 0.1, damping=0.2, **b)):
        plain, asked = make(), make(bending=none)
        for name, value in vars(plain).items():
            if name != "surface":
                np.testing.assert_equal(getattr(asked, name), value)
        assert list(asked.directions[0]) == ["x", "y", "x+y", "x-y"]


@pytest.mark.parametrize("neighbours", [4, 8])
def test_springs_lead_to_second_neighbours(neighbours):
    system = sheet((5, 4), SPACING, neighbors=neighbours, **CONSTANTS)
    names = ["x", "y", "x+y", "x-y"][: neighbours // 2]
    assert list(system.directions[0]) == [*names, *("2x", "2y", "2x+2y", "2x-2y")[: neighbours // 2]]
    steps = {"2x": (2, 0), "2y": (0, 2), "2x+2y": (2, 2), "2x-2y": (2, -2)}
    counts = {"2x": 3 * 4, "2y": 5 * 2, "2x+2y": 3 * 2, "2x-2y": 3 * 2}
    for name in list(system.directions[0])[neighbours // 2 :]:
        i, j = system.connections[system.direction(name)].T
        assert len(i) == counts[name]
        found = (system.position[j] - system.position[i]) / SPACING
        np.testing.assert_allclose(found[:, :2], np.tile(steps[name], (len(i), 1)), rtol=0, atol=16 * EPS)


def test_dampers_have_the_ratio_of_the_others():
    for system in (sheet((5, 4), SPACING, **CONSTANTS), sheet((5, 4), SPACING, **SOLID)):
        ratio = system.damping / system.stiffness
        np.testing.assert_allclose(ratio, ratio[0], rtol=8 * EPS)


HOLED = np.ones((9, 8), dtype=bool)
HOLED[3:5, 3] = HOLED[0, 6] = HOLED[0, 7] = False
HOLED[7:, :2] = False


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("kind", [SOLID, CONSTANTS], ids=["material", "constants"])
def test_a_flat_sheet_is_balanced_up_to_its_rim(kind, neighbours):
    for system in (
        sheet((7, 6), SPACING, neighbors=neighbours, **kind),
        sheet((2, 6), SPACING, neighbors=neighbours, **kind),
        sheet((3, 3), SPACING, neighbors=neighbours, **kind),
        lattice(HOLED, SPACING, neighbors=neighbours, **kind),
    ):
        # As many forces as meet in a particle are added, each rounded some times.
        assert np.abs(flat_forces(system)).max() < 100 * EPS * system.stiffness.max() * SPACING
        assert largest_force(system) > 1.0


@pytest.mark.parametrize("solid", [True, False])
def test_no_spring_bridges_a_hole_or_a_notch(solid):
    system = lattice(HOLED, SPACING, **(SOLID if solid else CONSTANTS))
    joined = {tuple(sorted(pair)) for pair in system.connections.tolist()}
    place = {tuple(p): k for k, p in enumerate(np.rint(system.position[:, :2] / SPACING * 2).astype(int))}
    bridges = [name for name in system.directions[0] if "2" in name]
    assert len(bridges) == 4
    for name in bridges:
        for i, j in system.connections[system.direction(name)]:
            middle = (system.position[i] + system.position[j])[:2] / SPACING
            between = place[tuple(np.rint(middle).astype(int))]
            assert {tuple(sorted((i, between))), tuple(sorted((between, j)))} <= joined
    # All there can be, without a material: every point that has a connection on either side.
    if not solid:
        both = HOLED[:-2] & HOLED[1:-1] & HOLED[2:]
        assert system.direction("2x").stop - system.direction("2x").start == np.count_nonzero(both)


@pytest.mark.parametrize("turn", [0.01, 1.2, 2.0, math.pi])
def test_energy_of_a_cylinder(turn):
    # Particles lie on a circle, neighbours a chord of one spacing apart: only what joins second ones changes.
    nx, ny = 9, 13
    system = sheet((nx, ny), SPACING, neighbors=4, **SOLID)
    heading = turn * np.arange(nx - 1)
    line = np.zeros((nx, 3))
    line[1:, 0], line[1:, 2] = np.cumsum([np.cos(heading), np.sin(heading)], axis=1) * SPACING
    x = np.tile(line, (ny, 1))
    x[:, 1] = system.position[:, 1]
    # Folded flat, forces along chords of no length are in no direction, but the energy is what it is.
    found = energy(system.replace(position=x)) - energy(system)
    area = (nx - 2) * (ny - 1) * SPACING**2
    theory = PAPER.flexural_rigidity(THICKNESS, diagonals=False) / 2 * (turn / SPACING) ** 2 * area
    # P δ + P δ²/(12 l) with δ = 2 l (1 − cos θ/2), over P l θ²/4.
    drop = 1 - math.cos(turn / 2)
    assert found / theory == pytest.approx((2 * drop + drop**2 / 3) / (turn**2 / 4), rel=1e-6)
    assert found / theory == pytest.approx(1.0, abs=0.06)


SHAPES = {"cylinder": (1.0, 0.0), "bowl": (1.0, 1.0), "saddle": (1.0, -1.0), "between": (1.0, 0.4)}


@pytest.mark.parametrize("angle", [0, 30, 45, 70])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("solid", [True, False])
def test_a_sheet_of_8_neighbours_is_an_isotropic_plate(shape, angle, solid):
    n = 60
    system = sheet((n + 1, n + 1), SPACING, **(SOLID if solid else CONSTANTS))
    (a, b), turn = SHAPES[shape], math.radians(angle)
    along = system.position[:, 0] * math.cos(turn) + system.position[:, 1] * math.sin(turn)
    across = system.position[:, 1] * math.cos(turn) - system.position[:, 0] * math.sin(turn)
    w = (a * along**2 + b * across**2) / 2
    plate = RIGIDITY / 2 * (a**2 + b**2 + 2 / 3 * a * b) * (n * SPACING) ** 2
    # Differences of second order are exact of a parabola; what is left is at the rim, where this one needs moments
    # that a free rim has not: half a cell on either side, of less weight across the rim.
    assert -2 / n <= w @ deflection_matrix(system) @ w / 2 / plate - 1 <= 1e-6


def sag(system: System, held: np.ndarray) -> np.ndarray:
    """Return how far each particle sags under its own weight [m], to first order."""
    matrix, down = deflection_matrix(system), np.zeros(system.particle_count)
    down[~held] = spsolve(matrix[~held][:, ~held], 9.82 * system.mass[~held])
    return down


def strip(cells: int, wide: int, **kind) -> float:
    """Return the sag of a strip's end, clamped in its first cell, over theory: ρ t g L⁴/(8 D), D = E t³/12."""
    system = sheet((cells + 2, wide + 1), SPACING, **{**SOLID, **kind})
    column = np.arange(system.particle_count) % (cells + 2)
    length = (cells + 0.5) * SPACING
    load = PAPER.density * THICKNESS * 9.82
    end = sag(system, column < 2)[column == cells + 1].mean()
    return end / (load * length**4 / (8 * PAPER.flexural_rigidity(THICKNESS, diagonals=False)))


@pytest.mark.parametrize("cells", [4, 8, 16, 32])
@pytest.mark.parametrize("wide", [1, 3])
def test_sag_of_a_clamped_strip_is_that_of_a_beam(cells, wide):
    assert strip(cells, wide, neighbors=4) == pytest.approx(1.0, abs=1 / cells**2)


def test_sag_of_a_clamped_strip_with_diagonals():
    # One cell wide there are angles along it alone: 15/16 of a beam. Two cells wide it is 31/32 of one, and wider
    # ones are a beam, which is held flat by its clamp: a wide one is then stiffer, by up to 1/(1 − ν²) = 9/8.
    for wide, theory in ((1, 16 / 15), (2, 32 / 31), (3, 1.0), (4, 1.0)):
        error = [abs(strip(cells, wide) / theory - 1) for cells in (32, 128)]
        assert error[1] < min(0.011, error[0] / 2)  # what the clamp holds flat is as long as the strip is wide
    wide = [strip(12, wide) for wide in (24, 48)]
    assert all(8 / 9 < found < 1 for found in wide)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sheet((4, 4), bending=-1.0), "bending is -1; it must be a number of at least 0"),
        (lambda: sheet((4, 4), bending=math.nan), "bending is nan"),
        (lambda: sheet((4, 4), bending="stiff"), "bending is 'stiff'; it must be a rigidity [N m]"),
        (lambda: sheet((4, 4), bending=True), "bending is True; it must be a rigidity [N m]"),
        (lambda: sheet((4, 4), bending="material"), "bending is 'material'; without a material"),
        (lambda: sheet((4, 4), bending=1.0, dim=2), "bending is 1.0; with dim=2"),
        (
            lambda: sheet((6, 6), bending=200.0),
            "bending is 200 N m; connections of this stiffness bear at most 187.5",
        ),
        (lambda: sheet((4, 4), bending=1.0, stiffness=0.0), "bear at most 0"),
        (lambda: lattice(np.ones((3, 3, 3), bool), bending=1.0), "bending is 1.0; for a solid body"),
        (lambda: cloth([[0, 0], [1, 0], [1, 1]], 0.2, bending=-2.0), "bending is -2;"),
    ],
)
def test_bending_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


def test_more_bending_than_connections_bear_is_told():
    sheet((6, 6), bending=187.4)  # 1000 N/m bear a strain of a half: 8/3 D = 500 N
