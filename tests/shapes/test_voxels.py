"""Voxels: bodies of cells of several materials."""

import numpy as np
import pytest
from elasticity import displacement, stiffness_matrix
from surfaces import area, assert_closed, volume

import msdwarp as msd
from msdwarp import Material, textures, voxel_corners, voxels
from msdwarp.bodies import cells_of

SOFT, HARD = Material(1000.0, 1e5, 0.05), Material(3000.0, 4e5, 0.1)
RUBBERY = Material(1200.0, 3e5, 0.1, poissons_ratio=0.4)
KINDS = {1: SOFT, 2: HARD, 3: RUBBERY}
RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])
FLAT = {"thickness": 0.02}


def same(one: msd.System, other: msd.System, *names: str) -> None:
    for name in names:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, atol=1e-15, err_msg=name)


@pytest.mark.parametrize("material", [SOFT, RUBBERY])
@pytest.mark.parametrize("shape", [(4, 3), (4, 3, 2)])
def test_cells_of_one_material_are_a_box_or_a_sheet(shape, material):
    thickness = FLAT if len(shape) == 2 else {}
    body = voxels(np.full(shape, 2), 0.1, materials={2: material}, **thickness)
    points = tuple(n + 1 for n in shape)
    if len(shape) == 2:
        whole = msd.sheet(points, 0.1, material=material, dim=2, **thickness)
    else:
        whole = msd.box(points, 0.1, material=material)
    same(body, whole, "position", "connections", "mass", "rest_length", "stiffness", "damping")
    assert body.directions == whole.directions
    if material is RUBBERY:
        same(body.cells, whole.cells, "corners", "rest_volume", "modulus", "damping")
    else:
        assert body.cells is None
    np.testing.assert_array_equal(body.group("2"), True)


def test_a_gap_of_one_cell_stays_a_gap():
    ring = voxels(RING, 0.1, materials={1: SOFT}, **FLAT)
    assert ring.mass.sum() == pytest.approx(8 * 0.1**2 * 0.02 * 1000.0, rel=1e-13)
    assert len(cells_of(ring)) == 8
    # Four sides around the gap, but none of its diagonals.
    assert ring.connection_count == 2 * 3 * 4 + 2 * 8
    # Homogeneous strain stores what eight cells store.
    strain = np.array([[0.5, 0.2], [0.2, -0.3]])
    u, whole = (ring.position @ strain).ravel(), msd.sheet((2, 2), 0.1, material=SOFT, dim=2, **FLAT)
    one = (whole.position @ strain).ravel()
    expected = 8 * one @ (stiffness_matrix(whole) @ one)
    assert u @ (stiffness_matrix(ring) @ u) == pytest.approx(expected, rel=1e-12)  # a hundred positive terms
    # Two prongs a cell apart have nothing in common but their handle.
    fork = voxels([[1, 0, 1], [1, 0, 1], [1, 1, 1]], 0.1)
    prongs = [fork.position[fork.connections, 1][:, k] for k in (0, 1)]
    across = (np.abs(prongs[0] - prongs[1]) > 0.05) & (fork.position[fork.connections, 0].mean(axis=1) < 0.04)
    assert set(np.round(np.abs(fork.position[fork.connections[across], 1]).ravel(), 2)) == {0.05, 0.15}
    middle = fork.position[fork.connections, 1].mean(axis=1)[across]
    assert np.abs(middle).min() > 0.09


def test_cells_that_meet_in_a_corner_alone_are_not_joined():
    body = voxels([[1, 1, 1], [1, 0, 1], [0, 1, 1]], 0.1)  # (1, 0) and (2, 1) meet in a corner
    _, times = np.unique(body.position, axis=0, return_counts=True)
    assert sorted(times)[-2:] == [1, 2]
    with pytest.raises(ValueError, match="cells is 2 pieces of which no cells are joined"):
        voxels(np.eye(2, dtype=int))


