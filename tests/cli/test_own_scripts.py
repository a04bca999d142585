"""Scene scripts of the user's: their names, their mistakes, and flags for whole numbers."""

import sys

import pytest

UNDRAWN = ["--frames", "none", "--video", "none", "--device", "cpu", "--duration", "0.05"]
SCENE = "from msdwarp import Plane, Scene, Sphere, at, box\n\n"


@pytest.mark.parametrize("name", ["numpy", "msdwarp", "json"])
def test_a_script_takes_no_module_s_place(msdwarp, tmp_path, name):
    before = __import__(name)
    (tmp_path / f"{name}.py").write_text(SCENE + "def build():\n    return Scene(system=box((2, 2, 2), 0.1))\n")
    path = list(sys.path)
    assert msdwarp("run", f"{name}.py", *UNDRAWN)[0] == 0
    assert sys.modules[name] is before
    assert sys.path[: len(path)] == path  # what lies beside the script comes behind
    assert (tmp_path / "out" / name / "trajectory.vtkhdf").exists()


@pytest.mark.parametrize(
    ("script", "line", "said"),
    [
        ("def build(:\n", 3, "invalid syntax"),
        ("import not_there\n", 3, "ModuleNotFoundError: No module named 'not_there'"),
        ("def build():\n    return box((2, 2), no_such=1)\n", 4, "TypeError: "),
        ("def build():\n    return {}['key']\n", 4, "KeyError: 'key'"),
        (
            "def motion(t):\n    return 1 / 0\n"
            "def build():\n    ball = Sphere((0, 0, -1), 0.5, motion=motion)\n"
            "    return Scene(system=box((2, 2, 2), 0.1), colliders=[ball])\n",
            4,
            "division by zero",
        ),
        ("def build():\n    raise SystemExit(0)\n", 4, "SystemExit: 0"),
        (
            "def build():\n    stiffer = at(0.0, stiffness=lambda k: k.none)\n"
            "    return Scene(system=box((2, 2, 2), 0.1), schedule=[stiffer])\n",
            4,
            "AttributeError: ",
        ),
    ],
)
def test_a_mistake_in_a_script_is_told_by_its_line(msdwarp, tmp_path, script, line, said):
    (tmp_path / "own.py").write_text(SCENE + script)
    code, out, err = msdwarp("run", "own.py", *UNDRAWN)
    assert (code, out) == (1, "")
    assert err.startswith(f"error: own.py, line {line}: ")
    assert said in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_function_may_end_with_a_run_that_is_shorter_than_its_scene(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(
        "from msdwarp import Actuator, Force, Plane, PrescribedMotion, Scene, at, box\n\n"
        "def path(t):\n    assert t < 0.5\n    return (0.0, 0.0, -0.1 * t)\n"
        "def build():\n    body = box((2, 2, 2), 0.1).translate((0.0, 0.0, 1.0))\n"
        "    loads = [Force(path), PrescribedMotion([0], path), Actuator(lambda t: path(t)[0])]\n"
        "    around = {'colliders': [Plane(motion=path)], 'schedule': [at(0.02, gravity=path)]}\n"
        "    return Scene(system=body, duration=2.0, gravity=path, loads=loads, **around)\n"
    )
    code, _, err = msdwarp("run", "own.py", *UNDRAWN)
    assert (code, err) == (0, "")


def test_a_script_in_another_encoding_is_told(msdwarp, tmp_path):
    """PowerShell writes UTF-16 by default."""
    (tmp_path / "own.py").write_text(SCENE, encoding="utf-16")
    code, _, err = msdwarp("run", "own.py", *UNDRAWN)
    assert (code, err) == (1, "error: scene is 'own.py', whose script has null bytes; it must be text in UTF-8\n")


def test_whole_numbers_of_other_commands_and_in_tuples_are_not_rounded(msdwarp, tmp_path):
    assert (
        "frame is '1.2'; it must be a whole number" in msdwarp("export", "x", "--to", "obj", "--frame", "1.2")[2]
    )
    (tmp_path / "own.py").write_text(
        SCENE
        + "def build(*, shape: tuple[int, int, int] = (2, 2, 2)):\n    return Scene(system=box(shape, 0.1))\n"
    )
    (tmp_path / "others.py").write_text(
        SCENE + "from typing import Literal\n"
        "def build(*, order: Literal[1, 2] = 1, pair: tuple[int, int] | None = None, "
        "mixed: tuple[int, float] | None = None):\n    return Scene(system=box((2, 2, 2), 0.1))\n"
    )
    assert "it must be a whole number" in msdwarp("run", "own.py", "--shape", "2", "2.5", "2")[2]
    for flags, said in (
        (["--order", "1.5"], "order is '1.5'; it must be one of 1, 2"),
        (["--pair", "1", "2.5"], "pair is '2.5'; it must be a whole number"),
        (["--mixed", "1.5", "2.5"], "mixed is '1.5'; it must be a whole number"),
    ):
        assert said in msdwarp("run", "others.py", *flags)[2]
    assert "12 particles" in msdwarp("run", "own.py", "--shape", "2", "3", "2", *UNDRAWN)[1]


def test_a_name_too_long_for_files_is_refused_before_simulating(msdwarp, tmp_path):
    name = "n" * 240
    (tmp_path / f"{name}.py").write_text(SCENE + "def build():\n    return Scene(system=box((2, 2, 2), 0.1))\n")
    code, out, err = msdwarp("run", f"{name}.py")
    assert (code, out) == (1, "")
    assert "is 240 bytes long; it must be at most 238" in err
    assert not (tmp_path / "out").exists()
