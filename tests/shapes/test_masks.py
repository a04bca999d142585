"""Lattices of any form: what a mask leaves of a sheet or a box, in one piece."""

import itertools

import numpy as np
import problems
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from surfaces import areas

from msdwarp import Surface, box, lattice, sheet
from msdwarp.bodies import connectivity
from msdwarp.shapes.grid import count_pieces


def blob(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return a mask in one piece: the points within a spacing of a random walk."""
    random = np.random.default_rng(seed)
    mask = np.zeros(shape, dtype=bool)
    point = np.array(shape) // 2
    for _ in range(6 * max(shape)):
        mask[tuple(slice(max(0, p - 1), p + 1) for p in point)] = True
        point = np.clip(point + random.integers(-1, 2, len(shape)), 0, np.array(shape) - 1)
    return mask


MASKS = [blob(seed, shape) for seed, shape in enumerate([(5, 6), (9, 4), (4, 5, 6), (7, 3, 5), (9, 9, 9)])]


@pytest.mark.parametrize("mask", MASKS)
def test_a_lattice_is_what_its_mask_leaves_of_a_box(mask):
    make, neighbours = (sheet, 8) if mask.ndim == 2 else (box, 26)
    whole = make(mask.shape, 0.5, neighbors=neighbours)
    expected, found = problems.cut(whole, mask.ravel(order="F")), lattice(mask, 0.5)
    assert not mask.all()
    for name in ("position", "connections", "rest_length"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.directions == expected.directions


@pytest.mark.parametrize("mask", MASKS)
def test_the_surface_of_a_lattice_encloses_its_whole_cells(mask):
    system = lattice(mask, 1.0)
    corners = itertools.product((0, 1), repeat=mask.ndim)
    cells = [tuple(slice(c, n - 1 + c) for c, n in zip(corner, mask.shape, strict=True)) for corner in corners]
    cell_count = np.logical_and.reduce([mask[cell] for cell in cells]).sum()
    triangles = system.position[system.surface.particle[system.surface.triangles]]
    assert cell_count > 3
    if mask.ndim == 2:
        # Lattice points at halves of whole numbers: areas are exact.
        assert (areas(system) == (0, 0, 0.5)).all()
        assert len(triangles) == 2 * cell_count
    else:
        # By the divergence theorem; a triangle that is missing or inside out would change it.
        signed = np.linalg.det(triangles).sum() / 6
        assert signed == pytest.approx(cell_count, rel=1e-12)  # some hundred sums of size 1
        # Every edge is walked as often in one direction as in the other: no hole.
        particles = system.surface.particle[system.surface.triangles]
        edges = np.concatenate([particles[:, [0, 1]], particles[:, [1, 2]], particles[:, [2, 0]]])
        there, ways = np.unique(edges, axis=0, return_counts=True)
        back, ways_back = np.unique(edges[:, ::-1], axis=0, return_counts=True)
        np.testing.assert_array_equal(there, back)
        np.testing.assert_array_equal(ways, ways_back)


def test_texture_coordinates_of_a_lattice_are_a_view_of_each_side():
    mask = np.zeros((5, 5, 5), dtype=bool)
    mask[1:4, 1:4, 1:4] = True
    mask[2:, 1:3, 0:2] = True
    system = lattice(mask)
    surface, whole = system.surface, box((5, 5, 5)).surface
    # Each triangle of the same direction as a face of the box, and of the same place on it, has its texture.
    around = box((5, 5, 5)).position
    views = {}
    for triangle, area in zip(whole.triangles, areas(box((5, 5, 5))), strict=True):
        for vertex in triangle:
            seen = np.where(area == 0, around[whole.particle[vertex]], 9.0)
            views[(*np.sign(area), *seen)] = whole.uv[vertex]
    for triangle, area in zip(surface.triangles, areas(system), strict=True):
        for vertex in triangle:
            seen = np.where(area == 0, system.position[surface.particle[vertex]], 9.0)
            np.testing.assert_array_equal(surface.uv[vertex], views[(*np.sign(area), *seen)])


def test_a_lattice_may_have_another_surface_or_none():
    bar = np.zeros((4, 1, 1), dtype=bool)
    bar[:3] = True
    system = lattice(bar)
    assert system.surface is None  # no cell is whole
    np.testing.assert_array_equal(system.connections, [[0, 1], [1, 2]])
    np.testing.assert_array_equal(system.position, [[-1.5, 0, 0], [-0.5, 0, 0], [0.5, 0, 0]])
    own = Surface(particle=[0, 1, 2], uv=np.zeros((3, 2)), triangles=[[0, 1, 2]])
    assert lattice(bar, surface=own).surface is own


@pytest.mark.parametrize("block", [7, 1 << 20])
@pytest.mark.parametrize("seed", range(8))
def test_pieces_are_counted(seed, block, monkeypatch):
    # Against SciPy, on as many random connections as leave between one and many pieces; a few at a time, or all.
    monkeypatch.setattr(connectivity, "_BLOCK", block)
    random = np.random.default_rng(seed)
    n = 60
    connections = random.integers(0, n, (10 + 10 * seed, 2), dtype=np.int32)
    connections = connections[connections[:, 0] != connections[:, 1]]
    ones = np.ones(len(connections))
    expected, _ = connected_components(coo_matrix((ones, connections.T), (n, n)), directed=False)
    assert count_pieces(n, connections) == expected


def test_pieces_of_a_long_chain_in_random_order():
    # The worst for pointers: each piece is a path of thousands.
    order = np.random.default_rng(1).permutation(9000).astype(np.int32)
    connections = np.stack([order[:-1], order[1:]], axis=1)
    assert count_pieces(9000, connections) == 1
    assert count_pieces(9000, np.delete(connections, [100, 4000], axis=0)) == 3


def two_cubes() -> np.ndarray:
    """Return a mask of two cubes, two spacings apart."""
    mask = np.zeros((6, 2, 2), dtype=bool)
    mask[:2], mask[4:] = True, True
    return mask


def cube_and_point() -> np.ndarray:
    """Return a mask of a cube and a point far from it."""
    mask = np.zeros((5, 4, 4), dtype=bool)
    mask[:2, :2, :2], mask[4, 1, 3] = True, True
    return mask


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lattice(np.ones((2, 2))), r"mask has shape \(2, 2\) and type float64; it must hold True and"),
        (lambda: lattice(np.ones(4, dtype=bool)), r"mask has shape \(4,\) and type bool"),
        (lambda: lattice([[True, True], [True]]), r"mask must be an array of True and False"),
        (lambda: lattice(np.zeros((2, 2, 2), dtype=bool)), "mask is False everywhere"),
        (lambda: lattice(cube_and_point()), r"mask\[4, 1, 3\] is True, but none of its neighbours is"),
        (lambda: lattice(two_cubes()), "mask is 2 pieces"),
        (lambda: lattice(np.eye(3, dtype=bool), neighbors=4), r"mask\[0, 0\] is True, but none"),
        (lambda: lattice(np.ones((2, 2), dtype=bool), neighbors=26), "neighbors is 26; it must be one of 8, 4"),
        (lambda: lattice(np.ones((2, 2, 2), dtype=bool), neighbors=8), "neighbors is 8; it must be one of 26"),
        (lambda: lattice(np.ones((2, 2, 2), dtype=bool), dim=2), "dim is 2; it must be one of 3"),
        (lambda: lattice(np.ones((2, 2), dtype=bool), dim=1), "dim is 1; it must be one of 2, 3"),
    ],
)
def test_bad_lattices_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
