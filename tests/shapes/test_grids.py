"""Chains, sheets and boxes: how many connections, which, in which order, and the surface around them."""

import itertools

import numpy as np
import pytest
from surfaces import area, areas, assert_closed, volume

import msdwarp as msd
from msdwarp import RUBBER, System, box, chain, lattice, sheet

SHEETS = [(2, 2), (2, 5), (4, 3), (7, 6)]
BOXES = [(2, 2, 2), (3, 2, 4), (2, 5, 3), (4, 4, 4)]


def steps(system: System, shape: tuple[int, ...]) -> np.ndarray:
    """Return the lattice step of each connection, from its particle indices alone (x fastest)."""
    coordinates = np.stack(np.unravel_index(system.connections, shape[::-1]), axis=-1)[..., ::-1]
    return coordinates[:, 1] - coordinates[:, 0]


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_chain_joins_neighbours_along_x(dim):
    system = chain(5, spacing=0.25, dim=dim)
    assert system.position.shape == (5, dim)
    np.testing.assert_array_equal(system.connections, [[0, 1], [1, 2], [2, 3], [3, 4]])
    # Multiples of 0.25 are exact in binary.
    np.testing.assert_array_equal(system.position[:, 0], [-0.5, -0.25, 0.0, 0.25, 0.5])
    assert not system.position[:, 1:].any()
    assert (system.rest_length == 0.25).all()
    assert system.surface is None
    assert system.direction("x") == slice(0, 4)


def test_large_box():
    # A million particles: 3·99·100² along axes, 6·99²·100 along face and 4·99³ along space diagonals.
    system = box((100, 100, 100))
    assert system.particle_count == 1_000_000
    assert system.connection_count == 3 * 99 * 100**2 + 6 * 99**2 * 100 + 4 * 99**3


@pytest.mark.parametrize(
    ("shape", "reach"),
    [*itertools.product(SHEETS, [(4, 1.0), (8, 2**0.5)]), *itertools.product(BOXES, [(6, 1.0), (26, 3**0.5)])],
    ids=str,
)
def test_a_lattice_joins_exactly_its_neighbours_each_pair_once(shape, reach):
    neighbours, far = reach
    system = (sheet if len(shape) == 2 else box)(shape, spacing=1.0, neighbors=neighbours)
    assert system.particle_count == np.prod(shape)
    # From the distances alone, at halves of whole numbers: no other pair of a lattice is as near.
    distance = np.linalg.norm(system.position[:, None] - system.position, axis=-1)
    expected = np.argwhere(np.triu((distance > 0) & (distance < far + 0.1)))
    pairs = np.sort(system.connections, axis=1)
    np.testing.assert_array_equal(pairs[np.lexsort(pairs.T[::-1])], expected)


@pytest.mark.parametrize("spacing", [0.1, 1.0, 3.7])
def test_rest_lengths_are_exact(spacing):
    # Not merely close to the placed length: the same number for all, whatever their positions round to.
    system = box((4, 3, 3), spacing=spacing)
    kind = np.abs(steps(system, (4, 3, 3))).sum(axis=1)
    np.testing.assert_array_equal(system.rest_length, spacing * np.sqrt(kind))
    assert set(kind) == {1, 2, 3}
    # Positions up to 5.6 m round the placed length by a few ε of that.
    np.testing.assert_allclose(system.length, system.rest_length, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("make", "shape"), [(box, (4, 3, 5)), (sheet, (5, 3)), (lattice, None)])
def test_equal_spacings_are_exactly_the_one_number(make, shape):
    given = np.indices((4, 4, 4)).sum(axis=0) < 8 if shape is None else shape
    axes = given.ndim if shape is None else len(shape)
    one = make(given, 0.37, mass=0.1)
    for several in ((0.37,) * axes, [0.37] * axes, np.full(axes, 0.37)):
        other = make(given, several, mass=0.1)
        for name in ("position", "connections", "rest_length", "original_length", "mass", "stiffness"):
            np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
        for name in ("particle", "uv", "triangles"):
            np.testing.assert_array_equal(getattr(other.surface, name), getattr(one.surface, name))
        assert other.directions == one.directions
    made_of_rubber = [sheet((3, 4), s, material=RUBBER, thickness=0.01) for s in (0.2, (0.2, 0.2))]
    for name in ("mass", "stiffness", "damping"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in made_of_rubber))


