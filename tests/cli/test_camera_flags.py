"""Where the camera stands and what of a run is drawn: flags of `run` and `render`."""

import json

import numpy as np
import pytest
from PIL import Image

from msdwarp import Look, Trajectory
from msdwarp.cli.commands.moments import frames_shown
from msdwarp.cli.options import Options
from msdwarp.cli.picture_options import Pictures
from msdwarp.cli.provenance import restored_options

SMALL = ("--resolution", "128x72", "--device", "cpu")
FRAMES = 13  # of 0.2 s


@pytest.fixture
def cube(msdwarp, tmp_path):
    """The folder of a short run that has drawn nothing."""
    undrawn = ("--frames", "none", "--video", "none", "--device", "cpu")
    assert msdwarp("run", "cube", "--size", "3", "--duration", "0.2", *undrawn)[0] == 0
    return tmp_path / "out" / "cube"


def durations(path):
    """Return how long each picture of a film is shown [ms], and the first one."""
    with Image.open(path) as film:
        first = np.asarray(film.convert("RGB")).astype(int)
        shown = []
        for k in range(film.n_frames):
            film.seek(k)
            film.load()
            shown.append(film.info["duration"])
    return shown, first


SHARDS = """
from itertools import product
from msdwarp import Scene, box

def build(*, together: bool = False) -> Scene:
    shards = []
    for way in product((-1, 1), repeat=3):
        velocity = (30.0, 0, 0) if together else [15 * k for k in way]
        shards.append(box((2, 2, 2), 0.01).translate([0.1 * k for k in way]).with_velocity(velocity))
    return Scene(system=sum(shards[1:], shards[0]).translate((0, 0, 1)), gravity=0.0, duration=0.5)
"""


@pytest.mark.slow
def test_a_run_whose_bodies_scatter_tells_the_flags_to_look_at_their_start(msdwarp, tmp_path):
    (tmp_path / "shards.py").write_text(SHARDS)
    run = ("run", "shards.py", "--frames", "none", "--video", "none", "--overlay", "2", *SMALL)
    code, out, _ = msdwarp(*run)
    assert code == 0
    # Eight cubes fly from the corners of a cube of 0.2 m, each coordinate at 15 m/s for 0.5 s.
    told, _, flags = out.splitlines()[-1].partition("; `msdwarp render` shows where they start with ")
    assert told == "bodies scatter over 15 m"
    _, target, _, distance = flags.split()
    # The middle of the picture, which is not quite that of the cube: what is nearer is larger.
    assert np.array(target.split(","), float) == pytest.approx([0, 0, 1], abs=0.05)
    # At 30 degrees a height of 0.35 m, the diagonal of the cube of 0.2 m, fills the picture from 0.65 m away.
    assert 0.4 < float(distance) < 1
    code, out, _ = msdwarp("render", "out/shards", "--video", "none", *SMALL[:2], *flags.split())
    assert (code, out.count("bodies scatter")) == (0, 0)
    code, out, _ = msdwarp(*run, "--together")  # the view is as wide, but nothing scatters
    assert (code, out.count("bodies scatter")) == (0, 0)


@pytest.mark.slow
def test_every_frame_a_range_and_slow_motion_are_drawn(msdwarp, cube):
    frames = ("render", "out/cube", *SMALL[:2])
    assert msdwarp(*frames, "--out", "all")[0] == 0
    code, out, _ = msdwarp(
        *frames, "--out", "some", "--first", "2", "--last", "-3", "--every", "4", "--overlay", "3"
    )
    assert code == 0
    assert out.startswith("drew 3 frames and an overlay of 3 poses")  # 2, 6 and 10 of 0 ... 12
    assert sorted(p.name for p in cube.parents[1].joinpath("some").iterdir()) == [
        "cube.webp",
        "cube_overlay.png",
        *(f"frame_{k:04d}.png" for k in range(3)),
    ]
    shown, _ = durations(cube.parents[1] / "some" / "cube.webp")
    assert shown == pytest.approx([4000 / 60] * 3, abs=1)  # in real time
    code, out, _ = msdwarp(*frames, "--frames", "none", "--out", "slow", "--speed", "0.25")
    shown, _ = durations(cube.parents[1] / "slow" / "cube.webp")
    assert len(shown) == 4 * (FRAMES - 1) + 1  # with frames between
    assert sum(shown) == pytest.approx(len(shown) * 1000 / 60, abs=len(shown))


