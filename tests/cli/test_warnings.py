"""What the command warns of is a line each, without the place in our sources that gave it."""

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
def test_a_warning_is_a_line_without_a_path(tmp_path):
    (tmp_path / "inside.py").write_text(SCENE)
    flags = ["--frames", "none", "--video", "none", "--trajectory", "none", "--device", "cpu", "--quiet"]
    done = subprocess.run(
        [sys.executable, "inside.py", *flags], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    (warned,) = done.stderr.splitlines()
    assert warned.startswith("warning: particle ")
    assert "starts 0.2 m inside" in warned
    assert ".py:" not in warned


CRUSH = """
from msdwarp import Contact, Material, Scene, box

def build() -> Scene:
    soft = {"youngs_modulus": 2e5, "damping_ratio": 0.1}
    brick = box((3, 3, 3), 0.05, material=Material(density=400.0, **soft))
    heavy = box((4, 4, 4), 0.05, material=Material(density=3000.0, **soft)).rotate(0.5, (1, 0.3, 0.2))
    system = heavy.translate((-0.2, 0, 0)).with_velocity((SPEED, 0, 0)) + brick
    for k in range(1, 4):
        system = system + brick.rotate(0.3 * k, (1, 0, 0)).translate((0.101 * k, 0, 0))
    return Scene(system=system, contact=Contact(), gravity=0.0, duration=0.05)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "told"), [(16.0, True), (2.0, False)])  # their speed of sound is 22 m/s
def test_a_run_says_that_contact_held_particles_back(msdwarp, tmp_path, speed, told):
    (tmp_path / "crush.py").write_text(CRUSH.replace("SPEED", str(speed)))
    flags = ["--frames", "none", "--video", "none", "--trajectory", "none", "--device", "cpu"]
    code, out, _ = msdwarp("run", "crush.py", *flags)
    assert code == 0
    assert ("contact held particles back, at about 0.0" in out) == told
