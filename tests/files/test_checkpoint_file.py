"""Restart files: whole or refused, and replaced as a whole."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from msdwarp.files.checkpoint_file import read_restart, write_restart

ARRAYS = {
    "x": np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32),
    "lost/v": np.random.default_rng(1).normal(size=(20, 3)),
    "none": np.zeros((0, 3)),
    "substep": np.int64(7),
    "mask": np.array([True, False, True]),
    "numbers": np.arange(5, dtype=np.uint32),
    "wide": np.broadcast_to(np.float64(2.5), (4, 2)),
}
ATTRIBUTES = {"time": 0.1, "random": {"state": 1 << 100, "has": [0, None, "µ"]}, "limit": np.inf}


def assert_whole(path):
    arrays, attributes = read_restart(path)
    assert attributes == ATTRIBUTES
    assert list(arrays) == list(ARRAYS)
    for name, values in ARRAYS.items():
        assert (arrays[name].dtype, arrays[name].shape) == (values.dtype, values.shape)
        np.testing.assert_array_equal(arrays[name], values)


@pytest.fixture
def path(tmp_path):
    write_restart(tmp_path / "restart.h5", ARRAYS, ATTRIBUTES)
    return tmp_path / "restart.h5"


def test_arrays_and_attributes_come_back(path):
    assert_whole(path)
    assert [one.name for one in path.parent.iterdir()] == ["restart.h5"]
    write_restart(path, {"a": np.ones(3)}, {})
    arrays, attributes = read_restart(path)
    assert (list(arrays), attributes) == (["a"], {})


def test_what_cannot_be_stored_is_named(path):
    with pytest.raises(ValueError, match=r"arrays\['text'\] is of type <U2; it must hold numbers"):
        write_restart(path, {"text": np.array(["ab"])}, {})
    with pytest.raises(ValueError, match=r"attributes is .*; it must be what JSON can hold"):
        write_restart(path, {}, {"what": {1, 2}})
    assert_whole(path)


def refusal(path):
    """Return why a file is refused, None if it is not."""
    try:
        read_restart(path)
    except ValueError as error:
        return str(error)
    return None


def test_a_damaged_file_is_refused_or_nothing_is_lost(path):
    whole = path.read_bytes()
    refused, step = 0, 37  # an odd one: of numbers of 2, 4 and 8 bytes each of the bytes has its turn
    for k in range(0, len(whole), step):
        damaged = bytearray(whole)
        damaged[k] ^= 0x55
        path.write_bytes(damaged)
        said = refusal(path)
        if said is None:
            assert_whole(path)  # it was a byte that nobody reads
        else:
            assert str(path) in said
            refused += 1
    assert refused > len(whole) / step / 3


def test_a_lost_page_is_told_whatever_it_held(tmp_path):
    # Sums modulo 65535, as HDF5's own checksums are, are the same for 0xFFFF as for 0.
    path = tmp_path / "restart.h5"
    for held, lost in ((0xFF, 0x00), (0x00, 0xFF)):
        write_restart(path, {"partner": np.full(4096, held, dtype=np.uint8)}, {})
        whole = path.read_bytes()
        page = bytes([held]) * 4096
        assert whole.count(page) == 1
        path.write_bytes(whole.replace(page, bytes([lost]) * 4096))
        with pytest.raises(ValueError, match=r"restart\.h5 is damaged: .*it is not what its checksum is of"):
            read_restart(path)


def test_a_file_of_an_earlier_version_opens(path):
    arrays, _ = read_restart(path)
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:  # arrays in chunks, with HDF5's own checksums
        for name in ("description", *(f"arrays/{k}" for k in range(len(arrays)))):
            values = file[name][()].ravel()
            checked = {"fletcher32": True, "chunks": (len(values),)} if len(values) else {}
            del file[name]
            file.create_dataset(name, data=values, **checked)
    assert_whole(path)


def test_a_short_or_foreign_file_is_refused_by_what_is_wrong(path):
    whole = path.read_bytes()
    for size in (100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"restart\.h5 is damaged: it is cut short"):
            read_restart(path)
    for content in (b"", b"time,energy\n"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="no restart file: it is no HDF5 file"):
            read_restart(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(ValueError, match="no restart file: it is an HDF5 file of another kind"):
        read_restart(path)
    write_restart(path, ARRAYS, ATTRIBUTES)
    with h5py.File(path, "r+") as file:
        file.attrs["msdwarp_restart_format"] = 2
    with pytest.raises(ValueError, match="restart file of format 2; this version of msdwarp reads 1"):
        read_restart(path)
    path.unlink()
    with pytest.raises(FileNotFoundError):
        read_restart(path)


def test_a_failure_keeps_the_old_file(path, monkeypatch):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"restart\.h5 could not be written: No space left on device"):
        write_restart(path, {"a": np.ones(1000)}, {})
    assert [one.name for one in path.parent.iterdir()] == ["restart.h5"]
    assert_whole(path)
    with pytest.raises(OSError, match="could not be written: No such file or directory"):
        write_restart(path.parent / "none" / "restart.h5", {}, {})


def test_it_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    seen, real = [], (os.fsync, os.replace)
    monkeypatch.setattr(os, "fsync", lambda descriptor: (seen.append(kind(descriptor)), real[0](descriptor)))
    monkeypatch.setattr(os, "replace", lambda *names: (seen.append("name"), real[1](*names)))
    write_restart(tmp_path / "restart.h5", ARRAYS, ATTRIBUTES)
    assert seen == ["file", "name", "folder"][: 3 if hasattr(os, "O_DIRECTORY") else 2]


def kind(descriptor):
    return "folder" if Path(f"/proc/self/fd/{descriptor}").is_dir() else "file"
