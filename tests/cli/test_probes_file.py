"""The file that a run writes of what its probes tell."""

import numpy as np
import pytest
from runs import UNDRAWN

from msdwarp import Trajectory

SCENE = """
from msdwarp import Plane, Probe, Scene, box

def build(*, size: int = 2):
    system = box((size, 2, 2), 0.1, stiffness=200.0, damping=1.0).named("block")
    probes = {"foot": Probe("block", "contact force"), "body": Probe("block", "strain")}
    probes |= {"top": Probe("block", "velocity", every="substep")}
    return Scene(system=system, colliders=[Plane(offset=-0.06)], probes=probes, duration=0.4)
"""


@pytest.fixture
def probed(tmp_path):
    """A scene with probes."""
    path = tmp_path / "own.py"
    path.write_text(SCENE)
    return path


@pytest.mark.slow
def test_a_run_writes_what_probes_tell_and_goes_on_with_it(msdwarp, probed):
    options = UNDRAWN
    code, out, _ = msdwarp("run", "own.py", *options, "--out", "whole")
    assert (code, "wrote whole/probes.csv and whole/probes_by_substep.csv" in out) == (0, True)
    table = np.genfromtxt(probed.parent / "whole" / "probes.csv", delimiter=",", names=True)
    assert table.dtype.names == (
        "time_s",
        *(f"foot_contact_force_{axis}_N" for axis in "xyz"),
        "body_strain_mean",
        "body_strain_largest",
    )
    # A frame and its line each 1/60 s; numbers have nine digits.
    np.testing.assert_allclose(table["time_s"], np.arange(1, 25) / 60, rtol=1e-8)
    assert table["foot_contact_force_z_N"].max() > 0
    assert msdwarp("run", "own.py", *options, "--out", "parts", "--duration", "0.2")[0] == 0
    assert msdwarp("resume", "parts", "--duration", "0.4")[0] == 0
    for name in ("probes.csv", "probes_by_substep.csv"):
        whole, parts = ((probed.parent / folder / name).read_text() for folder in ("whole", "parts"))
        assert parts == whole
    series = []
    for folder in ("whole", "parts"):  # the trajectory has them too
        with Trajectory(probed.parent / folder / "trajectory.vtkhdf") as found:
            series.append(found.readings)
    for name in ("foot", "body", "top"):
        np.testing.assert_array_equal(series[1][name].times, series[0][name].times)
        np.testing.assert_array_equal(series[1][name].values, series[0][name].values)
    np.testing.assert_allclose(series[0]["foot"].values[:, 2], table["foot_contact_force_z_N"], rtol=1e-8)
    code, out, _ = msdwarp("info", "parts/trajectory.vtkhdf")
    assert "probe body: strain_mean, strain_largest, 24 readings by frame" in out
    steps = np.genfromtxt(probed.parent / "whole" / "probes_by_substep.csv", delimiter=",", names=True)
    assert steps.dtype.names == ("time_s", *(f"top_velocity_{axis}_m_s" for axis in "xyz"))
    assert len(steps) >= 2 * len(table)
    np.testing.assert_allclose(steps["time_s"][-1], 0.4, rtol=1e-8)
