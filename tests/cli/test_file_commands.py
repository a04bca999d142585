"""The commands that begin with a file: drawing it, plotting it."""

import numpy as np
import pytest
from PIL import Image
from trajectories import SYSTEMS, write

from msdwarp import Trajectory, TrajectoryWriter, chain
from msdwarp.cli.commands.quantities import round_up

PICTURES = ["--resolution", "128x72", "--frames", "none"]


@pytest.fixture
def cube(msdwarp, tmp_path):
    """The folder of a short run that has drawn nothing."""
    undrawn = ("--frames", "none", "--video", "none", "--device", "cpu")
    assert msdwarp("run", "cube", "--size", "4", "--duration", "0.1", *undrawn)[0] == 0
    return tmp_path / "out" / "cube"


def first_picture(path):
    with Image.open(path) as film:
        return np.asarray(film.convert("RGB")).astype(int)


@pytest.mark.slow
def test_what_is_rendered_later_is_what_would_have_been_drawn(msdwarp, cube, tmp_path):
    drawn = ("--resolution", "128x72", "--overlay", "3", "--azimuth", "40", "--elevation", "50", "--zoom", "2")
    short = ("--size", "4", "--duration", "0.1", "--device", "cpu", "--out", "drawn")
    assert msdwarp("run", "cube", *drawn, *short)[0] == 0
    code, out, err = msdwarp("render", "out/cube", *drawn)
    assert (code, err) == (0, "")
    assert out.startswith("drew 7 frames and an overlay of 3 poses")
    names = (*(f"frame_{k:04d}.png" for k in range(7)), "cube.webp", "cube_overlay.png")
    pictures = {name: (cube / "render" / name).read_bytes() for name in names}
    assert {name: (tmp_path / "drawn" / name).read_bytes() for name in names} == pictures
    for name in names:
        (tmp_path / "drawn" / name).unlink()
    assert msdwarp("resume", "drawn")[0] == 0  # which has kept how it was to be drawn
    assert {name: (tmp_path / "drawn" / name).read_bytes() for name in names} == pictures


@pytest.mark.slow
def test_colors_and_the_camera_can_be_chosen(msdwarp, cube):
    pictures = {}
    choices = [(), ("--color", "strain"), ("--color", "velocity"), ("--color", "energy")]
    choices += [("--azimuth", "40")]
    for k, choice in enumerate(choices):
        assert msdwarp("render", str(cube), *PICTURES, *choice, "--out", f"{k}")[0] == 0
        pictures[choice] = first_picture(f"{k}/cube.webp")
    for one, picture in pictures.items():
        for other, another in pictures.items():
            assert one == other or np.abs(picture - another).max() > 50


@pytest.mark.slow
def test_pictures_that_are_there_are_kept(msdwarp, cube):
    for folder in ("render", "render-2"):  # each time another
        code, out, _ = msdwarp("render", str(cube / "trajectory.vtkhdf"), *PICTURES)
        assert (code, f"{folder}/cube.webp" in out) == (0, True)
    before = (cube / "render" / "cube.webp").read_bytes()
    strained = (*PICTURES, "--color", "strain", "--out", str(cube / "render"))
    code, out, err = msdwarp("render", str(cube), *strained)
    assert (code, out) == (1, "")
    assert "cube.webp exists, and would be replaced; name another --out or add --force" in err
    assert (cube / "render" / "cube.webp").read_bytes() == before
    assert msdwarp("render", str(cube), *strained, "--force", "--quiet") == (0, "", "")
    after = (cube / "render" / "cube.webp").read_bytes()
    assert after != before
    impossible = (*PICTURES, "--arrows", "--out", str(cube / "render"), "--force")  # no contact forces in it
    assert msdwarp("render", str(cube), *impossible)[0] == 1
    assert (cube / "render" / "cube.webp").read_bytes() == after


def test_a_file_without_a_scene_is_drawn_as_what_it_is(msdwarp, tmp_path):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3)
    code, _, err = msdwarp("render", "a.vtkhdf", *PICTURES)
    assert code == 0
    assert err == "drawn without obstacles, in a plain look: the file lacks 'scene'; it has nothing\n"
    assert first_picture(tmp_path / "render" / "a.webp").std() > 5


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--frames", "none", "--video", "none"], "nothing would be drawn"),
        (["--resolution", "1x1"], "resolution is '1x1'"),
        (["--out", "/dev/null/deep"], "out is /dev/null/deep, which cannot be written to"),
        (["--first", "13"], "first is 13; the run has 13 frames, and it must be from -13 to 12"),
        (["--last", "-14"], "last is -14; the run has 13 frames, and it must be from -13 to 12"),
        (["--first", "5", "--last", "4"], "last is 4; it must not be before first, which is 5"),
        (["--every", "0"], "every is 0; it must be a whole number of at least 1"),
        (["--every", "2.5"], "every is '2.5'; it must be a whole number"),
        (["--speed", "0"], "speed is 0.0; it must be from 0.01 to 100"),
        (["--speed", "nan"], "speed is nan"),
        (["--every", "4", "--overlay", "5"], "overlay is 5; it must be at most the number of frames drawn, 4"),
        (["--zoom", "-1"], "zoom is -1"),
        (["--still", "0.21"], "still is 0.21; it must be from 0 to 0.2"),
        (["--still", "0.1", "--samples", "0"], "samples is 0; it must be"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_a_file_is_touched(msdwarp, tmp_path, flags, message):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 13)
    code, out, err = msdwarp("render", "a.vtkhdf", *flags)
    assert (code, out) == (1, "")
    assert message in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtkhdf"]


