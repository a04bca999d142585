"""Contact forces by the command: kept where asked for, or where pictures show them."""

import numpy as np
import pytest

from msdwarp import Trajectory

RUN = ("run", "cube", "--size", "3", "--duration", "0.1", "--video", "none", "--resolution", "64x64", "--quiet")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "kept"),
    [
        (["--frames", "none"], False),
        (["--frames", "none", "--contact-forces"], True),
        (["--arrows"], True),
        (["--colour", "contact"], True),
    ],
    ids=str,
)
def test_they_are_kept_where_asked_for(msdwarp, tmp_path, flags, kept):
    assert msdwarp(*RUN, "--out", "a", *flags)[0] == 0
    with Trajectory(tmp_path / "a" / "trajectory.vtkhdf") as trajectory:
        if kept:
            assert np.isfinite(trajectory.contact_forces[:]).all()
        else:
            with pytest.raises(ValueError, match="without contact forces"):
                _ = trajectory.contact_forces


@pytest.mark.slow
def test_a_file_with_them_is_drawn_again_with_arrows(msdwarp, tmp_path):
    assert msdwarp(*RUN, "--out", "a", "--contact-forces", "--frames", "none")[0] == 0
    again = ("--out", "b", "--video", "none", "--resolution", "64x64", "--arrows", "--colour", "contact")
    assert msdwarp("render", "a/trajectory.vtkhdf", *again)[0] == 0
    assert (tmp_path / "b" / "frame_0006.png").exists()
    assert msdwarp(*RUN, "--out", "c", "--frames", "none")[0] == 0
    code, _, error = msdwarp("render", "c/trajectory.vtkhdf", "--out", "d", "--arrows")
    assert code == 1
    assert "was written without contact forces" in error
