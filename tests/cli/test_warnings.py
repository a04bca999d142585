"""Warnings in the command are a line each, without the place in our sources that gave them."""

import subprocess
import sys

import pytest

SCENE = """
from msdwarp import Plane, Scene, box
from msdwarp.cli import scene_main

def build(*, size: int = 3) -> Scene:
    body = box((size, size, size), 0.1, mass=0.02, stiffness=200.0, damping=1.0).translate((0, 0, -0.1))
    return Scene(system=body, colliders=[Plane()], duration=0.02)

if __name__ == "__main__":
    scene_main(build)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "quiet"), [(["-m", "msdwarp", "run", "inside.py"], ["--quiet"]), (["inside.py"], [])]
)
def test_a_warning_is_a_line_without_a_path(tmp_path, words, quiet):
    (tmp_path / "inside.py").write_text(SCENE)
    flags = ["--frames", "none", "--video", "none", "--trajectory", "none", "--device", "cpu", *quiet]
    done = subprocess.run(
        [sys.executable, *words, *flags], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    warned = [line for line in done.stderr.splitlines() if "starts 0.2 m inside" in line]
    assert len(warned) == 1, done.stderr
    assert warned[0].startswith("warning: particle ")
    assert ".py:" not in done.stderr
    assert "return cls(" not in done.stderr
    if quiet:
        assert done.stderr.splitlines() == warned
