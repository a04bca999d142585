"""Bodies from mesh files: filled where the file's part is, with its named sets as groups."""

import numpy as np
import pytest

import msdwarp as msd

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