@pytest.mark.slow
def test_a_plot_and_a_table_are_written_and_kept(msdwarp, cube):
    code, out, _ = msdwarp("plot", str(cube))
    assert (code, out) == (0, f"wrote {cube / 'trajectory.png'}\n")
    assert np.asarray(Image.open(cube / "trajectory.png").convert("L")).std() > 5  # not blank
    code, out, err = msdwarp("plot", str(cube))
    assert (code, out) == (1, "")
    assert "trajectory.png" in err
    assert msdwarp("plot", str(cube), "--out", "cube.csv")[0] == 0
    table = np.genfromtxt("cube.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["time_s"], np.arange(7) / 60, rtol=1e-8)  # nine digits are written
    with Trajectory(cube / "trajectory.vtkhdf") as found:
        np.testing.assert_allclose(table["lowest_m"], found.positions[:][..., 2].min(axis=1), rtol=1e-8)


def test_readings_of_probes_are_plotted(msdwarp, tmp_path):
    (tmp_path / "probes.csv").write_text(
        "time_s,foot_force_x_N,foot_force_y_N,s_strain_mean\n0.1,1,2,0.1\n0.2,3,4,0\n"
    )
    assert msdwarp("plot", "probes.csv")[:2] == (0, "wrote probes.png\n")
    picture = np.asarray(Image.open("probes.png").convert("L"))
    assert picture.std() > 5  # not blank
    assert picture.shape[0] == pytest.approx(
        150 * (0.4 + 2.4 * 2), abs=1
    )  # a panel for the force, one for the strain
    assert "which exists" in msdwarp("plot", "probes.csv")[2]
    (tmp_path / "empty.csv").write_text("time_s,foot_force_x_N\n")
    assert "empty.csv has no rows" in msdwarp("plot", "empty.csv")[2]
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    assert "begins with 'a'; it must have columns time_s" in msdwarp("plot", "other.csv")[2]


@pytest.mark.slow
def test_a_plot_needs_to_know_gravity(msdwarp, tmp_path):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3)
    assert "without --gravity, the file lacks 'gravity'" in msdwarp("plot", "a.vtkhdf")[2]
    assert msdwarp("plot", "a.vtkhdf", "--gravity", "0")[0] == 0


def test_a_scale_ends_at_a_round_number_that_is_not_less():
    ends = {0.0: 1.0, 1.0: 1.0, 1.01: 1.5, 4.2: 5.0, 0.0061: 0.008, 9.3: 10.0, 230.0: 300.0}
    for value, wanted in ends.items():
        assert round_up(value) == pytest.approx(wanted)


def test_info_says_what_broke(msdwarp, tmp_path):
    row = chain(4, 0.1).replace(break_strain=0.5, broken_at=[0.0, np.inf, np.inf])
    with TrajectoryWriter(tmp_path / "a.vtkhdf", row, fps=60) as writer:
        for k, broken_at in enumerate(([0.0, np.inf, np.inf], [0.0, np.inf, 0.01])):
            writer.write((k / 60, row.position, row.velocity), broken_at=np.array(broken_at))
    code, out, _ = msdwarp("info", str(tmp_path / "a.vtkhdf"))
    assert code == 0
    assert "broken: 1 connection, from 0.01 to 0.01 s, beside 1 that were from the start" in out


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("npz", "--color", "strain"), "color, body or cut is given; where to is 'npz' they must not be"),
        (("npz", "--up", "y"), "up or scale is given; where to is 'npz' they must not be"),
        (("obj", "--frame", "1", "--every", "2"), "every is 2; it must not be given beside frame"),
        (("obj", "--every", "0"), "every is 0; it must be"),
        (("obj", "--scale", "0"), "scale is 0; it must be"),
        (("glb", "--body", "cat"), "body is 'cat'; it must be one of 'obstacles'"),
        (("glb", "--body", "obstacles"), "body is obstacles; nothing of it can be drawn"),
    ],
)
def test_flags_of_exports_that_cannot_be_are_told(msdwarp, tmp_path, flags, said):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3)
    code, _, err = msdwarp("export", "a.vtkhdf", "--to", *flags)
    assert (code, said in err) == (1, True), err
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtkhdf"]
