"""Regions: parts of bodies with a material or a law of their own."""

import math

import numpy as np
import pytest
from elasticity import stiffness_matrix
from scipy.optimize import brentq
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh

import msdwarp as msd
from msdwarp import Material

SOFT, HARD = Material(1000.0, 1e5, 0.05), Material(3000.0, 4e5, 0.1)
RUBBERY = Material(1200.0, 3e5, 0.1, poissons_ratio=0.4)
SHEET, CHAIN = {"thickness": 0.01}, {"area": 0.01}
MAKE = {
    "box": (lambda m: msd.box((5, 4, 3), 0.1, material=m), {}),
    "box of 6": (lambda m: msd.box((5, 4, 3), 0.1, neighbors=6, material=m), {}),
    "turned box": (lambda m: msd.box((5, 4, 3), 0.1, material=m).rotate(0.3, (1, 2, 3)), {}),
    "sheet": (lambda m: msd.sheet((5, 4), 0.1, material=m, **SHEET), SHEET),
    "plane": (lambda m: msd.sheet((5, 4), 0.1, material=m, dim=2, **SHEET), SHEET),
    "chain": (lambda m: msd.chain(5, 0.1, material=m, **CHAIN), CHAIN),
}


def same(one: msd.System, other: msd.System) -> None:
    """Check that masses, springs, dampers and cells of two bodies are the same up to rounding."""
    for name in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, err_msg=name)
    assert (one.cells is None) == (other.cells is None)
    if one.cells is not None:
        for name in ("corners", "rest_volume", "modulus", "damping"):
            np.testing.assert_allclose(getattr(one.cells, name), getattr(other.cells, name), rtol=1e-12)


@pytest.mark.parametrize("name", MAKE)
@pytest.mark.parametrize("pair", [(SOFT, HARD), (SOFT, RUBBERY), (RUBBERY, SOFT), (RUBBERY, msd.RUBBER)])
def test_a_body_that_changes_as_a_whole_is_made_of_the_other_material(name, pair):
    make, section = MAKE[name]
    first, second = pair
    if name == "box of 6" and pair != (SOFT, HARD):
        with pytest.raises(ValueError, match=r"poissons_ratio.* needs"):
            make(first).with_material(slice(None), second, **section)
        return
    same(make(first).with_material(slice(None), second, **section), make(second))


def test_parts_meet_as_voxels_do():
    # In corners too: three materials, and one that was there before.
    cells = np.ones((4, 3, 2), dtype=int)
    cells[2:], cells[:, :, 1:] = 2, 3
    body = msd.box((5, 4, 3), 0.1, material=SOFT)
    x = body.position
    body = body.with_material(x[:, 0] > -1e-9, RUBBERY).with_material(x[:, 2] > -1e-9, HARD)
    same(body, msd.voxels(cells, 0.1, materials={1: SOFT, 2: RUBBERY, 3: HARD}))


def test_only_whole_cells_of_the_part_change():
    body = msd.box((5, 4, 3), 0.1, stiffness=300.0, mass=0.1).pin([0])
    part = body.with_material(body.position[:, 0] > -1e-9, SOFT)
    left = body.position[body.connections, 0].max(axis=1) < -1e-9
    np.testing.assert_array_equal(part.stiffness[left], 300.0)
    assert np.isinf(part.mass[0])
    assert part.mass[body.position[:, 0] > 0.1].sum() + part.mass[[1]].sum() > 0
    inner = part.position[:, 0] > 0.05
    solid = msd.box((5, 4, 3), 0.1, material=SOFT)
    np.testing.assert_allclose(part.mass[inner], solid.mass[inner], rtol=1e-12)
    # Half of what is in the face between them is of either side.
    face = (np.abs(body.position[body.connections, 0]) < 1e-9).all(axis=1)
    np.testing.assert_allclose(part.stiffness[face], 150.0 + solid.stiffness[face] / 2, rtol=1e-12)


def test_each_part_is_damped_as_its_material_asks():
    body = msd.box((9, 3, 3), 0.1, material=SOFT)
    body = body.with_material(body.position[:, 0] > -1e-9, HARD)
    time = body.damping / body.stiffness
    x = body.position[body.connections, 0]
    for material, part in ((SOFT, x.max(axis=1) < -0.01), (HARD, x.min(axis=1) > 0.01)):
        omega = math.pi * material.wave_speed / 0.8  # of the slowest mode of a bar as long as the body
        np.testing.assert_allclose(time[part], 2 * material.damping_ratio / omega, rtol=1e-12)


def rod_of_two(material: Material, other: Material) -> list[float]:
    """Return the lowest frequencies of a rod of two halves of 1 m, held at the left [rad/s].

    Displacement and force are equal where they meet: tan(ω/c₁) tan(ω/c₂) = Z₁/Z₂ with Z = √(E ρ) (Graff, Wave
    Motion in Elastic Solids, 2.2).
    """
    c, d = material.wave_speed, other.wave_speed
    ratio = (c * material.density) / (d * other.density)

    def residual(w: float) -> float:
        return math.sin(w / c) * math.sin(w / d) - ratio * math.cos(w / c) * math.cos(w / d)

    w = np.linspace(0.01, 100.0, 6001)
    values = [residual(one) for one in w]
    return [brentq(residual, *w[k : k + 2]) for k in range(len(w) - 1) if values[k] * values[k + 1] < 0]