@pytest.mark.parametrize(
    ("system", "shape", "spacing"),
    [
        (box((4, 3, 3), (0.1, 0.25, 0.7)), (4, 3, 3), (0.1, 0.25, 0.7)),
        (sheet((5, 4), (0.3, 0.1), dim=2), (5, 4), (0.3, 0.1)),
        (lattice(np.ones((3, 3, 4), dtype=bool), (2.0, 1.0, 0.5), neighbors=6), (3, 3, 4), (2.0, 1.0, 0.5)),
    ],
)
def test_each_axis_can_have_a_spacing_of_its_own(system, shape, spacing):
    extent = (np.array(shape) - 1) * spacing
    # Both from products of the spacings: rounding of a few ε of the extent.
    np.testing.assert_allclose(np.ptp(system.position, axis=0), extent, rtol=0, atol=1e-15 * extent.max() * 4)
    placed = np.sqrt(((steps(system, shape) * spacing) ** 2).sum(axis=1))
    np.testing.assert_allclose(system.rest_length, placed, rtol=1e-15 * 4)  # roots and squares in another order
    for axis, name in enumerate("xyz"[: len(shape)]):
        assert (system.rest_length[system.direction(name)] == spacing[axis]).all()  # exactly
    if len(shape) == 3:
        assert volume(system) == pytest.approx(np.prod(extent), rel=1e-12)  # sums of some hundred products


def test_connections_are_ordered_by_direction_and_length():
    shape = (4, 3, 3)
    system = box(shape)
    names = list(system.directions[0])
    assert names[:3] == ["x", "y", "z"]
    slices = list(system.directions[0].values())
    assert slices[0].start == 0
    assert slices[-1].stop == system.connection_count
    assert all(a.stop == b.start for a, b in itertools.pairwise(slices))
    assert (np.diff(system.rest_length) >= 0).all()
    for part in slices:
        assert len(np.unique(steps(system, shape)[part], axis=0)) == 1


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("x", (1, 0, 0)),
        ("z", (0, 0, 1)),
        ("x+y", (1, 1, 0)),
        ("x-y", (1, -1, 0)),
        ("y-z", (0, 1, -1)),
        ("x+y+z", (1, 1, 1)),
        ("x-y+z", (1, -1, 1)),
    ],
)
def test_direction_slices_by_name(name, step):
    system = box((4, 3, 5), spacing=2.0)
    i, j = system.connections[system.direction(name)].T
    expected = np.broadcast_to(2.0 * np.array(step), (len(i), 3))
    np.testing.assert_array_equal(system.position[j] - system.position[i], expected)


def test_unknown_direction_lists_the_known_ones():
    with pytest.raises(KeyError, match=r"'z' is unknown.*x, y, x\+y, x-y"):
        sheet((2, 2)).direction("z")


def test_particles_are_numbered_x_fastest_and_centred():
    position = box((3, 2, 2), spacing=2.0).position
    np.testing.assert_array_equal(position[:4], [[-2, -1, -1], [0, -1, -1], [2, -1, -1], [-2, 1, -1]])
    np.testing.assert_array_equal(position[6], [-2, -1, 1])
    np.testing.assert_array_equal(position.mean(axis=0), 0)


@pytest.mark.parametrize("shape", SHEETS)
def test_sheet_surface_covers_it_facing_up(shape):
    system = sheet(shape, spacing=1.0)
    # Lattice points at half integers: areas are exact.
    np.testing.assert_array_equal(areas(system), np.broadcast_to((0, 0, 0.5), areas(system).shape))
    assert len(areas(system)) == 2 * (shape[0] - 1) * (shape[1] - 1)
    np.testing.assert_array_equal(np.unique(system.surface.particle), np.arange(system.particle_count))
    # Texture coordinates grow with x and y from 0 to 1.
    x = system.position[system.surface.particle, :2]
    scaled = (x - x.min(axis=0)) / np.ptp(x, axis=0)
    np.testing.assert_allclose(system.surface.uv, scaled, rtol=0, atol=1e-15)  # one rounding


@pytest.mark.parametrize("shape", BOXES)
def test_box_surface_is_closed_and_encloses_its_volume_facing_out(shape):
    system = box(shape, spacing=1.0)
    assert_closed(system)
    assert volume(system) == pytest.approx(np.prod([n - 1 for n in shape]), rel=1e-12)  # ~100 sums of size 1
    a, b, c = (n - 1 for n in shape)
    assert area(system) == pytest.approx(2 * (a * b + b * c + c * a), rel=1e-12)


