"""Cells that resist a change of volume: their forces, energies and stable steps, and Poisson's ratio."""

import re
from dataclasses import replace

import numpy as np
import problems
import pytest
import volumes
from tangles import PRECISIONS, evaluate

from msdwarp import (
    Cells,
    Material,
    Simulation,
    StrainWarning,
    System,
    ball,
    box,
    chain,
    lattice,
    sheet,
)
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.springs import cell_volumes

RATIOS = (0.0, 0.1, 0.35, 0.45, 0.49)
STUFF = Material(density=1000.0, youngs_modulus=1e5, damping_ratio=0.05)


def of_ratio(ratio: float, **changes) -> Material:
    return replace(STUFF, poissons_ratio=ratio, **changes)


def bodies(ratio: float) -> dict[str, System]:
    material = of_ratio(ratio)
    solid, cloth = box((4, 3, 3), 0.1, material=material), sheet((4, 3), 0.1, material=material, thickness=0.01)
    return {
        "solid": solid,
        "ball": ball(0.2, 0.1, material=material),
        "flat in space": cloth,
        "flat": sheet((5, 4), 0.1, material=material, thickness=0.01, dim=2),
        "both": solid + cloth.translate((0, 0, 0.4)),
    }


def thrown(system: System, by: float = 0.02) -> System:
    random = np.random.default_rng(5)
    noise, velocity = random.normal(size=(2, *system.position.shape))
    return system.replace(position=system.position + by * noise, velocity=velocity)


def test_volumes_are_those_of_bilinear_faces():
    random = np.random.default_rng(1)
    x = volumes.SOLID + 0.2 * random.normal(size=(8, 3))
    cell = Cells(corners=[range(8)], rest_volume=1.0, modulus=1.0)
    assert cell.volumes(x) == pytest.approx(volumes.gradients(cell, x)[0], rel=1e-13)  # rounding


def test_repeated_corners_make_a_tetrahedron_and_a_wedge():
    x = np.array([(0, 0, 0), (2, 0, 0), (0, 3, 0), (0, 0, 4), (2, 0, 4), (0, 3, 4)], dtype=float)
    corners = [[0, 1, 2, 2, 3, 3, 3, 3], [0, 1, 2, 2, 3, 4, 5, 5]]
    cells = Cells(corners=corners, rest_volume=1.0, modulus=1.0)
    assert cells.volumes(x) == pytest.approx([4.0, 12.0], rel=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "precision", "ratio"),
    [
        *((name, "float64", (0.1, 0.45)[k % 2]) for k, name in enumerate(bodies(0.45))),
        ("flat in space", "float64", 0.45),
        ("solid", "float32", 0.45),
    ],
)
def test_forces_are_the_slope_of_the_energy(device, name, precision, ratio):
    assert_forces_are_slopes(thrown(bodies(ratio)[name]), device, precision, ratio)


