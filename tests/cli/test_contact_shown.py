"""Contact forces by the command: kept where asked for, or where pictures show them."""

import numpy as np
import pytest

from msdwarp import Trajectory

RUN = ("run", "cube", "--size", "3", "--duration", "0.1", "--video", "none", "--resolution", "64x64", "--quiet")


@pytest.mark.slow
@pytest.mark.parametrize(
    "flags", [["--frames", "none", "--contact-forces"], ["--arrows"], ["--colour", "contact"]], ids=str
)
def test_they_are_kept_and_drawn_where_asked_for(msdwarp, tmp_path, flags):
    assert msdwarp(*RUN, "--out", "a", *flags)[0] == 0
    with Trajectory(tmp_path / "a" / "trajectory.vtkhdf") as trajectory:
        assert np.isfinite(trajectory.contact_forces[:]).all()
    again = ("--out", "b", "--video", "none", "--resolution", "64x64", "--arrows", "--colour", "contact")
    assert msdwarp("render", "a/trajectory.vtkhdf", *again)[0] == 0
    assert (tmp_path / "b" / "frame_0006.png").exists()


@pytest.mark.slow
def test_a_file_without_them_is_not_drawn_with_arrows(msdwarp, tmp_path):
    assert msdwarp(*RUN, "--out", "c", "--frames", "none")[0] == 0
    code, _, error = msdwarp("render", "c/trajectory.vtkhdf", "--out", "d", "--arrows")
    assert code == 1
    assert "was written without contact forces" in error
