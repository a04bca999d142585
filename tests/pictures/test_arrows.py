"""Arrows of forces: as long as these are large, from their particles on, and seen through what is in front."""

import numpy as np
import pytest
from backends import BACKENDS

import msdwarp as msd
from msdwarp.pictures.arrows import COLOR, LONGEST

SIZE = (640, 480)


@pytest.fixture(scope="module")
def scene() -> msd.Scene:
    """A red cube, seen horizontally along y."""
    cube = msd.box((5, 5, 5), 0.1, mass=0.1, stiffness=100.0)
    return msd.Scene(system=cube, look=msd.Look(color="#c02020", azimuth=-90.0, elevation=0.0, gloss=0.0))


def pixels_of_arrows(image) -> np.ndarray:
    """Return rows and columns of the pixels in the arrows' hue, the legend left out, shape [any, 2]."""
    color = image.astype(float)
    green_over_red = (color[..., 1] > 2 * color[..., 0] + 20) & (COLOR[1] > 2 * COLOR[0])
    green_over_red[:60, :240] = False
    return np.argwhere(green_over_red)


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_arrow_goes_from_its_particle_along_the_force(scene, backend):
    x = scene.system.position
    renderer = msd.Renderer(scene, x, resolution=SIZE, backend=backend, arrows=10.0)
    plain = renderer.image(x)
    assert not len(pixels_of_arrows(plain))
    middle = int(np.argmin((x**2).sum(axis=1)))  # within the cube: nothing of it is seen but arrows
    for force, along, share in (
        ((5.0, 0, 0), (1, 0), 0.5),
        ((0, 0, 50.0), (0, -1), 1.0),
        ((0, 0, -8.0), (0, 1), 0.8),
    ):
        forces = np.zeros_like(x)
        forces[middle] = force
        found = pixels_of_arrows(renderer.image(x, forces=forces))
        camera = renderer.stage.camera
        row, column = (float(one[0]) for one in camera.pixels(x[[middle]], *SIZE[::-1]))
        way = (found[:, ::-1] - (column, row)) @ np.array(along, dtype=float)
        # The middle of the cube is where the camera looks at, to 1 % of its distance. The last pixels of a tip, a
        # cone of 16°, are covered by less than half of them.
        assert way.max() == pytest.approx(share * LONGEST * SIZE[1], abs=5)
        assert way.min() == pytest.approx(0.0, abs=2.5)
    # The next picture has none of it.
    np.testing.assert_array_equal(renderer.image(x), plain)


@pytest.mark.parametrize("backend", BACKENDS)
def test_arrows_cast_no_shadow_and_faint_ones_are_left_out(backend):
    cube = msd.box((3, 3, 3), 0.1, mass=0.1, stiffness=100.0).translate((0, 0, 0.1))
    scene = msd.Scene(system=cube, colliders=[msd.Plane()])
    x = cube.position
    renderer = msd.Renderer(scene, x, resolution=SIZE, backend=backend, arrows=1.0)
    forces = np.zeros_like(x)
    forces[:, 2] = 0.01
    np.testing.assert_array_equal(renderer.image(x, forces=forces), renderer.image(x))


def test_the_largest_are_drawn_where_there_are_many(monkeypatch, scene):
    monkeypatch.setattr("msdwarp.pictures.arrows.MOST_ARROWS", 1)
    x = scene.system.position
    renderer = msd.Renderer(scene, x, resolution=SIZE, backend="raycast", arrows=1.0)
    both, one = np.zeros((2, *x.shape))
    both[0], both[62] = (0.5, 0, 0), (0, 0, 1.0)
    one[62] = both[62]
    np.testing.assert_array_equal(renderer.image(x, forces=both), renderer.image(x, forces=one))


def test_wrong_forces_are_refused(scene):
    x = scene.system.position
    with pytest.raises(ValueError, match="arrows is -1"):
        msd.Renderer(scene, x, resolution=SIZE, backend="raycast", arrows=-1.0)
    plain = msd.Renderer(scene, x, resolution=SIZE, backend="raycast")
    with pytest.raises(ValueError, match="forces is given; it must be None unless"):
        plain.image(x, forces=np.zeros_like(x))
    renderer = msd.Renderer(scene, x, resolution=SIZE, backend="raycast", arrows=1.0)
    with pytest.raises(ValueError, match=r"forces has shape \(2, 3\); it must be \(125, 3\)"):
        renderer.image(x, forces=np.zeros((2, 3)))
    with pytest.raises(ValueError, match="forces"):
        renderer.image(x, forces=np.full_like(x, np.nan))
