"""Runs in which something breaks: gone on with across the break, or made again, they are the same bit for bit."""

import numpy as np
import pytest
from runs import UNDRAWN, assert_same_run

from msdwarp import Trajectory

# What breaks does so at 0.35 s in the chain, at one instant, and from 0.77 s on in the cloth, at many.
CASES = {
    "snap": ((), (0.3, 0.4, 0.5)),
    "tear": (("--size", "14", "--break-strain", "0.1"), (0.7, 0.84, 1.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", CASES)
def test_a_run_goes_on_across_a_tear_and_is_made_again(msdwarp, tmp_path, scene):
    flags, ends = CASES[scene]
    first, *others = (str(end) for end in ends)
    assert msdwarp("run", scene, *flags, *UNDRAWN, "--out", "whole", "--duration", others[-1])[0] == 0
    assert msdwarp("run", scene, *flags, *UNDRAWN, "--out", "parts", "--duration", first)[0] == 0
    for end in others:
        code, _, err = msdwarp("resume", "parts", "--duration", end)
        assert (code, err) == (0, "")
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    for folder in ("whole", "parts"):
        assert msdwarp("rerun", folder, "--quiet", "--out", f"{folder} again") == (0, "", "")

    paths = [tmp_path / name / "trajectory.vtkhdf" for name in ("whole", "parts", "whole again", "parts again")]
    broken_at = []
    for path in paths:
        with Trajectory(path) as found:
            broken_at.append(found.broken_at)
    for each in broken_at[1:]:
        np.testing.assert_array_equal(each, broken_at[0])
    torn = broken_at[0][np.isfinite(broken_at[0]) & (broken_at[0] > 0)]
    before, between = (np.count_nonzero(torn <= end) for end in ends[:2])
    assert (before, between > 0) == (0, True)  # the break is in the second go
    assert scene == "snap" or between < len(torn)  # and goes on in the third