def assert_forces_are_slopes(system: System, device: str, precision: str, ratio: float) -> np.ndarray:
    """Compare forces on particles with derivatives of the energy, and return them."""
    if precision != "float64":
        rounded = (one.astype(np.float32).astype(float) for one in (system.position, system.velocity))
        system = system.replace(**dict(zip(("position", "velocity"), rounded, strict=True)))
    expected = volumes.forces(system, system.position, system.velocity)
    expected += problems.forces(system, system.position, system.velocity)
    cells = system.cells
    # Sums of some hundred rounded terms: pressures of up to 2 κ on faces of a², and springs.
    largest = np.abs(cells.modulus).max() * cells.rest_volume.max() / 0.1 * 50 + np.abs(expected).max()
    found = evaluate(system, device, precision)
    assert np.abs(found - expected).max() < 20 * PRECISIONS[precision] * largest + 1e-7 * (ratio < 0.25) * largest
    assert np.abs(volumes.forces(system, system.position, system.velocity)).max() > 0.05 * np.abs(expected).max()
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("precision", "ratio"), [("float64", 0.1), ("float64", 0.45), ("float32-compensated", 0.45)]
)
def test_forces_by_faces_are_those_by_corners(monkeypatch, precision, ratio):
    monkeypatch.setattr(cell_volumes, "FACES_ON_CPU", True)  # as on a GPU
    one = box((4, 3, 3), 0.1, material=of_ratio(ratio))
    system = thrown(one + chain(3, 0.1).translate((0, 0, 0.4)) + one.translate((0, 0, 0.8)))  # some have no cells
    simulation = Simulation(system, device="cpu", precision=precision)
    assert isinstance(simulation.assembly.all[-1], cell_volumes.CellVolumes)
    assert "pressure" in simulation.assembly.all[-1].by_world
    found = assert_forces_are_slopes(system, "cpu", precision, ratio)
    if precision == "float64":
        assert np.abs(found.sum(axis=0)).max() < 1e-13 * np.abs(found).sum()


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.each_value
def test_a_bar_shows_the_ratio_and_the_modulus_it_is_given(plain_device, axes, ratio):
    # Homogeneous strain of a free bar: only its ends feel a force, E ε for an area.
    a, strain, thickness = 0.1, 1e-6, 0.02
    if axes == 3:
        system = box((7, 4, 4), a, material=of_ratio(ratio))
        section = (3 * a) ** 2
    else:
        system = sheet((7, 4), a, material=of_ratio(ratio), thickness=thickness, dim=2)
        section = 3 * a * thickness
    scale = np.full(system.dim, 1 - ratio * strain)
    scale[0] = 1 + strain
    force = evaluate(system.replace(position=system.position * scale), plain_device, "float64")
    end = system.position[:, 0] > system.position[:, 0].max() - a / 2
    expected = STUFF.youngs_modulus * strain * section
    # Terms of second order in the strain: some 1e-6 of the force, times λ/E (16 at 0.49).
    assert -force[end, 0].sum() == pytest.approx(expected, rel=1e-4)
    assert np.abs(force[:, 1:].sum(axis=1) if axes == 2 else force[:, 1:]).max() < 1e-4 * expected
    assert np.abs(force[~end & (system.position[:, 0] > 0)][:, 0]).max() < 1e-4 * expected


def test_a_ratio_that_springs_have_needs_no_cells():
    assert box((3, 3, 3), 0.1, material=of_ratio(0.25)).cells is None
    assert sheet((3, 3), 0.1, material=of_ratio(1 / 3), thickness=0.01).cells is None
    assert box((3, 3, 3), 0.1, material=STUFF).cells is None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "ratio"), [("both", 0.45), ("flat", 0.1)])
def test_energy_and_power_are_those_of_the_cells(plain_device, name, ratio):
    system = thrown(bodies(ratio)[name], 0.01)
    simulation = Simulation(system, gravity=0.0, device=plain_device, precision="float64")
    found, springs = simulation.measure(), problems.energy(system)
    stored = volumes.energy(system.cells, system.position)
    assert found.effect_energy == pytest.approx(stored, rel=1e-12)
    assert found.energy == pytest.approx(springs + stored, rel=1e-12)
    # The work of all dampers: forces that velocities add.
    still = system.replace(velocity=np.zeros_like(system.velocity))
    added = evaluate(system, plain_device, "float64") - evaluate(still, plain_device, "float64")
    assert found.dissipated_power == pytest.approx(-(added * system.velocity).sum(), rel=1e-10)


def stiffness_rate(system: System) -> float:
    """Return the largest eigenvalue of M⁻¹K of springs and cells."""
    still = np.zeros_like(system.position)
    return problems.stiffness_rate(
        system, lambda x: volumes.forces(system, x, still) + problems.forces(system, x, still), 1e-5
    )


def stretched(system: System, *by: float) -> System:
    return system.replace(position=system.position * by)