def test_neighbours_left_out_of_connections_stay_apart():
    body = np.array([[2, 2, 2], [3, 1, 4]])  # as evogym has it, top row first
    pairs = np.array([[0, 1, 0, 1, 2], [1, 2, 3, 4, 5]])  # 3 and 4 touch neither side of 1
    number = np.argsort(np.arange(body.size).reshape(body.shape)[::-1].T.ravel())
    cells, joined = body[::-1].T, number[pairs.T]
    legs = voxels(cells, 0.1, connections=joined)
    whole = voxels(cells, 0.1)
    assert legs.particle_count == whole.particle_count + 2  # at the feet, below both slits
    assert legs.mass.sum() == pytest.approx(whole.mass.sum(), rel=1e-14)
    corners = voxel_corners(cells, connections=joined)
    names = cells[cells > 0]
    assert len(corners) == 6
    shared = [set(corners[names == a].ravel()) & set(corners[names == 1].ravel()) for a in (3, 4)]
    assert [len(one) for one in shared] == [1, 1]  # the upper ends of the slits
    for code in (1, 3, 4):
        assert set(np.flatnonzero(legs.group(str(code)))) == set(voxel_corners(cells, code, connections=joined)[0])
    # Both sides of a slit are free to part: rotating a leg about the slit's end strains nothing but itself.
    simulation = msd.Simulation(legs, gravity=0.0, device="cpu")
    simulation.step()
    assert simulation.measure().largest_strain < 1e-6  # at rest: rounding in float32


def test_layers_side_by_side_share_a_strain():
    # Voigt: the energy of a common homogeneous strain is the sum of the layers', each with its own modulus.
    cells = np.ones((3, 4, 2), dtype=int)
    cells[:, 2:] = 2
    body = voxels(cells, 0.1, materials={1: SOFT, 2: HARD})
    random = np.random.default_rng(3).normal(size=(3, 3))
    strain = (random + random.T) / 2
    u = (body.position @ strain).ravel()
    square, trace = (strain**2).sum(), np.trace(strain)  # ν = 1/4: λ = μ = 2/5 E
    expected = 0.012 * (0.4 * (1e5 + 4e5)) * (trace**2 / 2 + square)
    assert u @ (stiffness_matrix(body) @ u) / 2 == pytest.approx(expected, rel=1e-12)  # as for one material
    assert body.mass.sum() == pytest.approx(0.012 * (1000.0 + 3000.0), rel=1e-13)


def test_a_bar_of_two_materials_has_the_compliance_of_both_in_series():
    cells = np.ones((24, 2, 2), dtype=int)
    cells[12:] = 2
    body = voxels(cells, 0.1, materials={1: SOFT, 2: HARD})
    x = body.position
    ends = x[:, 0] < -1.19, x[:, 0] > 1.19
    share = np.where((np.abs(x[:, 1:]) > 0.05).all(axis=1), 1, 4) // np.where(
        (np.abs(x[:, 1:]) > 0.05).any(axis=1) & (np.abs(x[:, 1:]) < 0.05).any(axis=1), 2, 1
    )
    force, area_of = np.zeros_like(x), 0.2**2
    for end, sign in zip(ends, (-1, 1), strict=True):
        force[end, 0] = sign * share[end] / share[end].sum()
    fixed = []
    for k in range(3):
        one = np.zeros_like(x)
        one[:, k] = 1.0
        fixed.append(one)
    for k, m in ((0, 1), (0, 2), (1, 2)):
        turn = np.zeros_like(x)
        turn[:, k], turn[:, m] = -x[:, m], x[:, k]
        fixed.append(turn)
    moved = displacement(body, force, fixed)[:, 0]
    longer = np.average(moved[ends[1]], weights=share[ends[1]]) - np.average(
        moved[ends[0]], weights=share[ends[0]]
    )
    # At the interface the two would contract differently; that holds within about a width of it. The strain there
    # differs by ν (ε₁ − ε₂), and the bar's length is twelve widths: up to ν²/12 of the whole.
    assert longer == pytest.approx(1.2 / area_of * (1 / 1e5 + 1 / 4e5), rel=0.25**2 / 12)


@pytest.mark.slow
def test_a_body_of_three_materials_keeps_its_energy_and_its_momenta():
    codes = np.random.default_rng(0).integers(1, 4, (5, 4, 3))
    codes[2, 1:3, 1] = 0  # a gap inside
    undamped = {k: Material(one.density, one.youngs_modulus, 0.0, one.poissons_ratio) for k, one in KINDS.items()}
    body = voxels(codes, 0.1, materials=undamped)
    random = np.random.default_rng(1).normal(size=body.position.shape)
    simulation = msd.Simulation(
        body.with_velocity(0.3 * random), gravity=0.0, integrator=msd.RK4(), substeps=64, precision="float64"
    )
    before = simulation.measure()
    simulation.step(20)
    after = simulation.measure()
    energy = [one.kinetic_energy + one.elastic_energy + one.effect_energy for one in (before, after)]
    # 1280 steps of RK4, each of which loses at most (ω h)⁶/72: ω h is 2.83/18, as the step is 1/18 of its limit.
    # Such a step keeps the momentum to rounding, and the angular momentum as it keeps the energy.
    assert after.kinetic_energy < 0.8 * before.kinetic_energy
    assert energy[1] == pytest.approx(energy[0], rel=1280 * (2.83 / 18) ** 6 / 72)
    np.testing.assert_allclose(after.momentum, before.momentum, rtol=0, atol=1e-11)
    np.testing.assert_allclose(after.angular_momentum, before.angular_momentum, rtol=1280 * (2.83 / 18) ** 6 / 72)


