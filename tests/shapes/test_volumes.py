"""Bodies from mesh files: filled where the file's part is, with its named sets as groups."""

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.shapes import volumes

pv = pytest.importorskip("pyvista")
meshio = pytest.importorskip("meshio")

SIZE = 50.0, 30.0, 30.0  # mm


def part() -> "pv.UnstructuredGrid":
    """Return a block of tetrahedra [mm]."""
    return pv.ImageData(dimensions=(6, 4, 4), spacing=(10, 10, 10)).cast_to_unstructured_grid().triangulate()


def gmsh_file(tmp_path):
    """Write the block, its left face and a volume as Gmsh's physical groups."""
    x, tetrahedra = part().points, part().cells_dict[10]
    faces = np.concatenate([tetrahedra[:, one] for one in ([0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3])])
    left = faces[(x[faces, 0] == 0).all(axis=1)]
    tags = {"gmsh:physical": [np.full(len(tetrahedra), 1), np.full(len(left), 2)]}
    tags["gmsh:geometrical"] = tags["gmsh:physical"]
    names = {"body": np.array([1, 3]), "left": np.array([2, 2]), "none": np.array([3, 2])}
    mesh = meshio.Mesh(x, [("tetra", tetrahedra), ("triangle", left)], cell_data=tags, field_data=names)
    mesh.write(tmp_path / "part.msh", file_format="gmsh22")
    return tmp_path / "part.msh"


def abaqus_file(tmp_path):
    """Write the block as an Abaqus file, with a set of elements and one of nodes."""
    x, corners = part().points, 1 + part().cells_dict[10]
    lines = ["*NODE", *(f"{k + 1}, {a}, {b}, {c}" for k, (a, b, c) in enumerate(x))]
    lines += ["*ELEMENT, TYPE=C3D4, ELSET=body"]
    lines += [", ".join(map(str, (k + 1, *one))) for k, one in enumerate(corners)]
    lines += ["*NSET, NSET=left", ", ".join(str(k + 1) for k in np.flatnonzero(x[:, 0] == 0))]
    (tmp_path / "part.inp").write_text("\n".join(lines) + "\n")
    return tmp_path / "part.inp"


@pytest.mark.parametrize("write", [gmsh_file, abaqus_file])
def test_named_sets_are_groups(tmp_path, write):
    body = msd.from_volume(write(tmp_path), across=5, scale=1e-3, material=msd.CORK)
    assert body.position.shape == (6 * 4 * 4, 3)
    np.testing.assert_allclose(np.ptp(body.position, axis=0), 1e-3 * np.array(SIZE), rtol=1e-6)
    assert body.mass.sum() == pytest.approx(msd.CORK.density * 1e-9 * np.prod(SIZE), rel=1e-6)
    assert set(body.groups) == {"body", "left"}
    assert body.group("body").all()
    np.testing.assert_array_equal(body.group("left"), body.position[:, 0] < body.position[:, 0].min() + 1e-6)
    assert len(body.cells) == 5 * 3 * 3


def test_grids_and_other_cells(tmp_path):
    hexahedra = pv.ImageData(dimensions=(6, 4, 4), spacing=(10, 10, 10)).cast_to_unstructured_grid()
    hexahedra.save(tmp_path / "part.vtu")
    for mesh in (hexahedra, tmp_path / "part.vtu", str(tmp_path / "part.vtu"), pv.Box((0, 50, 0, 30, 0, 30))):
        body = msd.from_volume(mesh, 10.0)
        assert body.position.shape == (6 * 4 * 4, 3)
        assert not body.groups


def physical(lines: list[str], order: int, groups: bool) -> str:
    """Return the text of a .msh file of version 4.1, as Gmsh writes: a tetrahedron of unit edges and a face."""
    x = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    pairs = [(0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)]
    parts = [(np.array(x[a]) * (3 - k) + np.array(x[b]) * k) / 3 for a, b in pairs for k in (1, 2)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (3, 1, 2)]
    parts += [np.mean([x[k] for k in face], axis=0) for face in faces]
    x = x + parts if order == 3 else x
    kind, face = {1: (4, 2), 3: (29, 21)}[order]
    of_face = [*range(3), *range(4, 10), 16] if order == 3 else [0, 1, 2]
    tags = ("1 5", "1 7") if groups else ("0", "0")
    lines += ["$MeshFormat", "4.1 0 8", "$EndMeshFormat"]
    if groups:
        lines += ["$PhysicalNames", "2", '2 5 "left"', '3 7 "body"', "$EndPhysicalNames"]
    lines += ["$Entities", "0 0 1 1", f"1 0 0 0 1 1 0 {tags[0]} 0", f"1 0 0 0 1 1 1 {tags[1]} 1 1", "$EndEntities"]
    lines += ["$Nodes", f"1 {len(x)} 1 {len(x)}", f"3 1 0 {len(x)}", *(str(k + 1) for k in range(len(x)))]
    lines += [" ".join(map(str, one)) for one in x] + ["$EndNodes", "$Elements", "2 2 1 2"]
    lines += [f"2 1 {face} 1", " ".join(str(k) for k in (1, *(one + 1 for one in of_face)))]
    lines += [f"3 1 {kind} 1", " ".join(str(k + 1) for k in (1, *range(len(x)))), "$EndElements"]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("groups", [True, False])