def frequencies(kind: str, n: int) -> np.ndarray:
    """Return the lowest frequencies of that rod with n cells to a half [rad/s]."""
    if kind == "chain":
        body, section = msd.chain(2 * n + 1, 1 / n, material=SOFT, dim=1, **CHAIN), CHAIN
    else:  # without diagonals a bar is rods side by side
        body, section = msd.box((2 * n + 1, 3, 2), 1 / n, neighbors=6, material=SOFT), {}
    body = body.with_material(body.position[:, 0] > -1e-9, HARD, **section)
    free = np.flatnonzero(body.position[:, 0] > body.position[:, 0].min() + 1e-9)
    matrix = stiffness_matrix(body)[body.dim * free][:, body.dim * free]  # along x
    weight, copies = diags(body.mass[free] ** -0.5), 1 if kind == "chain" else 6
    return np.sqrt(np.sort(eigsh((weight @ matrix @ weight).tocsc(), 4 * copies, sigma=0)[0])[::copies])


@pytest.mark.parametrize("kind", ["chain", "bar"])
def test_a_rod_of_two_materials_has_the_frequencies_of_waves_in_it(kind):
    expected = np.array(rod_of_two(SOFT, HARD)[:4])
    coarse, fine = (frequencies(kind, n) / expected - 1 for n in (20, 40))
    # Of second order in the spacing: about (q a)²/24 for a wave number q, 0.15 a⁻¹ at most. What is left after
    # extrapolation is of fourth order, (q a)⁴/100 or so.
    assert (np.abs(fine) < 1.5 * (expected / SOFT.wave_speed / 40) ** 2 / 24).all()
    np.testing.assert_allclose((4 * fine - coarse) / 3, 0.0, atol=(expected[-1] / SOFT.wave_speed / 20) ** 4 / 100)
    assert (np.abs(coarse / fine - 4) < 0.05).all()


def test_a_part_has_its_own_laws():
    body = msd.chain(6, 0.1, stiffness=10.0, damping=0.1)
    part = body.with_law([3, 4, 5], spring=msd.TensionOnlySpring(), damper=msd.CoulombDamper())
    assert part.spring == msd.SpringKinds((msd.Spring(), msd.TensionOnlySpring()), [0, 0, 0, 1, 1])
    assert part.damper == msd.DamperKinds((msd.Damper(), msd.CoulombDamper()), [0, 0, 0, 1, 1])
    assert part.with_law(slice(None), spring=msd.Spring()).spring == msd.Spring()
    three = part.with_law([0, 1], spring=msd.LimitedSpring())
    np.testing.assert_array_equal(three.spring.kind, [2, 0, 0, 1, 1])
    assert body.with_law([0, 1]).spring == msd.Spring()
    with pytest.raises(ValueError, match="a connection must join two of it"):
        body.with_law([0, 2], spring=msd.TensionOnlySpring())
    with pytest.raises(ValueError, match="spring is 3; it must be a Spring"):
        body.with_law([0, 1], spring=3)  # type: ignore[arg-type]


ROD = msd.rod(6, 0.1, radius=0.01, material=HARD)
APART = msd.voxels([[1, 1], [1, 1], [1, 1]], 0.1, connections=[[0, 1], [0, 2], [2, 4], [1, 3], [3, 5]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: msd.box((3, 3, 3)).with_material([0, 1], SOFT), "selection has no whole cell"),
        (lambda: msd.box((3, 3, 3)).with_material([], SOFT), "it must name one particle at least"),
        (lambda: msd.box((3, 3, 3)).with_material(slice(None), "soft"), "material is 'soft'"),
        (lambda: msd.box((3, 3, 3)).with_material(slice(None), SOFT, area=1.0), r"area is 1\.0; for this part"),
        (lambda: msd.sheet((3, 3)).with_material(slice(None), SOFT), "thickness is None; for a part of a sheet"),
        (lambda: msd.sheet((3, 3), (1, 2)).with_material(slice(None), SOFT, **SHEET), "sides of 1 to 2 m"),
        (
            lambda: msd.sheet((4, 4), bending=1.0).with_material(slice(None), SOFT, **SHEET),
            "a sheet with bending",
        ),
        (lambda: ROD.with_material(slice(None), SOFT, **CHAIN), "part of a rod"),
        (lambda: APART.with_material(slice(None), SOFT, **SHEET), "neighbouring cells are apart"),
        (lambda: msd.shell(msd.icosphere()).with_material(slice(None), SOFT), "no whole cell of a lattice"),
    ],
)
def test_what_has_no_material_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        change()
