"""What a fit is given is checked, and refused by name; files are read as they are told."""

import numpy as np
import pytest
from measurements import STIFFNESS, block, csv_of, hung, tracked

from msdwarp import Plane, Probe, Scene, TrackedPoints, UnstableStep, fit
from msdwarp.studies.measured import channels_of, frame_rate, read_measured

SCENE = hung()
POINTS = TrackedPoints([0.1, 0.2], [0, 1], np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"report": None}, "report is None; it must be a function of a line of text"),
        ({"parameters": ["color"]}, "a name in parameters is 'color'; it must be one of 'stiffness'"),
        ({"parameters": ["mass", "mass"]}, "each must be named once"),
        ({"parameters": {"stiffness": -1.0}}, r"parameters\['stiffness'\] is -1; it must be a number above 0"),
        ({"parameters": ["friction"]}, "the scene must have colliders"),
        ({"bounds": {"mass": (1, 2)}}, "a name in bounds is 'mass'"),
        ({"bounds": {"stiffness": (300, 500)}}, r"bounds\['stiffness'\] is \(300, 500\)"),
        ({"loss": "cauchy"}, "noise must be given"),
        ({"noise": -1.0}, "noise of points is -1"),
        ({"noise": {"top": 1.0}}, "a name in noise is 'top'"),
        ({"horizon": [0.2, 0.1]}, "horizon is .*increasing times"),
        ({"starts": 0}, "starts is 0"),
        ({"tolerance": 0}, "tolerance is 0"),
        ({"device": "gpu7"}, "gpu7"),
        ({"scene": block()}, "it must be a Scene, such as"),
        ({"measured": 3}, "measured is 3"),
        ({"measured": {}}, "measured is empty"),
        ({"measured": {"top": ([1], [1])}}, "a name in measured is 'top'"),
        ({"measured": {"energy": 3}}, r"measured\['energy'\] is 3"),
        ({"measured": {"energy": ([1.0], [1.0, 2.0])}}, "times of shape"),
        ({"measured": TrackedPoints([0.1], [99], np.zeros((1, 3)))}, "particle of measured.* is 99; it must be"),
        ({"measured": TrackedPoints([0.1], [0], np.zeros((1, 2)))}, "measured has 2 coordinates; the scene has 3"),
        ({"measured": TrackedPoints([0.0], [0], np.zeros((1, 3)))}, "nothing of points after time 0"),
    ],
)
def test_what_is_wrong_is_named(wrong, said):
    given = {"scene": SCENE, "measured": POINTS, "parameters": ["stiffness"]} | wrong
    with pytest.raises(ValueError, match=said):
        fit(**given)


def test_a_parameter_that_is_zero_asks_for_a_start():
    undamped = Scene(system=SCENE.system.replace(damping=0.0))
    with pytest.raises(
        ValueError, match="damping is 0 in the scene; it must be above 0 to be fitted, or be told where to start"
    ):
        fit(undamped, POINTS, ["damping"])


def test_gravity_in_time_and_friction_without_end_cannot_be_fitted():
    with pytest.raises(ValueError, match="gravity is a function of time"):
        fit(Scene(system=SCENE.system, gravity=lambda t: 9.0), POINTS, ["gravity"])
    sticky = Scene(system=SCENE.system, colliders=[Plane(friction=np.inf)])
    with pytest.raises(ValueError, match=r"friction of colliders.*finite"):
        fit(sticky, POINTS, ["friction"])


def test_substeps_that_are_unstable_within_the_bounds_are_refused():
    with pytest.raises(UnstableStep, match="substeps is 4"):
        fit(SCENE, POINTS, ["stiffness"], substeps=4, device="cpu")


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (([1.0], [0, 1], np.zeros((1, 3))), "have shapes"),
        (([-1.0], [0], np.zeros((1, 3))), r"time\[0\] is -1"),
        (([1.0], [0.5], np.zeros((1, 3))), r"particle\[0\] is 0.5"),
        (([1.0], [0], np.full((1, 3), np.inf)), "position.* is inf"),
    ],
)
def test_tracked_points_are_checked(rows, said):
    with pytest.raises(ValueError, match=said):
        TrackedPoints(*rows)


