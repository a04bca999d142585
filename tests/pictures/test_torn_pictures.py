"""Pictures leave out what is broken, from the frame behind the break on."""

import numpy as np
import pytest

from msdwarp import Look, Scene, box, chain, sheet
from msdwarp.pictures.drawing import MOST_TUBES, Drawing
from msdwarp.pictures.dressing import outermost_connections


def drawn(system, coloring="texture", **look) -> Drawing:
    return Drawing(Scene(system=system, look=Look(**look)), coloring)


def areas(drawing: Drawing, triangles: slice) -> np.ndarray:
    a, b, c = np.moveaxis(drawing.points.numpy()[drawing.triangles[triangles]], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@pytest.mark.parametrize("smooth", [True, False])
def test_triangles_along_a_tear_go(smooth):
    whole = sheet((5, 4), 0.1)
    assert whole.surface is not None
    across = np.diff(whole.position[whole.connections][:, :, 0] > 0.05, axis=1)[:, 0]
    torn = whole.replace(broken_at=np.where(across, 1.5, np.inf))
    drawing, count = drawn(torn, smooth=smooth), len(whole.surface.triangles)
    for time, gone in ((0.0, 0), (1.5, 0), (1.6, 6)):  # of 4 · 3 squares those 3 that the tear goes through
        drawing.follow(torn.position, time)
        area = areas(drawing, slice(0, count))
        assert (area == 0).sum() == gone
        np.testing.assert_allclose(area[area > 0], 0.005, rtol=1e-5)  # float32
        # What is flat has one normal everywhere, tear or not.
        used = np.unique(drawing.triangles[:count][area > 0])
        np.testing.assert_allclose(
            np.abs(drawing.normals.numpy()[used]), np.tile([0, 0, 1], (len(used), 1)), atol=1e-6
        )


def test_a_tear_changes_nothing_where_it_is_not():
    whole = sheet((5, 4), 0.1)
    bent = whole.position + np.outer(np.sin(9 * whole.position[:, 0]), (0.0, 0.0, 0.05))
    weak = drawn(whole.replace(break_strain=9.0), smooth=True)
    plain = drawn(whole, smooth=True)
    for drawing in (weak, plain):
        drawing.follow(bent)
    for name in ("points", "normals"):
        one, other = (getattr(each, name).numpy()[each.triangles] for each in (weak, plain))
        np.testing.assert_allclose(one, other, atol=1e-6)  # sums of normals in float32


def test_broken_tubes_are_not_drawn():
    row = chain(4, 0.1).replace(broken_at=[np.inf, 0.0, 1.0])
    drawing = drawn(row)
    for time, seen in ((0.0, [True, False, True]), (1.1, [True, False, False])):
        drawing.follow(row.position, time)
        extent = np.ptp(drawing.points.numpy()[: 6 * 3].reshape(3, 6, 3), axis=1).max(axis=1)
        assert (extent > 0).tolist() == seen


def test_a_rope_beside_a_solid_of_many_springs_shows_its_strain():
    solid, rope = box((13, 13, 13), 0.1), chain(5, 0.1).translate((0, 0, 2))
    both, count = solid + rope, solid.connection_count
    assert count > MOST_TUBES  # of so many only those outside are drawn
    chosen = outermost_connections(both, np.ones(both.connection_count, dtype=bool))
    np.testing.assert_array_equal(chosen[:count], outermost_connections(solid, np.ones(count, dtype=bool)))
    assert chosen[count:].all()
    assert 0 < chosen[:count].sum() < count
