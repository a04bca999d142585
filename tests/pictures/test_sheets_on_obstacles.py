"""Sheets on obstacles: particles at 0 mm, triangles that cut edges and curves, and yet nothing shows through."""

import numpy as np
import pytest
from backends import BACKENDS
from scipy.ndimage import binary_erosion

import msdwarp as msd
from msdwarp.bodies import open_edges
from msdwarp.pictures import Drawing
from msdwarp.pictures.sheets import GAP, MOST_PIECES, divided

BOX = msd.Box((0, 0, -0.5), (1, 1, 1))
POST, RADIUS = msd.Capsule((0, 0, -1), (0, 0, -0.2), 0.2), 0.2


def over_a_table(u, v):
    return np.stack([0.8 * u, 0.8 * v, 0 * u], axis=1)


def over_an_edge(u, v):
    return np.stack([np.minimum(u, 0) + 0.5, v, -np.maximum(u, 0)], axis=1)


def over_a_corner(u, v):
    # Where both hang over, it is a cone that stands off the box's vertical edge.
    off = 0.5 * np.minimum(np.maximum(u, 0), np.maximum(v, 0))
    return np.stack(
        [np.minimum(u, 0) + 0.5 + off, np.minimum(v, 0) + 0.5 + off, -np.maximum(np.maximum(u, v), 0)], 1
    )


def over_a_post(u, v):
    """Return points on a post with a round end, as far from its tip as in the flat sheet."""
    way, angle = np.hypot(u, v), np.arctan2(v, u)
    around = np.minimum(way / RADIUS, np.pi / 2)
    down = np.maximum(way - RADIUS * np.pi / 2, 0) + RADIUS * (1 - np.cos(around))
    return np.stack(
        [RADIUS * np.sin(around) * np.cos(angle), RADIUS * np.sin(around) * np.sin(angle), -down], axis=1
    )


def over_a_ball(u, v):
    way, angle = np.hypot(u, v) / 0.5, np.arctan2(v, u)
    return 0.5 * np.stack([np.sin(way) * np.cos(angle), np.sin(way) * np.sin(angle), np.cos(way) - 1], axis=1)


LAID = {
    "table": (over_a_table, BOX),
    "edge": (over_an_edge, BOX),
    "corner": (over_a_corner, BOX),
    "ball": (over_a_ball, msd.Sphere((0, 0, -0.5), 0.5)),
    "post": (over_a_post, POST),
}
VIEW = np.array([(x, y, z) for x in (-0.6, 0.6) for y in (-0.6, 0.6) for z in (-1.2, 0.1)])
"""Corners of a box around all obstacles: the camera keeps it in view, with an obstacle or without."""


def laid(kind: str, size: int, shift: float = 0.0) -> tuple[msd.Scene, np.ndarray]:
    """Return a sheet of 1 m with its particles on an obstacle, and their positions."""
    cloth = msd.sheet((size, size), 1.0 / (size - 1), mass=0.001, stiffness=10.0)
    u, v, _ = (cloth.position - cloth.position.mean(axis=0) + shift / (size - 1)).T
    where, obstacle = LAID[kind]
    look = msd.Look(color="#0000ff", obstacle="#ff0000", gloss=0.0, obstacle_gloss=0.0, azimuth=40, elevation=50)
    position = where(u, v)
    return msd.Scene(system=cloth.replace(position=position), colliders=[obstacle], look=look), position


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", LAID)
@pytest.mark.parametrize("size", [12, pytest.param(24, marks=pytest.mark.slow)])
@pytest.mark.each_value
def test_no_obstacle_shows_through_a_sheet_that_lies_on_it(backend, kind, size):
    scene, position = laid(kind, size, shift=0.3)
    alone = msd.Scene(system=scene.system, colliders=[], look=scene.look)
    how = {"resolution": (800, 800), "backend": backend, "device": "cpu"}
    picture, outline = (msd.Renderer(one, VIEW, **how).image(position).astype(int) for one in (scene, alone))
    # The sheet is drawn off the obstacle by GAP times an eighth of 104 mm at 12 x 12: 3 pixels of 2.7 mm.
    inside = binary_erosion(outline[..., 2] > outline[..., 0] + 40, iterations=5)
    assert inside.sum() > 10_000
    assert not (inside & (picture[..., 0] > picture[..., 2])).any()


def test_a_sheet_is_drawn_outside_an_obstacle_wherever_it_is():
    """The obstacle turns and moves, and a sheet moves with it; then they part."""
    scene, position = laid("edge", 12)
    moving = msd.Box(BOX.position, BOX.size, motion=lambda t: (np.array([t, 0.0, 0.0]), np.array([0.0, 0.0, t])))
    drawing = Drawing(msd.Scene(system=scene.system, colliders=[moving]), "texture")
    turn, shift = moving.pose(0.7, 3)
    drawing.follow(position @ turn.T + shift, 0.7)
    points = (drawing.points.numpy()[drawing.body[0].vertices] - shift) @ turn
    off = np.linalg.norm(np.maximum(np.abs(points - BOX.position) - 0.5, 0), axis=1)
    corners = scene.system.surface.points(position)[scene.system.surface.triangles]
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()
    # Distances of 0.01 m are differences of float32 numbers of about 1 m.
    assert off.min() == pytest.approx(GAP * side / MOST_PIECES, abs=1e-6)
    away = position + np.array([0.0, 0.0, 3.0])
    drawing.follow(away, 0.7)
    drawn = drawing.points.numpy()[drawing.body[0].vertices]
    assert np.abs(drawn[:, None] - away).sum(axis=2).min(axis=0).max() < 1e-5  # a vertex at each particle


def test_a_sheet_stays_where_it_is_pinned_into_an_obstacle():
    cloth = msd.sheet((5, 5), 0.1, mass=0.001, stiffness=10.0)
    rim = cloth.position[:, 0] < 0.05
    rod = msd.Capsule((0, -1, 0), (0, 1, 0), 0.02)
    drawing = Drawing(msd.Scene(system=cloth.pin(rim), colliders=[rod]), "texture")
    drawing.follow(cloth.position)
    drawn = drawing.points.numpy()[drawing.body[0].vertices]
    assert (drawn[:, 0] == 0).sum() == 4 * MOST_PIECES + 1


@pytest.mark.parametrize("pieces", [1, 3])
def test_pieces_of_triangles_cover_them_without_cracks(pieces):
    cloth = msd.sheet((4, 3), 0.1, mass=0.001, stiffness=10.0)
    surface = cloth.surface
    corners, shares, fine = divided(surface.triangles, pieces)
    points = np.einsum("vk,vkd->vd", shares, surface.points(cloth.position)[corners])
    a, b, c = (points[fine[:, k]] for k in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    assert up == pytest.approx(0.01 / pieces**2)  # each piece faces up, as the triangles do
    assert len(up) == pieces**2 * len(surface.triangles)
    assert len(open_edges(fine)) == pieces * len(open_edges(surface.triangles))
