"""Files that a disk has damaged, or that someone has made so: they are refused in a way that ends."""

import json
import os
import shutil

import h5py
import numpy as np
import pytest
from trajectories import SYSTEMS, drawing_of, write

from msdwarp import Trajectory, TrajectoryWriter
from msdwarp.files import export, probe, read_restart, write_restart


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes={"note": "x" * 9000})


def changed(path, change):
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put(file, name, value):
    """Store something, as other programs may, in the place of what is there."""
    del file[name]
    file[name] = value


def as_before(file):
    """Store the texts as earlier versions did: in a heap without checksums."""
    for name in ("attributes", "description"):
        text = file["msdwarp"][name][()].decode()
        del file["msdwarp"][name]
        file["msdwarp"][name] = text


def lose_a_page_of_the_heap(path):
    whole = bytearray(path.read_bytes())
    start = whole.index(b"GCOL") + 16  # behind its head, where sizes of 0 follow each other for ever
    whole[start : start + 4080] = bytes(4080)
    path.write_bytes(whole)


@pytest.mark.slow
def test_a_lost_page_on_which_hdf5_does_not_come_back_is_told(msdwarp, path):
    changed(path, as_before)
    probe(path)
    lose_a_page_of_the_heap(path)
    code, out, err = msdwarp("info", "a.vtkhdf")
    assert (code, out) == (1, "")
    assert err.startswith("error: a.vtkhdf is damaged: reading its structures does not end")


def test_new_files_have_no_texts_in_a_heap_without_checksums(path):
    assert b"GCOL" not in path.read_bytes()


@pytest.mark.slow
def test_what_lies_outside_is_not_followed(tmp_path, path):
    other = shutil.copy(path, tmp_path / "other.vtkhdf")

    def out(file):
        del file["VTKHDF/Points"]
        file["VTKHDF/Points"] = h5py.ExternalLink(str(other), "VTKHDF/Points")

    def soft(file):
        file["VTKHDF/again"] = h5py.SoftLink("/VTKHDF/Points")

    def virtual(file):
        source = h5py.VirtualSource(str(other), "VTKHDF/Points", shape=file["VTKHDF/Points"].shape)
        layout = h5py.VirtualLayout(source.shape, "f4")
        layout[:] = source
        del file["VTKHDF/Points"]
        file["VTKHDF"].create_virtual_dataset("Points", layout)

    def raw(file):
        del file["msdwarp/system/mass"]
        place = [(str(other), 0, h5py.h5f.UNLIMITED)]
        file["msdwarp/system"].create_dataset("mass", shape=(36,), dtype="f8", external=place)

    whole = path.read_bytes()
    for change, said in [(out, "is a link"), (soft, "is a link"), (virtual, "other files"), (raw, "other files")]:
        path.write_bytes(whole)
        changed(path, change)
        for look in (probe, Trajectory):
            with pytest.raises(ValueError, match=rf"a\.vtkhdf cannot be read: .*{said}"):
                look(path)


def test_sizes_that_the_file_does_not_have_are_not_believed(path):
    def mass(file):
        del file["msdwarp/system/mass"]
        file["msdwarp/system"].create_dataset("mass", shape=(2 << 30,), dtype="f8", chunks=(1 << 20,))

    def points(file):
        file["VTKHDF/Points"].resize(10**9, axis=0)
        file["VTKHDF/PointData/velocity"].resize(10**9, axis=0)
        file["VTKHDF/Steps/Values"].resize(10**9, axis=0)
        file["VTKHDF/Steps"].attrs["NSteps"] = 10**9

    whole = path.read_bytes()
    for change, said in [(mass, r"system/mass' should hold 17179869184 bytes, and 0 are there"), (points, "hold")]:
        path.write_bytes(whole)
        changed(path, change)
        with pytest.raises(ValueError, match=said):
            Trajectory(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda file: put(file, "VTKHDF/NumberOfPoints", [0]), "36 particles among 0 points"),
        (lambda f: f["VTKHDF/NumberOfPoints"].write_direct(np.array([0])), "it is not what its checksum is of"),
        (lambda file: file["msdwarp"].attrs.modify("dim", 7), "dim is 7; it must be one of 1, 2, 3"),
        (lambda file: file["msdwarp"].attrs.modify("fps", 0.0), "fps is 0; it must be a number above 0"),
        (lambda file: file["msdwarp"].attrs.modify("fps", np.nan), "fps is nan; it must be a number above 0"),
        (lambda file: file["msdwarp"].attrs.modify("particle_count", -3), "-3 particles among 36 points"),
    ],
)
def test_numbers_that_cannot_be_are_told(path, change, said):
    changed(path, change)
    with pytest.raises(ValueError, match=rf"damaged trajectory: .*{said}"):
        Trajectory(path)


