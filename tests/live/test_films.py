"""Films that Python writes: of frames, a trajectory, a scene and a simulation."""

import numpy as np
import pytest
from PIL import Image

import msdwarp as msd

SMALL: dict = {"resolution": (96, 64)}


def scene() -> msd.Scene:
    block = msd.box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.3).translate((0, 0, 0.2))
    return msd.Scene(system=block, colliders=[msd.Plane()], duration=0.05)


def pictures(path) -> list:
    with Image.open(path) as film:
        found = []
        for k in range(getattr(film, "n_frames", 1)):
            film.seek(k)
            found.append(np.asarray(film.convert("RGB")))
        return found


def test_films_of_frames_of_a_simulation_and_of_a_file_are_alike(tmp_path):
    simulation = msd.Simulation(scene(), device="cpu")
    with msd.TrajectoryWriter(tmp_path / "t.vtkhdf", simulation.system, fps=60) as writer:
        frames = []
        for frame in simulation.frames(0.05):
            writer.write(frame)
            frames.append(frame)
    path = msd.film(frames, tmp_path / "new" / "frames.webp", scene=scene(), **SMALL)
    assert path == tmp_path / "new" / "frames.webp"
    of_frames = pictures(path)
    assert len(of_frames) == 4
    assert of_frames[0].std() > 5  # not blank
    simulation.reset()
    of_run = pictures(msd.film(simulation, tmp_path / "run.webp", duration=0.05, **SMALL))
    assert simulation.frame_index == len(of_run) - 1 == 2  # the first picture is of the start
    of_file = pictures(msd.film(str(tmp_path / "t.vtkhdf"), tmp_path / "file.webp", fps=10, **SMALL))
    assert len(of_file) == 4
    of_scene = pictures(msd.film(scene(), tmp_path / "scene.gif", fps=20, **SMALL))
    assert len(of_scene) == 3


@pytest.mark.parametrize(
    ("shown", "path", "how", "told"),
    [
        ("frames", "a.webp", {}, "scene is None; it must be a Scene"),
        ("none", "a.webp", {"scene": scene()}, "shown has no frames"),
        ("simulation", "a.webp", {}, "duration is None; a simulation keeps no frames"),
        ("scene", "a.avi", {}, "the end of path is '.avi'; it must be one of '.webp', '.mp4', '.gif'"),
        ("scene", "a.webp", {"fps": 0}, "fps is 0"),
        ("scene", "a.webp", {"duration": -1.0}, "duration is -1"),
        ("scene", "a.webp", {"scene": scene()}, "scene is given; it must be None"),
        ("frames", "a.webp", {"scene": scene(), "duration": 1.0}, "duration is 1; it must be None"),
        ("three", "a.webp", {}, "shown is 3"),
    ],
)
def test_what_cannot_be_filmed_is_named(tmp_path, shown, path, how, told):
    simulation = msd.Simulation(scene(), device="cpu")
    what = {"frames": [simulation.frame()], "none": [], "simulation": simulation, "scene": scene(), "three": 3}
    with pytest.raises(ValueError, match=told.replace("(", r"\(")):
        msd.film(what[shown], tmp_path / path, **how)
    assert not list(tmp_path.iterdir())
