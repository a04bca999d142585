"""Runs in which something breaks: gone on with across the break, or made again, they are the same bit for bit."""

import numpy as np
import pytest
from runs import UNDRAWN, assert_same_run

from msdwarp import Trajectory


@pytest.mark.slow
def test_a_run_goes_on_across_a_tear_and_is_made_again(msdwarp, tmp_path):
    # The cloth tears from 0.77 s on, at many instants.
    flags, ends = ("tear", "--size", "14", "--break-strain", "0.1", *UNDRAWN), (0.7, 0.84, 1.0)
    assert msdwarp("run", *flags, "--out", "whole", "--duration", str(ends[-1]))[0] == 0
    assert msdwarp("run", *flags, "--out", "parts", "--duration", str(ends[0]))[0] == 0
    for end in ends[1:]:
        code, _, err = msdwarp("resume", "parts", "--duration", str(end))
        assert (code, err) == (0, "")
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    assert msdwarp("rerun", "parts", "--quiet", "--out", "again") == (0, "", "")

    broken_at = []
    for name in ("whole", "parts", "again"):
        with Trajectory(tmp_path / name / "trajectory.vtkhdf") as found:
            broken_at.append(found.broken_at)
    for each in broken_at[1:]:
        np.testing.assert_array_equal(each, broken_at[0])
    torn = broken_at[0][np.isfinite(broken_at[0]) & (broken_at[0] > 0)]
    before, between = (np.count_nonzero(torn <= end) for end in ends[:2])
    assert before == 0 < between < len(torn)  # it begins in the second go, and goes on in the third
