"""Cloths of any outline: their area, their corners and their narrow parts."""

import math

import numpy as np
import pytest
from surfaces import area_vectors

import msdwarp as msd


def polygon_area(outline: np.ndarray) -> float:
    """Return the area of a simple polygon: the shoelace formula."""
    x, y = np.asarray(outline, dtype=float).T
    return abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def star(points: int, inner: float) -> np.ndarray:
    """Return a star with tips 1 from the middle."""
    angle = np.arange(2 * points) * math.pi / points
    return np.where(np.arange(2 * points) % 2, inner, 1.0)[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=1
    )


TURN = np.array([[0.8, 0.6], [-0.6, 0.8]])
OUTLINES = {
    "rectangle": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]]),
    "clockwise": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]])[::-1],
    "turned": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]]) @ TURN + (3, -5),
    "corner": np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4]]) @ TURN,
    "star": star(5, 0.4),
    "dumbbell": np.transpose(
        [[0, 1, 1, 3, 3, 4, 4, 3, 3, 1, 1, 0], [0, 0, 0.45, 0.45, 0, 0, 1, 1, 0.5, 0.5, 1, 1]]
    ),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_a_cloth_has_the_area_and_the_corners_of_its_outline(name):
    outline = np.asarray(OUTLINES[name])
    system = msd.cloth(outline, 0.1)
    facing = area_vectors(system)
    # Its margin is on the outline, and so are all its corners.
    assert facing[:, 2].sum() == pytest.approx(polygon_area(outline), rel=1e-12)
    assert (facing[:, 2] >= -1e-16).all()
    assert not facing[:, :2].any()
    points = system.surface.points(system.position)
    nearest = np.linalg.norm(points[:, None, :2] - outline, axis=-1).min(axis=0)
    assert nearest.max() < 1e-14
    extent = np.ptp(outline, axis=0)
    expected = (points[:, :2] - outline.min(axis=0)) / extent
    np.testing.assert_allclose(system.surface.uv, expected, rtol=0, atol=1e-13)


def test_a_round_cloth():
    angle = np.arange(400) * math.tau / 400
    outline = 0.5 + np.stack([np.cos(angle), np.sin(angle)], axis=1)
    missing = []
    for spacing in (0.2, 0.1, 0.05):
        system = msd.cloth(outline, spacing)
        missing.append(1 - np.linalg.norm(area_vectors(system), axis=1).sum() / polygon_area(outline))
        particles = math.pi / spacing**2
        assert system.particle_count == pytest.approx(particles, abs=math.tau / spacing)
    # Chords of at most 1.5 fine steps s are away from a circle by (1.5 s)²/8, and that on average less.
    assert 0 < missing[0] < (1.5 * 0.05) ** 2 / 4
    assert missing[2] < missing[1] / 2 < missing[0] / 4


def test_a_rectangular_cloth_is_a_sheet():
    system = msd.cloth([[0, 0], [0.8, 0], [0.8, 0.5], [0, 0.5], [0, 0]], 0.1, mass=0.2)
    expected = msd.sheet((9, 6), 0.1, mass=0.2).translate((0.4, 0.25, 0))
    np.testing.assert_array_equal(system.connections, expected.connections)
    np.testing.assert_allclose(system.position, expected.position, rtol=0, atol=1e-16)
    assert len(system.surface.triangles) == 8 * 5 * 16 * 2


def test_a_cloth_of_a_material_weighs_what_it_should():
    system = msd.cloth(star(5, 0.5), 0.02, material=msd.COTTON, thickness=0.001)
    expected = msd.COTTON.density * 0.001 * polygon_area(star(5, 0.5))
    # Cells along the margin cancel but for the tips: measured 0.2 %.
    assert system.mass.sum() == pytest.approx(expected, rel=0.01)


def test_a_flat_cloth_in_two_coordinates():
    system = msd.cloth(star(5, 0.4), 0.1, dim=2, neighbors=4)
    assert system.dim == 2
    assert system.surface.points(system.position).shape[1] == 2
    assert set(system.directions[0]) == {"x", "y"}


@pytest.mark.parametrize("width", [0.05, 0.02, 0.003])
def test_narrow_parts_of_a_cloth_hold_together(width):
    outline = np.array([[0, 0], [5, 1], [5, 1 + width], [0, width]])
    system = msd.cloth(outline, 0.1)
    # A cell wide, and as long as it should be; what is drawn is as narrow as the outline.
    np.testing.assert_allclose(np.ptp(system.position, axis=0), (5, 1, 0), rtol=0, atol=0.2)
    drawn = np.abs(area_vectors(system)[:, 2]).sum()
    assert drawn == pytest.approx(polygon_area(outline), rel=0.06)


@pytest.mark.parametrize("spacing", [0.3, 0.1, 0.03])
def test_acute_tips_of_a_cloth_hold_together(spacing):
    system = msd.cloth(star(9, 0.2), spacing)
    points = system.surface.points(system.position)[:, :2]
    tips = star(9, 0.2)[::2]
    # Thinner than anything that is drawn, but there: to a fine step.
    assert np.linalg.norm(points[:, None] - tips, axis=-1).min(axis=0).max() < spacing / 4
