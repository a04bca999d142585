"""Surfaces: vertices that are particles or mixtures of them, and points embedded in lattice cells."""

import itertools

import numpy as np
import pytest

from msdwarp import Surface
from msdwarp.shapes.grid import particle_numbers, whole_cells
from msdwarp.shapes.skin import embed

TRIANGLE = {"uv": 0.0, "triangles": [[0, 1, 2]]}


def lattice_of(mask: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return (number, whole cells) of a mask, as `embed` takes them, and the particles' places at spacing 1."""
    grid = particle_numbers(mask.shape, mask), whole_cells(mask)
    return grid, np.argwhere(mask.T)[:, ::-1].astype(float)


def test_vertices_that_are_particles():
    surface = Surface(particle=[2, 0, 1], **TRIANGLE)
    assert surface.weights is None
    assert surface.normal_of is None
    position = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(surface.points(position), position[[2, 0, 1]])


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_vertices_that_are_mixtures(dim):
    surface = Surface(
        particle=[[0, 1], [1, 1], [0, 1]], weights=[[0.25, 0.75], [0.5, 0.5], [2.0, -1.0]], **TRIANGLE
    )
    near, far = np.ones(dim), 5 * np.ones(dim)
    # The last one lies as far before the first particle as the second lies behind it. All is exact in binary.
    np.testing.assert_array_equal(surface.points([near, far]), [4 * near, far, -3 * near])


def test_arrays_are_copies_that_cannot_be_written_to():
    particle, weights, normal_of = np.zeros((3, 2), int), np.full((3, 2), 0.5), np.array([0, 0, 2])
    surface = Surface(particle=particle, weights=weights, normal_of=normal_of, **TRIANGLE)
    for given, own in zip(
        (particle, weights, normal_of), (surface.particle, surface.weights, surface.normal_of), strict=True
    ):
        before = own.copy()
        given[:] = 7
        np.testing.assert_array_equal(own, before)
        with pytest.raises(ValueError, match="read-only"):
            own[:] = 7


def test_behind_pads_the_narrower_mixture():
    position = np.random.default_rng(1).integers(-9, 9, (5, 3)).astype(float)  # sums are exact, in whatever order
    plain = Surface(particle=[0, 1], uv=0.0, triangles=[])
    mixed = Surface(particle=[[0, 1, 2], [2, 1, 0]], weights=[[0.5, 0.25, 0.25], [2, -2, 1]], uv=1.0, triangles=[])
    for first, second, n in ((plain, mixed, 2), (mixed, plain, 3)):
        both = second.behind(first, n)
        assert both.particle.shape == both.weights.shape == (4, 3)
        expected = np.concatenate([first.points(position[:n]), second.points(position[n:])])
        np.testing.assert_array_equal(both.points(position), expected)  # a term of weight 0 adds nothing
        assert both.normal_of is None


def test_behind_joins_shared_normals():
    seam = Surface(particle=[0, 1, 2], normal_of=[0, 0, 2], **TRIANGLE)
    plain = Surface(particle=[0, 1, 2], **TRIANGLE)
    np.testing.assert_array_equal(seam.behind(plain, 3).normal_of, [0, 1, 2, 3, 3, 5])
    np.testing.assert_array_equal(plain.behind(seam, 3).normal_of, [0, 0, 2, 3, 4, 5])
    np.testing.assert_array_equal(seam.behind(plain, 3).triangles, [[0, 1, 2], [3, 4, 5]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"particle": [[0, 1, 2]]}, r"particle has shape \(1, 3\)"),
        ({"uv": np.zeros((2, 2))}, r"uv has shape \(2, 2\)"),
        ({"triangles": [[0, 1, 3]]}, r"triangles\[0, 2\] is 3"),
        ({"triangles": [[0, 1]]}, r"triangles has shape \(1, 2\)"),
        ({"triangles": [[0.0, 1.0, 2.0]]}, "triangles .*whole numbers"),
        ({"particle": [[0, 1]] * 3}, r"weights is None.*of that shape"),
        ({"particle": np.zeros((3, 0), int)}, r"particle has shape \(3, 0\)"),
        ({"particle": [[0.0, 1.0]] * 3}, "particle .*whole numbers"),
        ({"weights": [[1.0]] * 3}, r"weights are given.*\(3,\)"),
        ({"particle": [[0, 1]] * 3, "weights": [[0.5, 0.5, 0.0]] * 3}, r"weights has shape \(3, 3\)"),
        (
            {"particle": [[0, 1]] * 3, "weights": [[0.5, 0.5], [0.5, 0.4], [1, 0]]},
            r"sum of weights\[1\] is 0\.9; it must be 1",
        ),
        ({"particle": [[0, 1]] * 3, "weights": [[np.nan, 0.5]] * 3}, r"weights\[0, 0\] is nan"),
        ({"normal_of": [0, 1]}, r"normal_of has shape \(2,\)"),
        ({"normal_of": [0.0, 1.0, 2.0]}, "normal_of .*whole numbers"),
        ({"normal_of": [0, 1, 3]}, r"normal_of\[2\] is 3.*0 to 2"),
        ({"normal_of": [1, 2, 2]}, r"normal_of\[0\] is 1.*takes its own normal"),
    ],
)
def test_bad_input_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        Surface(**({"particle": [0, 1, 2]} | TRIANGLE | changes))