@pytest.mark.slow
def test_a_still_is_one_picture_with_the_film_s_camera(msdwarp, cube):
    frames = ("render", "out/cube", *SMALL[:2], "--renderer", "raster")
    code, out, _ = msdwarp(*frames, "--still", "0.1", "--samples", "4", "--out", "print")
    assert code == 0
    assert out.startswith("drew the frame at 0.1 s from 4 samples")
    (path,) = cube.parents[1].joinpath("print").iterdir()
    assert path.name == "cube_still.png"
    assert msdwarp(*frames, "--video", "none", "--out", "film")[0] == 0
    sharp = np.asarray(Image.open(cube.parents[1] / "film" / "frame_0006.png")).astype(int)
    # The same picture but for its edges, a few hundred of 9216 pixels.
    assert np.median(np.abs(np.asarray(Image.open(path)) - sharp)) <= 1


class Run:
    def __init__(self, fps):
        self.fps = fps

    def __len__(self):
        return FRAMES


@pytest.mark.parametrize(
    ("fps", "choice", "frames", "film_fps"),
    [
        (60, (0, -1, 1, 1.0), range(13), 60.0),
        (60, (-4, -1, 2, 1.0), range(9, 13, 2), 30.0),
        (60, (0, -1, 1, 0.1), np.linspace(0, 12, 121), 60.0),
        (60, (2, -1, 2, 0.5), range(2, 13), 30.0),
        (60, (0, -1, 1, 0.7), np.arange(0, 12, 0.7), 60.0),
        (60, (0, -1, 1, 2.0), range(0, 13, 2), 60.0),
        (60, (0, -1, 1, 2.5), range(0, 13, 3), 50.0),
        (240, (0, -1, 1, 1.0), range(13), 240.0),  # as it was asked for
        (240, (0, -1, 1, 0.25), range(13), 60.0),
    ],
)
def test_a_film_keeps_to_its_speed_and_a_frame_rate_that_can_be_shown(fps, choice, frames, film_fps):
    shown, moments, rate = frames_shown(Run(fps), *choice)
    assert moments == pytest.approx(list(frames))
    assert rate == pytest.approx(film_fps)
    assert rate * (moments[1] - moments[0]) / fps == pytest.approx(choice[3])
    assert shown[0] <= moments[0] <= moments[-1] <= shown[-1]


def test_a_run_stores_where_the_camera_stood():
    assert restored_options(Options().as_stored()).pictures.camera == {}
    aimed = Pictures(target="-1,0,0.5", distance=2.0)
    again = restored_options(json.loads(json.dumps(Options(pictures=aimed).as_stored()))).pictures
    assert again.camera == {"target": (-1.0, 0.0, 0.5), "distance": 2.0}


def test_a_target_and_a_body_to_follow_take_each_other_s_place():
    assert Pictures(follow="ball").aimed(Look(target=(1, 2, 3))).target is None
    assert Pictures(target="1,2,3").aimed(Look(follow="ball")).follow is None
    assert Pictures(azimuth=5).aimed(Look(follow="ball")).follow == "ball"


SHORT = ("run", "cube", "--size", "3", "--duration", "0.1", "--video", "none", "--resolution", "64x64", "--quiet")


@pytest.mark.slow
@pytest.mark.parametrize(
    "flags", [["--frames", "none", "--contact-forces"], ["--arrows"], ["--color", "contact"]], ids=str
)
def test_they_are_kept_and_drawn_where_asked_for(msdwarp, tmp_path, flags):
    assert msdwarp(*SHORT, "--out", "a", *flags)[0] == 0
    with Trajectory(tmp_path / "a" / "trajectory.vtkhdf") as trajectory:
        assert np.isfinite(trajectory.contact_forces[:]).all()
    again = ("--out", "b", "--video", "none", "--resolution", "64x64", "--arrows", "--color", "contact")
    assert msdwarp("render", "a/trajectory.vtkhdf", *again)[0] == 0
    assert (tmp_path / "b" / "frame_0006.png").exists()


@pytest.mark.slow
def test_a_file_without_them_is_not_drawn_with_arrows(msdwarp, tmp_path):
    assert msdwarp(*SHORT, "--out", "c", "--frames", "none")[0] == 0
    code, _, error = msdwarp("render", "c/trajectory.vtkhdf", "--out", "d", "--arrows")
    assert code == 1
    assert "was written without contact forces" in error