HEAVY = np.linspace(0.5, 2.0, 36)
DEFORMED = {
    "a cell": box((2, 2, 2), 0.1, material=of_ratio(0.49)),
    "bar": box((7, 2, 2), 0.1, material=of_ratio(0.49)),
    "squeezed": stretched(box((4, 4, 4), 0.1, material=of_ratio(0.45)), 0.7, 1.15, 1.15),
    "pulled": stretched(box((5, 3, 2), 0.1, material=of_ratio(0.45)), 1.3, 0.9, 0.9),
    "distorted": thrown(box((3, 3, 3), 0.1, material=of_ratio(0.45))),
    "held": box((4, 3, 3), 0.1, material=of_ratio(0.49)).pin(slice(0, 9)),
    "heavy": box((4, 3, 3), 0.1, material=of_ratio(0.45)).replace(mass=HEAVY),
    "squeezed cork": stretched(box((3, 3, 3), 0.1, material=of_ratio(0.0)), 0.8, 1.0, 1.0),
    "cloth": sheet((5, 5), 0.1, material=of_ratio(0.49), thickness=0.01),
    "stretched cloth": stretched(sheet((5, 5), 0.1, material=of_ratio(0.49), thickness=0.01), 1.2, 1.1, 1.0),
    "plane": sheet((5, 5), 0.1, material=of_ratio(0.45), thickness=0.01, dim=2),
}


SMALL = ("a cell", "cloth", "stretched cloth", "plane")


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one not in SMALL)) for one in DEFORMED]
)
def test_the_bound_of_the_step_holds_and_is_near(name):
    system = DEFORMED[name]
    truth, bound = stiffness_rate(system), rate_bounds(system).stiffness
    assert truth <= bound * (1 + 1e-6)  # of differences
    # That of springs is at most twice the truth. Pressures, of which the bound takes the size, and negative
    # moduli, which it leaves out, add a little.
    assert bound <= 2.1 * truth


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.1, 0.45])
def test_leapfrog_keeps_the_energy_of_a_bar_that_swings(plain_device, ratio):
    system = box((7, 3, 3), 0.1, material=of_ratio(ratio, damping_ratio=0.0))
    system = stretched(system, 1.1, 1.0, 1.0).replace(rest_length=system.rest_length)
    coarse, fine = (problems.energy_swing(system, plain_device, substeps, frames=30) for substeps in (40, 80))
    assert coarse < 0.02
    assert 3 < coarse / fine < 5  # of second order


@pytest.mark.slow
def test_automatic_steps_are_enough_where_a_body_is_squeezed():
    # A bound of the state at rest would let energy grow by a fifth.
    system = box((7, 3, 3), 0.1, material=of_ratio(0.45, damping_ratio=0.0))
    system = stretched(system, 0.75, 1.1, 1.1).replace(rest_length=system.rest_length)
    simulation = Simulation(system, gravity=0.0, device="cpu")
    simulation.step()  # at the start the number of substeps, on which the conserved energy depends, is a guess
    start = simulation.stepping.balance().energy
    for _ in range(60):
        simulation.step()
        assert simulation.stepping.balance().energy < 1.02 * start  # as the step controller allows


def test_large_strains_below_the_ratio_of_springs_are_warned_of():
    system = stretched(box((4, 3, 3), 0.1, material=of_ratio(0.05)), 2.0, 1.0, 1.0)
    system = system.replace(rest_length=box((4, 3, 3), 0.1).rest_length)
    with pytest.warns(StrainWarning, match=r"strained by 0\.\d+; below a Poisson's ratio of 1/4"):
        Simulation(system, gravity=0.0, device="cpu").step(3)


def test_a_new_rest_shape_has_new_volumes(plain_device):
    system = bodies(0.45)["both"]
    simulation = Simulation(
        stretched(system, 1.1, 1.0, 1.0), gravity=0.0, device=plain_device, precision="float64"
    )
    simulation.change(set_rest_shape=True)
    assert simulation.measure().energy < 1e-20
    kept = simulation.checkpoint()
    again = Simulation(stretched(system, 1.1, 1.0, 1.0), gravity=0.0, device=plain_device, precision="float64")
    again.restore(*kept)
    assert again.measure().energy < 1e-20