def test_points_must_have_their_particles():
    surface = Surface(particle=[0, 1, 2], **TRIANGLE)
    with pytest.raises(ValueError, match=r"particle\[2\] is 2.*0 to 1"):
        surface.points(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"position has shape \(3,\)"):
        surface.points(np.zeros(3))


@pytest.mark.parametrize("shape", [(3, 4), (3, 4, 5)])
def test_embedded_points_are_where_they_were(shape):
    grid, place = lattice_of(np.ones(shape, bool))
    points = np.random.default_rng(1).uniform(-0.7, np.array(shape) - 0.3, (200, len(shape)))
    particle, weights = embed(points * 0.5 + 7, *grid, 0.5, [7] * len(shape))
    assert particle.shape == weights.shape == (200, 2 ** len(shape))
    # Weights are products of up to three factors of at most 1.7; 8 terms of at most 5 · 1.7³ each round.
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=0, atol=1e-14)
    found = np.einsum("vk,vkd->vd", weights, place[particle])
    np.testing.assert_allclose(found, points, rtol=0, atol=1e-13)


def test_interpolation_is_linear_along_each_axis():
    grid, place = lattice_of(np.ones((3, 3, 3), bool))
    points = np.random.default_rng(1).uniform(0, 1, (100, 3))
    particle, weights = embed(points, *grid, 1.0, (0, 0, 0))
    product = place.prod(axis=1)  # x y z: linear along each axis, and reproduced within a cell
    np.testing.assert_allclose((weights * product[particle]).sum(axis=1), points.prod(axis=1), rtol=0, atol=1e-15)


@pytest.mark.parametrize("shape", [(7, 6), (6, 5, 7)])
def test_points_go_to_the_nearest_whole_cell(shape):
    random = np.random.default_rng(3)
    mask = random.random(shape) < 0.75
    grid, place = lattice_of(mask)
    points = random.uniform(-2, np.array(shape) + 1, (300, len(shape)))
    particle, weights = embed(points, *grid, 1.0, [0] * len(shape))
    # Against all cells, tried one by one with plain loops.
    cells = np.array(
        [
            cell
            for cell in itertools.product(*(range(n - 1) for n in shape))
            if all(mask[tuple(np.add(cell, step))] for step in itertools.product((0, 1), repeat=len(shape)))
        ]
    )
    assert len(cells) == whole_cells(mask).sum() > 3
    outside = points[:, None] - np.clip(points[:, None], cells, cells + 1)
    least = np.linalg.norm(outside, axis=-1).min(axis=1)
    low = place[particle].min(axis=1)
    np.testing.assert_array_equal(np.ptp(place[particle], axis=1), 1)  # the corners of one cell
    found = np.linalg.norm(points - np.clip(points, low, low + 1), axis=1)
    np.testing.assert_allclose(found, least, rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.einsum("vk,vkd->vd", weights, place[particle]), points, rtol=0, atol=1e-12)


def test_what_cannot_be_embedded():
    grid, _ = lattice_of(np.eye(3, dtype=bool))
    with pytest.raises(ValueError, match="whole is False everywhere"):
        embed([[0.5, 0.5]], *grid, 1.0, (0, 0))
    grid, _ = lattice_of(np.ones((2, 2), bool))
    with pytest.raises(ValueError, match=r"points\[1, 0\] is nan"):
        embed([[0.5, 0.5], [np.nan, 0]], *grid, 1.0, (0, 0))