def test_points_come_from_a_file(tmp_path):
    points = tracked(SCENE, 0.1)
    path = tmp_path / "points.csv"
    path.write_text("# from the camera\n" + csv_of(points).replace(f"{points.position[0, 0]:.12g}", "", 1))
    read = read_measured(path, SCENE)
    assert np.isnan(read.position[0, 0])
    np.testing.assert_allclose(read.position[1:], points.position[1:], rtol=1e-11)  # 12 digits
    np.testing.assert_array_equal(read.particle, points.particle)


def test_a_file_that_is_no_table_is_named(tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"points.csv, which is neither a CSV file nor a trajectory"):
        read_measured(path, SCENE)


def test_what_probes_told_comes_from_a_file(tmp_path):
    scene = Scene(system=SCENE.system, probes={"foot": Probe([0, 1], "position")})
    path = tmp_path / "probes.csv"
    path.write_text("time_s,foot_position_z_m,energy_J\n0.1,1,2\n0.2,3,\n")
    read = read_measured(path, scene)
    np.testing.assert_array_equal(read["foot"][1], [[np.nan, np.nan, 1], [np.nan, np.nan, 3]])
    np.testing.assert_array_equal(read["energy"][1], [[2], [np.nan]])
    assert [one.unit for one in channels_of(path, scene, None)] == ["m", "J"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "begins with nothing; its first line must be time,id,x,y,z"),
        ("t,x\n", "begins with t, x"),
        ("time,id,x,y,z\n1,2\n", "line 2 of .* has 2 columns; its first line has 5"),
        ("time,id,x,y,z\n1,2,a,0,0\n", "line 2 of .* has 'a'; it must be a number, or empty"),
    ],
)
def test_a_file_that_is_wrong_is_told_by_line(tmp_path, text, said):
    path = tmp_path / "wrong.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_measured(path, SCENE)


@pytest.mark.parametrize(
    ("times", "fps"),
    [
        (np.arange(1, 30) / 240, 240.0),
        (np.round(np.arange(1, 30) / 60, 6), 60.0),  # as files have them
        (np.array([0.1, 0.2, 0.5]), 10.0),
        (np.array([0.1, 0.10001, 0.237]), 60.0),  # no rate has them all
        (np.arange(1, 9) / 29.97, 29.97),
    ],
)
def test_the_frame_rate_is_told_by_the_times(times, fps):
    points = TrackedPoints(times, np.zeros(len(times)), np.ones((len(times), 3)))
    assert frame_rate(channels_of(points, SCENE, None)) == pytest.approx(fps, rel=1e-9)


@pytest.mark.slow
def test_the_command_fits(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(
        "from msdwarp import Scene, box\n"
        "def build(stiffness: float = 320.0) -> Scene:\n"
        "    body = box((3, 3, 3), 0.1, mass=0.05, stiffness=stiffness, damping=0.2)\n"
        "    return Scene(system=body.pin(body.position[:, 2] > body.position[:, 2].max() - 1e-6))\n"
    )
    (tmp_path / "points.csv").write_text(csv_of(tracked(SCENE, 0.2)))
    flags = ["--parameters", "stiffness", "--bounds", "stiffness=50:1000", "--device", "cpu", "--substeps", "32"]
    code, out, error = msdwarp("fit", "own.py", "points.csv", *flags, "--quiet", "--plot", "left.png")
    assert code == 0, error
    assert float(out.split()[1]) == pytest.approx(STIFFNESS, rel=1e-6)  # a file of 12 digits
    assert (tmp_path / "left.png").exists()
    for words, said in (
        (["fit", "own.py", "points.csv", "--plot", "left.png"], "plot is left.png, which exists"),
        (["fit", "own.py", "points.csv", "--plot", "left.jpg"], "plot is left.jpg; its name must end in .png"),
        (["fit", "own.py"], "Usage"),
        (["fit", "own.py", "--substeps", "32"], "measured is missing"),
        (["fit", "own.py", "none.csv"], "measured is none.csv"),
        (["fit", "own.py", "points.csv", "--parameters", "stiffness=x"], "written as in stiffness=500,damping"),
        (["fit", "own.py", "points.csv", "--bounds", "stiffness=1"], "written as in stiffness=100:2000"),
    ):
        _, out, error = msdwarp(*words)
        assert said in out + error
