"""A live view leaves out what is broken, whatever is beside it."""

import numpy as np
import pytest

from msdwarp import Scene, ball, sheet
from msdwarp.bodies.frame import Frame
from msdwarp.live.shown import Shown


@pytest.fixture
def torn():
    """Return a scene of a sheet and a ball, when its springs broke [s], and the frame when halves are apart."""
    cloth = sheet((5, 4), 0.1)
    body = cloth.replace(break_strain=1.0) + ball(0.2, 0.1).translate((0, 0, 1))
    right = (body.position[:, 0] > 0.05) & (np.arange(body.particle_count) < cloth.particle_count)
    broken_at = np.where(np.diff(right[body.connections], axis=1)[:, 0], 0.01, np.inf)
    apart = body.position + right[:, None] * [1.0, 0.0, 0.0]
    return Scene(system=body), broken_at, Frame(0.02, apart, body.velocity)


def test_a_torn_sheet_is_drawn_torn_beside_a_ball(torn):
    scene, broken_at, frame = torn
    shown = Shown(scene).torn(broken_at, frame.time)
    shown.follow(frame)
    places = shown.drawing.points.numpy()[shown.drawing.triangles]
    assert np.ptp(places, axis=1).max() < 0.15  # nothing spans the gap of a metre; cells are 0.1 m wide


def test_colors_of_strain_are_of_whole_springs(torn):
    scene, broken_at, frame = torn
    shown = Shown(scene, "strain")
    shown.follow(frame._replace(position=scene.system.position, time=0.0))
    shown = shown.torn(broken_at, frame.time)
    shown.follow(frame)
    assert shown._values(frame).max() < 1e-12  # rounding: all others have their rest lengths