@pytest.mark.parametrize("order", [1, 3])
def test_files_of_gmsh_4_1_and_of_third_order_are_read(tmp_path, capfd, order, groups):
    (tmp_path / "part.msh").write_text(physical([], order, groups))
    body = msd.from_volume(tmp_path / "part.msh", across=12, material=msd.FOAM)
    assert body.mass.sum() == pytest.approx(msd.FOAM.density / 6, rel=1e-6)
    assert set(body.groups) == ({"left", "body"} if groups else set())
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("begin", ["SOL 101\nCEND\nBEGIN BULK", ""])
def test_free_format_of_nastran_is_read(tmp_path, begin):
    grid = pv.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid()
    corners = grid.cells_dict[11][:, [0, 1, 3, 2, 4, 5, 7, 6]] + 1
    lines = [begin, *(f"GRID,{k + 1},,{a:.1f},{b:.1f},{c:.1f}" for k, (a, b, c) in enumerate(grid.points))]
    for k, one in enumerate(corners):
        lines += [f"CHEXA,{k + 1},1," + ",".join(map(str, one[:6])), f",{one[6]},{one[7]}"]
    (tmp_path / "part.bdf").write_text("\n".join([*lines, "ENDDATA"]) + "\n")
    assert msd.from_volume(tmp_path / "part.bdf", 1.0).particle_count == 27


def test_mirrored_cells_are_turned():
    grid, chosen = part(), np.random.default_rng(0).random(part().n_cells) < 0.5
    cells = grid.cells_dict[10].copy()
    cells[chosen] = cells[chosen][:, [0, 2, 1, 3]]
    body = msd.from_volume(pv.UnstructuredGrid({10: cells}, grid.points), 10.0, material=msd.FOAM)
    assert body.mass.sum() == pytest.approx(msd.FOAM.density * np.prod(SIZE), rel=1e-6)


@pytest.mark.parametrize("kept", [0.0, 0.97])
@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".stl", ".ply", ".obj", ".msh", ".inp", ".bdf"])
def test_damaged_files_are_refused_by_name_and_in_silence(tmp_path, capfd, suffix, kept):
    path, tetrahedra = tmp_path / f"part{suffix}", part().cells_dict[10]
    if suffix in (".vtk", ".vtu"):
        part().save(path)
    elif suffix in (".stl", ".ply", ".obj"):
        volumes._outside(part()).save(path)
    else:
        kind = {".msh": "gmsh", ".inp": "abaqus", ".bdf": "nastran"}[suffix]
        meshio.Mesh(part().points, [("tetra", tetrahedra)]).write(path, file_format=kind)
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    capfd.readouterr()
    with pytest.raises(ValueError, match=f"mesh is '.*part{suffix}'.{{10}}"):
        msd.from_volume(path, across=5)
    assert capfd.readouterr() == ("", "")


def test_what_is_no_part_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere.msh'; it must be the path of a mesh file"):
        msd.from_volume(tmp_path / "nowhere.msh", across=5)
    (tmp_path / "noise.msh").write_bytes(b"\x00\x01noise")
    with pytest.raises(ValueError, match=r"noise.msh', which cannot be read as a mesh"):
        msd.from_volume(tmp_path / "noise.msh", across=5)
    with pytest.raises(ValueError, match="mesh is a int; it must be the path"):
        msd.from_volume(3, across=5)
    with pytest.raises(ValueError, match="none solid nor a face"):
        msd.from_volume(pv.Line(), across=5)
    with pytest.raises(ValueError, match=r"scale is 0.*above 0"):
        msd.from_volume(part(), across=5, scale=0)