@pytest.mark.parametrize(
    ("mark", "spoiled"),
    [
        (
            b"TREE",
            lambda node, at: node[:5] + b"\1" + node[6:32] + at.to_bytes(8, "little"),
        ),  # its child is itself
        (b"BTLF", lambda node, at: node[:30] + b"\xff"),
    ],
)
def test_links_that_lead_in_a_circle_or_are_lost_are_told(path, mark, spoiled):
    whole = path.read_bytes()
    place = whole.rindex(mark)
    node = spoiled(whole[place:], place)
    path.write_bytes(whole[:place] + node + whole[place + len(node) :])
    with pytest.raises(
        ValueError, match=r"a\.vtkhdf cannot be read: .*(Link iteration failed|cyclic B-tree)"
    ) as told:
        Trajectory(path)
    path.write_bytes(whole)
    assert Trajectory(path).system.particle_count == 36, told  # and the file is closed while the error is there


@pytest.mark.slow
def test_a_pipe_is_not_waited_for(tmp_path):
    """Nobody writes into it: reading would never end."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("needs named pipes")
    os.mkfifo(tmp_path / "pipe")
    probe(tmp_path / "pipe")
    for read in (Trajectory, read_restart):
        with pytest.raises(ValueError, match="it is no HDF5 file"):
            read(tmp_path / "pipe")


@pytest.mark.slow
def test_what_there_is_once_has_checksums(tmp_path, path):
    scene = ({"look": {}}, {"image": np.arange(5000)})
    write(path, SYSTEMS["box"], 3, attributes={"note": "x"}, scene=scene, force=True)
    names, whole = [], path.read_bytes()
    with h5py.File(path) as file:
        file.visit(names.append)
        names = [n for n in names if isinstance(file[n], h5py.Dataset) and "crc32" in file[n].attrs]
    assert len(names) > 20
    unread = ("VTKHDF/Polygons/", "VTKHDF/Vertices/", "VTKHDF/Strips/", "Ids", "Offsets")  # VTK's alone
    for name in names:
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            value = file[name][()]
            if not np.size(value) or (any(one in name for one in unread) and "NumberOfCells" not in name):
                continue
            file[name][()] = (
                value[:-1] + b"?" if isinstance(value, bytes) else np.where(np.isinf(value), 0, value + 1)
            )
        said = f"damaged trajectory: .*/{name} is damaged: it is not what its checksum is of"
        with pytest.raises(ValueError, match=said), Trajectory(path) as found:
            _ = found.system, found.scene


@pytest.mark.parametrize("name", ["Steps/PointOffsets", "Steps/Values", "Points", "CellData/strain"])
def test_a_file_that_cannot_grow_is_not_gone_on_with(path, name):
    def spoil(file):
        values = file["VTKHDF"][name][()]
        put(file, f"VTKHDF/{name}", values)

    changed(path, spoil)
    with pytest.raises(
        ValueError, match=rf"a\.vtkhdf is a damaged trajectory: no rows can be added to its .*{name[-6:]}"
    ):
        TrajectoryWriter(path, SYSTEMS["box"], fps=60, behind=3)


def test_positions_that_are_no_numbers_are_not_exported(path, tmp_path):
    def spoil(file):
        file["VTKHDF/Points"][36 + 5, 1] = np.nan

    changed(path, spoil)
    with Trajectory(path) as found:
        for to in ("obj", "npz", "glb"):
            with pytest.raises(ValueError, match=r"frame 1 of .* is damaged: position\[5, 1\] is nan"):
                export(found, tmp_path / f"b.{to}", to, draw=drawing_of(found))
            assert not (tmp_path / "b_0001.obj").exists()
        export(found, tmp_path / "c.npz", "npz", 2)


@pytest.mark.slow
def test_a_file_of_no_frames_is_told(msdwarp, path):
    changed(path, lambda file: file["VTKHDF/Steps"].attrs.modify("NSteps", 0))
    assert "no frames" in msdwarp("info", "a.vtkhdf")[1]
    assert "has no frames to export" in msdwarp("export", "a.vtkhdf", "--to", "obj")[2]
    assert "has no frames to draw" in msdwarp("render", "a.vtkhdf")[2]


@pytest.mark.slow
def test_a_terminal_is_not_told_what_to_do(msdwarp, tmp_path):
    about = {"scene": "\x1b[2Jcube", "parameters": {"\x1b]0;x\x07": "\u202e"}, "note\x1b": "a\nb"}
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes=about)
    out = msdwarp("info", "a.vtkhdf")[1]
    assert out.replace("\n", "").isprintable()
    assert r"scene: \x1b[2Jcube" in out
    err = msdwarp("render", "a.vtkhdf", "--video", "none", "--resolution", "128x72")[2]
    assert err.replace("\n", "").isprintable()


@pytest.mark.slow
@pytest.mark.parametrize(
    "about", [{"options": "x"}, {"command": 3}, {"gravity": "x"}, {"script": []}, {"versions": {}, "device": []}]
)
def test_what_no_run_says_of_itself_is_told(msdwarp, tmp_path, about):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes=about)
    code, out, err = msdwarp("info", "a.vtkhdf")
    assert (code, out) == (1, "")
    assert err.startswith("error: a.vtkhdf has attributes that no run writes: ")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"options": []}, "the run's options is []; it must be a mapping"),
        ({"options": {"pictures": 3}}, "the run's pictures is 3; it must be a mapping"),
        ({"options": {"fps": {}}}, "the run's fps is {}, which no run stores"),
        ({"options": {"every": True}}, "the run's every is True, which no run stores"),
        ({"options": {"force_algorithm": ["auto"]}}, "the run's force_algorithm is ['auto'], which no run stores"),
        ({"options": {"out": 3}}, "the run's out is 3, which no run stores"),
        ({"parameters": "x" * 9999}, "parameters of the file is 'xxx"),
        ({"device": {}}, "the run's device is {}, which no run stores"),
    ],
)
def test_a_file_asks_for_nothing_that_a_run_cannot(msdwarp, tmp_path, changes, said):
    about = {"scene": "cube", "parameters": {"size": 3}, "options": {"fps": 60.0}, "device": "cpu"} | changes
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes=about)
    code, _, err = msdwarp("rerun", "a.vtkhdf")
    assert (code, err[:7], len(err) < 500) == (1, "error: ", True)
    assert said in err


@pytest.mark.parametrize("text", ["[]", "{}", '{"shapes": 3}', '{"shapes": {"x": {"a": 1}}, "attributes": {}}'])
def test_a_restart_file_that_says_nothing_of_its_arrays_is_told(tmp_path, text):
    write_restart(tmp_path / "restart.h5", {"x": np.arange(3.0)}, {})
    with h5py.File(tmp_path / "restart.h5", "r+") as file:
        put(file, "description", np.frombuffer(text.encode(), np.uint8))
    with pytest.raises(ValueError, match=r"restart\.h5 is damaged: "):
        read_restart(tmp_path / "restart.h5")


def test_errors_do_not_tell_a_terminal_what_to_do(msdwarp):
    assert r"error: file is \x1b[2Jx.vtkhdf, which does not exist" in msdwarp("info", "\x1b[2Jx.vtkhdf")[2]
    assert r"\x1b]0;x" in msdwarp("\x1b]0;x")[2]


@pytest.mark.slow
def test_a_restart_file_that_lacks_something_is_told(msdwarp, tmp_path):
    from msdwarp.cli.commands.stored_runs import resume_run

    short = ("--size", "3", "--duration", "0.05", "--frames", "none", "--video", "none", "--device", "cpu")
    assert msdwarp("run", "cube", *short)[0] == 0
    path, longer = tmp_path / "out" / "cube" / "restart.h5", ("--duration", "0.1")
    arrays, whole = read_restart(path)
    for part, name in (("run", "scene"), ("run", "digest"), ("run", "options"), ("checkpoint", "frame_index")):
        spoiled = json.loads(json.dumps(whole))
        del spoiled[part][name]
        write_restart(path, arrays, spoiled)
        with pytest.raises(ValueError, match=f"lacks '{name}'"):
            resume_run(tmp_path / "out" / "cube", quiet=True)
    write_restart(path, arrays, whole | {"checkpoint": "x" * 9999})
    code, _, err = msdwarp("resume", "out/cube", *longer)
    assert (code, "restart.h5: checkpoint is " in err, len(err) < 500) == (1, True, True)
    write_restart(path, arrays, whole | {"run": whole["run"] | {"options": []}})
    assert "the run's options is []; it must be a mapping" in msdwarp("resume", "out/cube", *longer)[2]
    spoiled = json.loads(json.dumps(whole))
    spoiled["checkpoint"]["rates.damping"] = {}
    write_restart(path, arrays, spoiled)
    assert (
        "rates.damping of the checkpoint is {}; it must be a number" in msdwarp("resume", "out/cube", *longer)[2]
    )
    write_restart(path, arrays | {"system.mass": np.array(1.0)}, whole)
    assert "checkpoint is of another system: its mass has shape ()" in msdwarp("resume", "out/cube", *longer)[2]
    spoiled = json.loads(json.dumps(whole))
    spoiled["checkpoint"]["substeps"] = 10**9
    write_restart(path, arrays, spoiled)
    assert "it must be at most 100000" in msdwarp("resume", "out/cube", *longer)[2]
