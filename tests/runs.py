"""A scene whose runs are ended in every way, and what two runs must agree in."""

import re
from pathlib import Path

import numpy as np
import pytest
from trajectories import assert_trajectories_match

from msdwarp import Trajectory
from msdwarp.files.checkpoint_file import read_restart

# A body that yields, falls on a floor beside a moving obstacle, and is changed on the way: all that a restart must
# hold. `bang` says what happens to the run at 0.15 s, if anything.
SCENE = """
import os, shutil, signal
from enum import Enum
from pathlib import Path
from msdwarp import Plane, Scene, Sphere, at, box

def struck(stiffness):
    bang = Path(__file__).with_name("bang")
    if bang.exists() and any(Path("out").rglob("trajectory.vtkhdf")):
        what = bang.read_text()
        bang.unlink()
        if what == "lose":
            shutil.rmtree(bang.with_name("out"))
        else:
            os.kill(os.getpid(), getattr(signal, what))
    return stiffness

class Shade(Enum):
    LIGHT = 1
    DARK = 2

def build(
    *,
    size: int = 3,
    stiffness: float = 300.0,
    where: Path | None = Path("."),
    origin: tuple[float, float, float] = (0, 0, 0),
    shade: Shade = Shade.LIGHT,
):
    body = box((size, size, 3), 0.1, mass=0.01, stiffness=stiffness, damping=0.2).rotate(0.3, (1, 0, 0))
    assert isinstance(where, Path) and isinstance(origin, tuple) and isinstance(shade, Shade)
    body = body.translate((0, 0, 0.23)).replace(yield_strain=0.05)
    ball = Sphere((0, 0, -0.4), 0.5, motion=lambda t: (0, 0, 0.1 * t))
    schedule = [at(0.1, stiffness=lambda k: 2 * k), at(0.15, stiffness=struck), at(0.25, mass=0.02)]
    return Scene(system=body, colliders=[Plane(), ball], schedule=schedule, duration=0.4)
"""
UNDRAWN = ["--frames", "none", "--video", "none", "--device", "cpu"]


def without_progress(said: str) -> str:
    """Return what a command said but how far it had come, which it tells where it takes half a minute."""
    return re.sub(r"^[\w ]+: \d+( of \d+)? done\n", "", said, flags=re.MULTILINE)


def assert_same_run(one: Path, other: Path) -> None:
    """Assert that two folders hold the same to the last bit: the trajectories, and what a run would go on from."""
    with Trajectory(one / "trajectory.vtkhdf") as a, Trajectory(other / "trajectory.vtkhdf") as b:
        assert_trajectories_match(a, b)
    (arrays, about), (others, wanted) = (read_restart(folder / "restart.h5") for folder in (one, other))
    for name, value in wanted["checkpoint"].items():
        # On a GPU the bounds of rates are sums in no fixed order; steps are whole numbers of a frame.
        bound = name == "limit" or name.startswith("rates.")
        assert about["checkpoint"][name] == (pytest.approx(value, rel=1e-12) if bound else value)
    assert arrays.keys() == others.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(values, others[name])
