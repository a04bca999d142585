"""A table that grows with a run: continued, it loses no line before another one takes its place."""

import errno
import os
from pathlib import Path

import pytest

from msdwarp.studies import GrowingTable

HEAD = ["time_s", "height_m"]


def table(path, **options):
    return GrowingTable(path, HEAD, word="the table", **options)


def written(path, lines, **options):
    """Write some lines, and return the file's lines."""
    with table(path, **options) as growing:
        for line in lines:
            growing.write_line(line)
    return path.read_text().splitlines()


def test_lines_stay_until_others_take_their_place(tmp_path):
    path = tmp_path / "a.csv"
    first = [(k, k / 7) for k in range(1, 9)]
    whole = written(path, first)
    assert whole[0] == "time_s,height_m"
    assert len(whole) == 9
    assert written(path, [], behind=3) == whole
    assert written(path, first[3:6], behind=3) == whole
    assert written(path, first[2:4], until=2.0) == whole
    assert written(path, [first[3], (5, 0.1)], behind=3) == [*whole[:5], "5,0.1"]
    assert written(path, first[4:], behind=4) == whole


def test_a_line_that_was_cut_short_is_replaced(tmp_path):
    path = tmp_path / "a.csv"
    whole = written(path, [(k, k / 7) for k in range(1, 5)])
    os.truncate(path, path.stat().st_size - 5)
    assert written(path, [(4, 4 / 7)], behind=3) == whole


def test_what_cannot_be_written_takes_no_line(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    whole = written(path, [(k, k / 7) for k in range(1, 9)])

    class Full:
        """A file on a full disk."""

        def __init__(self, file):
            self._file = file

        def __getattr__(self, name):
            return getattr(self._file, name)

        def write(self, _):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def opened(path, mode="r", **how):
        return Full(open(path, mode)) if mode == "r+b" else open(path, mode, **how)

    monkeypatch.setattr(Path, "open", opened)
    no_space = pytest.raises(OSError, match=r"a\.csv could not be written further: No space left")
    with table(path, behind=3) as growing, no_space:
        growing.write_line((4, 0.0))
    assert path.read_text().splitlines() == whole
