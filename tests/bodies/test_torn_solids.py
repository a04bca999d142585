"""Torn solids: what is seen of them is the surface of the cells that hang together."""

import numpy as np
import pytest

from msdwarp import box, lattice, sheet
from msdwarp.bodies import laid_bare
from msdwarp.bodies.torn_surfaces import cells_of, cells_parted_at
from msdwarp.pictures.dressing import torn


def torn_at_random(neighbours, share):
    """Return a body, turned, of whose connections some are broken from the start and some later."""
    body = box((5, 4, 3), 0.1, neighbors=neighbours).rotate(0.4, (1, 2, 3))
    random = np.random.default_rng(1)
    time = random.choice(
        [0.0, *random.uniform(0, 1, 5), np.inf], body.connection_count, p=[share / 6] * 6 + [1 - share]
    )
    return body.replace(broken_at=time)


def seen(system, time):
    """Return the particles of triangles that are drawn when what broke before `time` has, shape [any, 3]."""
    found = torn(system)
    assert found is not None
    own = system.surface.particle[system.surface.triangles][found.parted_at >= time]
    return np.concatenate([own, found.triangles[(found.since < time) & (found.until >= time)]])


def volume(position, triangles):
    return np.linalg.det(position[triangles]).sum() / 6


@pytest.mark.parametrize(("neighbours", "share"), [(26, 0.87), (6, 0.4)])
@pytest.mark.parametrize("time", [0.6, 0.95, 1.0])
def test_what_is_seen_is_closed_and_holds_the_cells_that_hang_together(neighbours, share, time):
    body = torn_at_random(neighbours, share)
    cells = cells_of(body)
    assert cells.shape == (4 * 3 * 2, 8)
    whole = np.count_nonzero(cells_parted_at(body, cells) >= time)
    assert 0 < whole < len(cells)
    triangles = seen(body, time)
    # Each edge is passed as often one way as the other.
    edges, n = triangles[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2), body.particle_count
    there, back = (np.bincount(pairs @ (n, 1), minlength=n * n) for pairs in (edges, edges[:, ::-1]))
    np.testing.assert_array_equal(there, back)
    # rounding of sums of some hundred terms
    assert volume(body.position, triangles) == pytest.approx(whole * 0.1**3, rel=1e-12)


def test_a_cell_parts_as_the_last_path_between_two_corners_breaks():
    cube = box((2, 2, 2), 0.1)
    one = (cube.connections == 7).any(axis=1)
    time = np.where(one, np.arange(cube.connection_count) + 1.0, np.inf)
    [parted] = cells_parted_at(cube.replace(broken_at=time), cells_of(cube))
    assert parted == time[one].max()  # a corner hangs on until its seventh connection breaks
    six = np.where(np.cumsum(one) > 6, np.inf, time)
    [parted] = cells_parted_at(cube.replace(broken_at=six), cells_of(cube))
    assert parted == np.inf


def test_bodies_in_one_system_keep_their_cells_apart():
    two = box((3, 3, 3), 0.1) + sheet((4, 4), 0.1).translate((0, 0, 1)) + box((2, 3, 4), 0.1).translate((1, 0, 0))
    assert two.surface is not None
    surface = two.surface
    two = two.replace(broken_at=np.where((two.connections < 27).all(axis=1), 0.5, np.inf))
    assert len(cells_of(two)) == 8 + 1 * 2 * 3
    found = torn(two)
    assert found is not None
    gone = np.isfinite(found.parted_at)
    assert gone.tolist() == (surface.particle[surface.triangles] < 27).all(axis=1).tolist()
    assert len(found.triangles) == 0  # all of a body's cells part at once: nothing is laid bare


def test_a_body_with_a_hole_has_no_cells_there():
    mask = np.ones((4, 4, 4), dtype=bool)
    mask[1, 1, 1] = False
    assert len(cells_of(lattice(mask, 0.1))) == 27 - 8


def test_what_is_no_solid_is_left_to_its_edges():
    flat = sheet((3, 3), 0.1)
    flat = flat.replace(broken_at=np.where((flat.connections == 0).any(axis=1), 0.5, np.inf))
    found = laid_bare(flat)
    assert np.isnan(found.parted_at).all()
    assert len(found.triangles) == 0
