"""The scenes that come with msdwarp: each is short, does what it says, and can be seen."""

import ast
import importlib
from pathlib import Path

import numpy as np
import pytest

import msdwarp as msd

FOLDER = Path(__file__).parents[1] / "scenes"
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))


def build(name, **parameters):
    return importlib.import_module(f"msdwarp.scenes.{name}").build(**parameters)


def simulate(scene, duration, **options):
    options = {"device": "cpu", **options}
    simulation = msd.Simulation(scene.system, gravity=scene.gravity, colliders=scene.colliders, **options)
    return list(simulation.frames(duration))


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_a_short_file_that_says_what_it_shows(name):
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    assert source.count("\n") <= 60
    tree = ast.parse(source)
    assert ast.get_docstring(tree).endswith(".")
    assert "scene_main(build)" in source


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_seen(name):
    scene = build(name)
    position = simulate(scene, 0.1)[-1].position
    image = msd.Renderer(scene, position, resolution=(320, 180)).image(position)
    corner = image[0, 0].astype(int)
    seen = np.abs(image.astype(int) - corner).max(axis=2) > 30
    assert 0.01 < seen.mean() < 0.9  # neither a blank picture nor one that is filled


def test_the_cube_bounces_and_comes_to_rest():
    scene = build("cube")
    frames = simulate(scene, scene.duration)
    height = np.array([frame.position[:, 2].mean() for frame in frames])
    lowest = np.array([frame.position[:, 2].min() for frame in frames])
    touch = int(np.argmax(lowest <= 0.0))
    assert 0 < touch < len(frames)
    assert height[touch:].max() > height[touch] + 0.05  # it leaves the floor again, by centimetres
    assert lowest.min() >= -1e-6  # a particle is put back on the plane, to float32 rounding
    speed = np.sqrt((frames[-1].velocity ** 2).sum(axis=1).mean())
    assert speed < 0.05 * 5.0  # it was thrown on the floor at about 5 m/s
    # On a face it stands half a metre high and sags; on an edge it would be at 0.7.
    assert 0.4 < height[-1] < 0.55


def test_the_cloth_hangs_by_three_points_and_swings():
    scene = build("cloth")
    system = scene.system
    (pins,) = np.nonzero(system.pinned)
    assert len(pins) == 3
    frames = simulate(scene, scene.duration)
    np.testing.assert_array_equal(frames[-1].position[pins], system.position[pins].astype(np.float32))
    y = np.array([frame.position[:31, 1].mean() for frame in frames])  # of the free edge
    swings = np.count_nonzero(np.diff(np.sign(y - system.position[pins, 1].mean())))
    assert swings >= 3
    strain = [system.replace(position=frame.position, velocity=0.0).strain for frame in frames[::20]]
    # Cloth, not rubber: only at the pins, which carry all of it on a few threads, does it stretch further.
    assert np.quantile(strain, 0.99) < 0.15


def test_the_worm_buckles_and_falls():
    scene = build("worm")
    frames = simulate(scene, scene.duration)
    bend = []
    for frame in frames:
        middle = frame.position.reshape(-1, 4, 3).mean(axis=1)
        chord = middle[-1] - middle[0]
        arm = middle - middle[0]
        off = arm - np.outer(arm @ chord / (chord @ chord), chord)
        bend.append(np.linalg.norm(off, axis=1).max())
    standing = [frame.position[:, 2].max() > 1.5 for frame in frames]
    assert max(b for b, s in zip(bend, standing, strict=True) if s) > 0.2  # bent while it stands
    assert frames[-1].position[:, 2].max() < 0.5  # lies


@pytest.mark.gpu
@pytest.mark.parametrize("name", NAMES)
def test_the_gpu_in_float32_agrees_with_the_cpu_in_float64(name):
    scene = build(name)
    size = np.ptp(scene.system.position, axis=0).max()
    substeps = msd.Simulation(scene.system, device="cpu").substeps
    exact = simulate(scene, 0.5, precision="float64", substeps=substeps)
    rounded = simulate(scene, 0.5, device="cuda:0", substeps=substeps)
    for a, b in zip(exact, rounded, strict=True):
        # float32 rounding of 6e-8 a substep, over some 400 of them, grown by the motion
        assert np.abs(a.position - b.position).max() < 1e-4 * size