def test_each_box_face_has_a_tile_of_its_own():
    system = box((3, 4, 5))
    surface = system.surface
    normal = areas(system)
    tiles = {}
    for axis, side in itertools.product(range(3), (-1, 1)):
        face = normal[:, axis] * side > 0.1
        uv = surface.uv[surface.triangles[face]]
        # The middle of a face's texture says which of 3 × 2 tiles it is; its corners reach that tile's.
        tile = tuple(np.floor(uv.mean(axis=(0, 1)) * (3, 2)).astype(int))
        tiles[axis, side] = tile
        low, high = np.array(tile) / (3, 2), (np.array(tile) + 1) / (3, 2)
        np.testing.assert_allclose(uv.min(axis=(0, 1)), low, rtol=0, atol=1e-15)  # rounding of thirds
        np.testing.assert_allclose(uv.max(axis=(0, 1)), high, rtol=0, atol=1e-15)
    documented = {(0, -1): (0, 0), (0, 1): (1, 0), (1, -1): (2, 0)}
    documented |= {(1, 1): (0, 1), (2, -1): (1, 1), (2, 1): (2, 1)}
    assert tiles == documented


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: chain(1), "count is 1"),
        (lambda: chain(2.5), "count is 2.5"),
        (lambda: chain(3, dim=4), "dim is 4"),
        (lambda: chain(3, spacing=0.0), "spacing is 0"),
        (lambda: sheet((4, -2)), r"shape\[1\] is -2"),
        (lambda: sheet((4, 4, 4)), r"shape is \(4, 4, 4\)"),
        (lambda: sheet((4, 4), neighbors=6), "neighbors is 6"),
        (lambda: sheet((4, 4), dim=1), "dim is 1"),
        (lambda: box((2, 2, 2.0)), r"shape\[2\] is 2\.0"),
        (lambda: box((2, 2, True)), r"shape\[2\] is True"),
        (lambda: box((2, 2, 2), neighbors=18), "neighbors is 18"),
        (lambda: box((2, 2, 2), spacing="wide"), "spacing is 'wide'"),
        (lambda: box((2, 2, 2), (1.0, 2.0)), r"spacing is \(1.0, 2.0\); it must be a number, or 3: one for"),
        (lambda: box((2, 2, 2), spacing=(1.0, 0.0, 1.0)), r"spacing\[1\] is 0; it must be a number above 0"),
        (lambda: sheet((2, 2), spacing=(1.0, "a")), r"spacing\[1\] is 'a'"),
        (lambda: chain(3, spacing=(1.0,)), r"spacing is \(1.0,\)"),
        (lambda: box((2, 2, 2), (1.0, 1.0, 2.0), material=RUBBER), "with a material it must be the same along a"),
        (lambda: box((2, 2, 2), mass=0.0), r"mass is 0"),
        (lambda: box((2, 2, 2), stiffness=-1.0), r"stiffness is -1"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("diagonals", [False, True])
@pytest.mark.parametrize("shape", [(2, 5), (4, 3), (3, 2, 4)])
def test_a_lattice_without_gaps_is_a_sheet_or_a_box(shape, diagonals):
    make = sheet if len(shape) == 2 else box
    neighbours = {2: (4, 8), 3: (6, 26)}[len(shape)][diagonals]
    constants = {"mass": 0.1, "stiffness": 20.0, "damping": 0.3}
    found = lattice(np.ones(shape, dtype=bool), 0.3, neighbors=neighbours, **constants)
    expected = make(shape, 0.3, neighbors=neighbours, **constants)
    for name in ("position", "connections", "rest_length", "mass", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.directions == expected.directions
    for name in ("particle", "uv", "triangles"):
        np.testing.assert_array_equal(getattr(found.surface, name), getattr(expected.surface, name))


def test_a_body_that_does_not_fit_into_memory_is_refused_before_it_is_made():
    with pytest.raises(ValueError, match=r"shape is \(100000, .*1e\+15 particles .* GB of memory"):
        box((100_000, 100_000, 100_000))
    with pytest.raises(ValueError, match=r"shape is .* GB of memory"):
        sheet((10**9, 10**9))
    with pytest.raises(ValueError, match=r"count is .* GB of memory"):
        chain(10**15)
    with pytest.raises(ValueError, match=r"shape\[0\] is 10+ .*; it must be at most 1e\+18"):
        sheet((10**200, 10**200))


SHARED = {
    "chain": (msd.chain, (4,)),
    "sheet": (msd.sheet, ((3, 4),)),
    "box": (msd.box, ((3, 4, 2),)),
    "lattice": (msd.lattice, (np.ones((3, 3), dtype=bool),)),
    "ball": (msd.ball, (0.3, 0.1)),
    "cylinder": (msd.cylinder, (0.3, 0.2, 0.1)),
    "cone": (msd.cone, (0.3, 0.4, 0.1)),
    "cloth": (msd.cloth, ([[0, 0], [1, 0], [0.5, 1]], 0.2)),
    "from_mesh": (msd.from_mesh, (msd.icosphere(0.3, 2), 0.1)),
    "from_volume": (
        lambda **given: msd.from_volume(pytest.importorskip("pyvista").Sphere(radius=0.3), 0.1, **given),
        (),
    ),
}
SECTIONS = {"chain": {"area": 0.1}} | {name: {"thickness": 0.1} for name in ("sheet", "lattice", "cloth")}


@pytest.mark.parametrize("name", SHARED)
def test_mass_is_that_of_each_particle_and_total_mass_that_of_the_body(name):
    make, size = SHARED[name]
    body = make(*size, mass=0.2)
    np.testing.assert_array_equal(body.mass, 0.2)
    np.testing.assert_array_equal(make(*size, total_mass=3.0).mass, 3.0 / body.particle_count)
    for wrong, said in (
        ({"mass": 0.2, "total_mass": 3.0}, r"total_mass is 3\.0; with mass"),
        ({"total_mass": -1.0}, "total_mass is -1"),
        (
            {"total_mass": 1.0, "material": msd.FOAM, **SECTIONS.get(name, {})},
            r"total_mass is 1\.0; with a material",
        ),
    ):
        with pytest.raises(ValueError, match=said):
            make(*size, **wrong)