def test_cells_follow_their_particles():
    solid, cloth = bodies(0.45)["solid"], bodies(0.45)["flat in space"]
    both = solid + cloth
    for system in (
        solid,
        cloth,
        both,
        both.renumbered(),
        lattice(np.ones((3, 4, 5), bool), 0.1, material=of_ratio(0.4)),
    ):
        assert system.cells.volumes(system.position) == pytest.approx(system.cells.rest_volume, rel=1e-12)
    assert len(both.cells) == len(solid.cells) + len(cloth.cells)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: of_ratio(0.495), "poissons_ratio is 0.495; it must be from 0 to 0.49"),
        (lambda: of_ratio(-0.1), "poissons_ratio is -0.1"),
        (lambda: of_ratio(float("nan")), "poissons_ratio is nan"),
        (lambda: box((3, 3, 3), 0.1, neighbors=6, material=of_ratio(0.4)), "needs neighbors=26"),
        (lambda: sheet((3, 3), 0.1, neighbors=4, material=of_ratio(0.4), thickness=0.1), "needs neighbors=8"),
        (lambda: Cells(corners=[[0, 1, 2]], rest_volume=1, modulus=1), "corners has shape (1, 3)"),
        (lambda: Cells(corners=[[0, 1, 2, -1]], rest_volume=1, modulus=1), "corners[0, 3] is -1"),
        (lambda: Cells(corners=[[0, 1, 2, 3, 4, 5, 6, -1]], rest_volume=1, modulus=1), "corners[0, 7] is -1"),
        (lambda: Cells(corners=[[0, 1, 2, 3]], rest_volume=0, modulus=1), "rest_volume is 0; it must be above 0"),
        (lambda: Cells(corners=[[0, 1, 2, 3]], rest_volume=1, modulus=np.nan), "modulus is nan"),
        (lambda: Cells(corners=[[0, 1, 2, 3]], rest_volume=1, modulus=1, damping=-1), "damping is -1"),
        (
            lambda: System(position=np.eye(3), cells=Cells(corners=[[0, 1, 2, 3]], rest_volume=1, modulus=1)),
            "cells.corners[0, 3] is 3",
        ),
        (
            lambda: System(position=np.ones((8, 2)), cells=Cells(corners=[range(8)], rest_volume=1, modulus=1)),
            "in 2 dimensions they must be flat",
        ),
        (lambda: System(position=np.eye(3), cells=[1]), "cells is [1]; it must be a Cells"),
        (
            lambda: Simulation(
                box((3, 3, 3), 0.1, material=of_ratio(0.4)).replace(break_strain=0.5), device="cpu"
            ),
            "no connection can break",
        ),
    ],
)
def test_what_is_wrong_is_said(make, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        make()


@pytest.mark.parametrize("scale", [0.5, 0.2, -0.3])
def test_crushed_cells_stiffen(scale):
    # Below a third of its volume; w' is also the pressure that `stress` takes.
    system = stretched(bodies(0.45)["solid"], 1.0, 1.0, scale)
    system = system.replace(velocity=[0.3, -0.2, 0.5] * system.position)
    x, v = system.position, system.velocity
    expected = volumes.forces(system, x, v) + problems.forces(system, x, v)
    found = evaluate(system, "cpu", "float64")
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()  # rounding of some hundred terms
    kappa = system.cells.modulus[0]
    slope = kappa * (scale - 1 - 30 * max(1 / 3 - scale, 0) ** 2)
    np.testing.assert_allclose(system.cells.slopes(x), slope, rtol=1e-12)
    simulation = Simulation(system, gravity=0.0, device="cpu", precision="float64")
    assert simulation.measure().effect_energy == pytest.approx(volumes.energy(system.cells, x), rel=1e-12)