def test_a_muscle_is_its_cells_and_not_what_lies_between_them():
    cells = np.array([[3], [1], [3]])
    body = voxels(cells, 0.1)
    chosen = msd.Actuator(0.1, cells=voxel_corners(cells, 3), along="x").connections(body)
    middle = body.position[body.connections[chosen], 0].mean(axis=1)
    np.testing.assert_allclose(np.sort(middle), [-0.1, -0.1, 0.1, 0.1], rtol=1e-12)
    assert len(msd.Actuator(0.1, on="3", along="x").connections(body)) == 6  # all between its particles
    assert len(msd.Actuator(0.1, cells=voxel_corners(cells)[1:2]).connections(body)) == 6
    with pytest.raises(ValueError, match=r"cells is .*; there must be one connection at least"):
        msd.Actuator(0.1, cells=[[0, 7]]).connections(body)
    with pytest.raises(ValueError, match="cells has shape"):
        msd.Actuator(0.1, cells=[0, 1])
    with pytest.raises(ValueError, match=r"cells\[0, 1\] is 70"):
        msd.Actuator(0.1, cells=[[0, 70]]).connections(body)


def test_code_5_is_pinned_unless_it_has_a_material():
    cells = np.array([[5, 2, 2]]).T
    np.testing.assert_array_equal(voxels(cells, 0.1).pinned, voxels(cells, 0.1).group("5"))
    assert not voxels(cells, 0.1, materials={5: SOFT}).pinned.any()


def test_a_solid_shows_its_outside_by_code():
    cells = np.ones((3, 3, 3), dtype=int)
    cells[1, 1, 1:], cells[2] = 0, 7
    body = voxels(cells, 0.1, materials={7: HARD})
    assert_closed(body)
    assert volume(body) == pytest.approx(25 * 0.1**3, rel=1e-12)
    assert area(body) == pytest.approx((6 * 9 - 1 + 9) * 0.1**2, rel=1e-12)
    image = textures.voxels({7: "#ff0000"})
    uv = body.surface.uv[body.surface.triangles].mean(axis=1)
    rows, columns = ((1 - uv[:, 1]) * len(image)).astype(int), (uv[:, 0] * len(image)).astype(int)
    red = (image[rows, columns] == (255, 0, 0)).all(axis=1)
    x = body.surface.points(body.position)[body.surface.triangles][:, :, 0]
    np.testing.assert_array_equal(red, (x > 0.04).all(axis=1))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: voxels([1, 2]), r"cells has shape \(2,\)"),
        (lambda: voxels([[1.5]]), "cells has shape .* type float64"),
        (lambda: voxels([[1, -1]]), r"cells\[0, 1\] is -1; it must be a code of at least 0"),
        (lambda: voxels([[0]]), "cells is 0 everywhere"),
        (lambda: voxels([[1, 9]]), "cells has the code 9; materials must have its material"),
        (lambda: voxels([[1]], materials={0: SOFT}), "materials has the code 0"),
        (lambda: voxels([[1]], materials={1: "soft"}), r"materials\[1\] is 'soft'; it must be a Material"),
        (lambda: voxels([[1]], materials=SOFT), "materials is .*; it must be a Mapping"),
        (lambda: voxels([[1]], 0.0), "spacing is 0"),
        (lambda: voxels([[1]], thickness=-1.0), "thickness is -1"),
        (lambda: voxels([[[1]]], thickness=1.0), r"thickness is 1\.0; for a solid body"),
        (lambda: voxels([[1, 0, 1]], connections=[[0, 2]]), r"connections\[0\] joins \(0, 0\) and \(0, 2\)"),
        (lambda: voxels([[1, 1]], connections=[[0, 2]]), r"connections\[0, 1\] is 2"),
        (lambda: voxel_corners([[1, 2]], 3), "code is 3; it must be one of 1, 2"),
        (lambda: textures.voxels({16: "#ffffff"}), "a code in colors is 16"),
        (lambda: textures.voxels({1: "red"}), "color"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
