"""What a scene says is observed of it: by a simulation, an ensemble, a run and a sweep alike."""

import numpy as np
import pytest
import swept
from runs import UNDRAWN

from msdwarp import Ensemble, Scene, Simulation, chain, sweep
from msdwarp.studies import final_numbers

SCENE = """
from msdwarp import Scene, chain

def build():
    ends = lambda position, velocity: (10 * position[:, [0, -1], 0]).round().astype(int)
    return Scene(system=chain(3, 0.1), gravity=0.0, duration=0.05, observe={"ends": ends})
"""


def top(position, velocity):
    return position[:, :, 2].max(axis=1)


def ends(position, velocity):
    return velocity[:, [0, -1], 2]


def build(*, length: float = 0.1) -> Scene:
    """Return a rope that falls."""
    return Scene(system=chain(3, length), duration=0.1, observe={"top": top, "ends": ends})


@pytest.mark.slow
def test_one_world_is_observed_as_many_are():
    pytest.importorskip("xarray")
    simulation = Simulation.from_scene(build(), device="cpu")
    simulation.step(6)
    _, position, velocity = simulation.frame()
    told = build().observed(position, velocity)
    assert told["top"] == position[:, 2].max()
    np.testing.assert_array_equal(told["ends"], velocity[[0, -1], 2])
    numbers = final_numbers(simulation, build())
    assert numbers["top"] == told["top"]
    assert [numbers["ends_0"], numbers["ends_1"]] == told["ends"].tolist()
    seen = Ensemble(build(), 2, device="cpu", substeps=simulation.substeps).run(0.1)
    assert seen.top[1, -1] == told["top"]
    assert seen.ends.shape == (2, 7, 2)


def test_a_sweep_keeps_what_is_observed(tmp_path):
    pytest.importorskip("xarray")
    found = sweep(swept.observed, {"stiffness": [100.0, 200.0]}, tmp_path / "swept", jobs=1, device="cpu")
    np.testing.assert_array_equal(found.height, found.tip_position_z_m)  # a probe tells the same


def test_a_run_says_what_is_observed(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(SCENE)
    code, out, _ = msdwarp("run", "own.py", *UNDRAWN)
    assert code == 0
    assert "ends: [-1,  1]" in out  # of a rope of 0.2 m around the origin, in units of 0.1 m


@pytest.mark.parametrize(
    ("observe", "said"),
    [
        ({"top": 3}, r"observe\['top'\] is 3; it must be a function"),
        ({3: top}, "a name in observe is 3"),
        ([top], "observe is"),
    ],
)
def test_what_cannot_be_observed_is_said(observe, said):
    with pytest.raises(ValueError, match=said):
        Scene(system=chain(3), observe=observe)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (3.0, "first axis must be that of the 1 world"),
        (None, r"observe\['top'\] returned None; it must be numbers in an array"),
        (["up"], "it must be numbers in an array"),
        (np.ma.masked_all(1), "it must be numbers in an array"),
    ],
)
def test_a_function_must_return_numbers_of_worlds(given, said):
    scene = Scene(system=chain(3), observe={"top": lambda position, velocity: given})
    with pytest.raises(ValueError, match=said):
        scene.observed(scene.system.position, scene.system.velocity)
