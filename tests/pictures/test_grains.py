"""Single particles in pictures: balls of the size at which they touch."""

import numpy as np
import pytest
from backends import BACKENDS

import msdwarp as msd
from msdwarp.pictures.drawing import INK, ColorScale, Drawing
from msdwarp.pictures.dressing import size_of_grains

SAND = msd.System(position=[[0, 0, 1.0], [0.5, 0, 1.0], [0, 0.6, 1.0]], mass=0.1).named("sand")
STONE = msd.System(position=[[0, 0, 2.0]], mass=5.0).named("stone")
OTHERS = msd.box((3, 3, 3), 0.1).named("block") + msd.chain(4, 0.1).translate((1, 0, 0)).named("rope")
CONTACT = [
    msd.Contact(thickness=0.1, stiffness=1e3),
    msd.Contact(groups=("stone", "stone"), thickness=0.3, stiffness=1e3),
    msd.Contact(groups=("stone", "sand"), thickness=0.2, stiffness=1e3),
]


def balls(scene: msd.Scene, coloring: str | ColorScale = "texture"):
    """Return the centres, radii and colors of the vertices of single particles, by group of looks."""
    drawing = Drawing(scene, coloring)
    values = np.arange(scene.system.particle_count) if drawing.by_value else None
    drawing.follow(scene.system.position, values=values)
    found = {}
    for part in (one for one in drawing.body if one.is_one_body):
        centre = scene.system.position[part.mixture[0].numpy()[:, 0]]
        reach = np.linalg.norm(part.points.numpy() - centre, axis=1)
        found.setdefault(part.name, []).append((centre, reach, part.colors.numpy()))
    return {name: [np.concatenate(one) for one in zip(*parts, strict=True)] for name, parts in found.items()}


@pytest.mark.parametrize("others", [False, True])
def test_they_are_as_large_as_in_contact_and_colored_as_other_bodies(others):
    system = OTHERS + SAND + STONE if others else SAND + STONE
    looks = {"sand": msd.Look(color="#c9a227"), "stone": msd.Look(color="#203040")}
    scene = msd.Scene(system=system, contact=CONTACT, looks=looks)
    found = balls(scene)
    assert found.keys() == looks.keys()
    for name, part, radius, color in (
        ("sand", SAND, 0.05, (0xC9, 0xA2, 0x27)),
        ("stone", STONE, 0.15, (0x20, 0x30, 0x40)),
    ):
        centre, reach, colors = found[name]
        assert {tuple(one) for one in centre} == {tuple(one) for one in part.position}
        np.testing.assert_allclose(reach, radius, rtol=1e-5)  # positions of 2 m in float32
        np.testing.assert_allclose(colors, np.broadcast_to(color, colors.shape) / np.array(255), rtol=0, atol=1e-6)
    by_value = balls(scene, ColorScale("number", 50.0))
    assert len(np.unique(by_value["sand"][2], axis=0)) == 3
    if others:  # beside springs that show strain they show none
        assert np.allclose(balls(scene, "strain")["sand"][2], INK)


def test_where_nothing_says_their_size_they_fit_between_each_other():
    water = np.cbrt(0.1 / 1000 * 3 / (4 * np.pi))
    assert size_of_grains(SAND, np.ones(3, bool)) == pytest.approx(water)
    near = SAND.replace(position=0.02 * SAND.position)
    assert size_of_grains(near, np.ones(3, bool)) == pytest.approx(0.5 * 0.02 * 0.5)  # the median of 10, 10, 12 mm
    for alone in (STONE, STONE.pin(0), STONE + STONE.translate((0, 0, 0))):
        reach = balls(msd.Scene(system=alone))["body"][1]
        assert 0.01 < reach.min() <= reach.max() < 0.2
    assert balls(msd.Scene(system=SAND, look=msd.Look(tube=0.2)))["body"][1] == pytest.approx(0.2, rel=1e-5)


def test_a_rope_with_a_thickness_is_drawn_as_thick():
    scene = msd.Scene(system=OTHERS, contact=msd.Contact(thickness=0.03))
    tubes = next(part for part in Drawing(scene, "texture").body if part.of_rope)
    assert tubes.radius == pytest.approx(0.015)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_grain_is_a_disc_in_a_picture(backend):
    scene = msd.Scene(system=msd.System(position=[[0, 0, 1.0]], mass=1.0), look=msd.Look(color="#d01010"))
    points = scene.system.position + 0.1 * np.concatenate([np.eye(3), -np.eye(3)])
    image = msd.Renderer(scene, points, resolution=(160, 120), backend=backend).image(scene.system.position)
    red = image[..., 0].astype(int) > image[..., 1:].max(axis=2).astype(int) + 40
    rows, columns = np.nonzero(red)
    wide, high = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert wide > 20
    assert abs(wide - high) <= 2  # a pixel at each side
    assert red.sum() == pytest.approx(np.pi / 4 * wide * high, rel=0.06)  # of 20 pixels or more
