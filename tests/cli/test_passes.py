"""Passes for compositing: depths are distances along the view, masks say which body is seen."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from msdwarp import Box, Look, Plane, Scene, Sphere, box
from msdwarp.cli.commands.passes import PassFiles
from msdwarp.cli.picture_options import Pictures
from msdwarp.pictures import Stage

LOOK = Look(azimuth=0.0, elevation=30.0, target=(0.0, 0.0, 0.5), distance=4.0)
"""The camera is at (2 √3, 0, 2.5) and looks along (-√3 / 2, 0, -1 / 2)."""


def read(folder, scene, **options):
    pictures = Pictures(passes=("depth", "mask"), **options)
    stage, position = Stage(scene, scene.system.position, (160, 90)), scene.system.position
    PassFiles(scene, "texture", stage, pictures, folder).write(7, (position, 0.0, None, None))
    with Image.open(folder / "depth_0007.tif") as depth, Image.open(folder / "mask_0007.png") as mask:
        found = np.asarray(depth), np.asarray(mask)
    return *found, json.loads((folder / "masks.json").read_text()), stage.camera


def at(camera, point):
    row, column = camera.pixels(np.array([point]), 90, 160)
    return int(row[0]), int(column[0])


def test_depths_and_bodies_are_those_in_front_of_the_camera(tmp_path):
    cube = box((2, 2, 2), 0.4).translate((0.0, 0.9, 0.6)).named("cube")
    scene = Scene(system=cube, colliders=[Plane(), Sphere((0, 0, 0.5), 0.3)], look=LOOK)
    depth, mask, names, camera = read(tmp_path, scene)
    assert names == {"1": "cube", "2": "obstacle"}
    along = np.array([-np.sqrt(3) / 2, 0.0, -0.5])
    eye = np.array([0.0, 0.0, 0.5]) - 4.0 * along
    top, ground = np.array([0.1, 0.9, 0.8]), np.array([0.5, -0.8, 0.0])  # in a face of the cube, and of the floor
    middle = np.array([0.0, 0.0, 0.5]) - 0.3 * along
    # A pixel is 0.024 m high at 4 m: on what lies flat, seen at 30°, depth changes by 0.042 m within it, in the
    # middle of the ball by 0.001 m.
    for point, body, most in ((top, 1, 0.042), (middle, 2, 0.002), (ground, 0, 0.042)):
        assert mask[at(camera, point)] == body
        assert depth[at(camera, point)] == pytest.approx((point - eye) @ along, abs=most)
    depth, mask, names, _ = read(tmp_path, Scene(system=cube, look=LOOK), body=("cube",))
    assert names == {"1": "cube"}
    np.testing.assert_array_equal(mask == 0, depth == 1e10)  # no ground


def test_a_section_has_the_depth_and_the_number_of_its_body(tmp_path):
    cube = box((3, 3, 3), 0.3).translate((0.0, 0.0, 0.5)).named("cube")
    depth, mask, names, camera = read(tmp_path, Scene(system=cube, look=replace(LOOK, cut=Plane((1, 0, 0)))))
    assert names == {"1": "cube"}
    along = np.array([-np.sqrt(3) / 2, 0.0, -0.5])
    for point in np.array([[0.0, 0.0, 0.5], [0.0, 0.15, 0.6]]):
        assert mask[at(camera, point)] == 1
        # A pixel is 0.024 m high at 4 m: what stands upright, seen at 30°, changes by 0.014 m in it.
        expected = (point - np.array([0.0, 0.0, 0.5]) + 4.0 * along) @ along
        assert depth[at(camera, point)] == pytest.approx(expected, abs=0.014)


def test_what_a_ground_hides_is_not_seen(tmp_path):
    cube = box((2, 2, 2), 0.4).translate((0.0, 0.0, -0.6))
    _, mask, _, _ = read(
        tmp_path, Scene(system=cube, colliders=[Plane(), Box((0, 1, 1), (0.2, 0.2, 0.2))], look=LOOK)
    )
    assert set(np.unique(mask)) == {0, 2}
