"""Loads in what a file says of a run, and in what `resume` compares."""

import math

import numpy as np
import pytest
import warp as wp
from runs import UNDRAWN

import msdwarp as msd
from msdwarp.cli.provenance import digest

SCENE = """
from msdwarp import Force, Scene, Wind, chain

def gust(t):
    return (3.0 + t, 0.0, 0.0)

def build(*, size: int = 3):
    system = chain(size, stiffness=50.0, damping=1.0).pin(0)
    loads = [Wind(gust, area=0.01), Force((0.0, 2.0, 0.0), on=[1])]
    return Scene(system=system, loads=loads, gravity=lambda t: 9.0 + 0 * t, duration=0.1)
"""


@wp.func
def inwards(x: wp.vec3, v: wp.vec3, t: float, i: int):
    return -x


def gust(t):
    return (3.0 + t, 0.0, 0.0)


def test_loads_say_what_they_are():
    said = {
        "Force((0, 2, 0), on=1 particle)": msd.Force((0.0, 2.0, 0.0), on=[1]),
        "Force(inwards)": msd.Force(inwards),
        "Force((0, 0, 1), on='foot', total=True)": msd.Force((0, 0, 1), on="foot", total=True),
        "Wind(gust, drag=2)": msd.Wind(gust, drag=2.0),
        "Wind((3, 0, 0), area=4 numbers)": msd.Wind((3, 0, 0), area=np.ones(4)),
        "Pressure(500)": msd.Pressure(500),
        "Actuator(gust, on=3 particles, along=('x', 'z'), delay=0.1)": msd.Actuator(
            gust, on=[0, 1, 6], along=("x", "z"), delay=0.1
        ),
        "EnclosedGas(2000, exponent=1.4)": msd.EnclosedGas(2000.0, exponent=1.4),
    }
    for text, load in said.items():
        assert repr(load) == text
    scene = msd.Scene(system=msd.chain(3), loads=[msd.Force((0, 2, 0), on=[1])])
    assert "loads: Force((0, 2, 0), on=1 particle)" in repr(scene)


def test_the_digest_knows_loads():
    def of(*loads, gravity=9.82):
        return digest(msd.Scene(system=msd.chain(3), loads=loads, gravity=gravity))

    different = [
        of(),
        of(msd.Force((0, 0, 1))),
        of(msd.Force((0, 0, 2))),
        of(msd.Force((0, 0, 1), on=[1])),
        of(msd.Force(lambda t: (0, 0, t))),
        of(msd.Force(lambda t: (0, 0, 2 * t))),
        of(msd.Force(lambda t: (0, 0, math.sqrt(1 - t)))),  # not defined until the scene's end
        of(msd.Force(lambda t: (0, 0, 2 * math.sqrt(1 - t)))),
        of(msd.Force(inwards)),
        of(msd.Wind((1, 0, 0), area=0.1)),
        of(msd.Wind((1, 0, 0), area=0.2)),
        of(msd.Attachment([0], stiffness=3.0)),
        of(msd.Attachment([0], stiffness=4.0)),
        of(msd.Actuator(lambda t: 0.1 * t, on=[0, 1], along="x", delay=0.1)),
        of(msd.Actuator(lambda t: 0.1 * t, on=[0, 1], along="x")),
        of(msd.Actuator(lambda t: 0.2 * t, on=[0, 1], along="x")),
        of(gravity=lambda t: t),
        of(gravity=lambda t: 2 * t),
    ]
    assert len(set(different)) == len(different)
    assert of(msd.Force((0, 0, 1))) == of(msd.Force([0.0, 0.0, 1.0]))


@pytest.mark.slow
def test_info_tells_loads_and_resume_notices_others(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(SCENE)
    assert msdwarp("run", "own.py", *UNDRAWN, "--out", "out")[0] == 0
    code, out, _ = msdwarp("info", "out/trajectory.vtkhdf")
    assert code == 0
    assert "loads: Wind(gust, area=0.01), Force((0, 2, 0), on=1 particle)" in out
    assert "gravity: <lambda> of time" in out
    (tmp_path / "own.py").write_text(SCENE.replace("2.0, 0.0), on", "2.5, 0.0), on"))
    code, out, err = msdwarp("resume", "out", "--duration", "0.2", "--trust")
    assert code == 1
    assert "has changed since the run began" in out + err
