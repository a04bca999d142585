"""Lattices: what a stencil reads of a system is exactly its connections."""

import numpy as np
import problems
import pytest
from stencils import lattice_of

from msdwarp import System, box, chain, sheet
from msdwarp.engine.model.lattice import NotALattice, find_lattice

SHAPES = {
    "pair": ((2,), 2, chain(2)),
    "chain": ((7,), 2, chain(7, 0.5, dim=1)),
    "sheet 4": ((5, 3), 4, sheet((5, 3), 0.3, neighbors=4)),
    "sheet 8": ((5, 3), 8, sheet((5, 3), 0.3, dim=2)),
    "smallest sheet": ((2, 2), 8, sheet((2, 2))),  # x−y leads one particle back, as x leads one ahead
    "ladder along x": ((5, 2), 8, sheet((5, 2))),
    "ladder along y": ((2, 5), 8, sheet((2, 5))),
    "box 6": ((3, 4, 5), 6, box((3, 4, 5), neighbors=6)),
    "box 26": ((3, 4, 5), 26, box((3, 4, 5), 0.1)),
    # In these, other directions lead equally far through memory: in 2 × 2 × n both y−z and −x−y lead to −2.
    "smallest box": ((2, 2, 2), 26, box((2, 2, 2))),
    "bar along x": ((5, 2, 2), 26, box((5, 2, 2))),
    "bar along y": ((2, 5, 2), 26, box((2, 5, 2))),
    "bar along z": ((2, 2, 5), 26, box((2, 2, 5))),
    "thin bar 6": ((2, 2, 5), 6, box((2, 2, 5), neighbors=6)),
    "plate": ((3, 2, 4), 26, box((3, 2, 4))),
    "oblong cells": ((3, 4, 5), 26, box((3, 4, 5), (0.1, 0.25, 0.4))),
}
every_shape = pytest.mark.parametrize(("shape", "neighbours", "system"), SHAPES.values(), ids=SHAPES.keys())


@every_shape
def test_a_shape_is_a_lattice_of_one_kind(shape, neighbours, system):
    lattice = lattice_of(system)
    assert lattice.uniform
    assert len(lattice.steps) == neighbours // 2
    assert not lattice.kind.any()
    assert lattice.constants["rest_length"].shape == (1, neighbours // 2)


@every_shape
def test_stride_leads_to_the_next_layer(shape, neighbours, system):
    along_x, along_y, _ = (*shape, 1, 1)[:3]
    assert find_lattice(system).stride == {1: 0, 2: along_x, 3: along_x * along_y}[len(shape)]


def skewed() -> System:
    """Return particles that are a lattice by their numbers alone: y and z lead 5 and 20 further, y+z leads 27."""
    steps = {"y": 5, "z": 20, "y+z": 27}
    connections = [np.stack([np.arange(60 - step), np.arange(step, 60)], axis=1) for step in steps.values()]
    ends = np.cumsum([0, *map(len, connections)])
    return System(
        position=np.random.default_rng(9).normal(size=(60, 3)),
        connections=np.concatenate(connections),
        rest_length=1.0,
        directions=({name: slice(*ends[k : k + 2]) for k, name in enumerate(steps)},),
    )


def test_lattices_whose_layers_do_not_follow_each_other_have_no_stride():
    assert lattice_of(skewed()).uniform
    assert lattice_of(skewed()).stride == 0
    for system in (problems.ball(5), box((3, 3, 3)) + box((3, 4, 3)), box((3, 3, 3)) + sheet((3, 3))):
        assert lattice_of(system).stride == 0
    # Layers that nothing joins.
    layers = problems.cut(box((3, 3, 5)), np.arange(45) // 9 % 2 == 0)
    assert lattice_of(layers).stride == 0


def test_constants_may_differ_from_direction_to_direction():
    system = sheet((4, 3), damping=1.0)
    stiffness = np.zeros(system.connection_count)
    for k, part in enumerate(system.directions[0].values()):
        stiffness[part] = 10.0 + k
    lattice = lattice_of(system.replace(stiffness=stiffness))
    np.testing.assert_array_equal(lattice.constants["stiffness"], [[10, 11, 12, 13]])
    assert lattice.uniform


def test_places_masses_and_pins_do_not_matter():
    plain = box((3, 3, 4))
    random = np.random.default_rng(1)
    moved = plain.replace(position=random.normal(size=(36, 3)), mass=random.uniform(1, 2, 36)).pin([0, 7, 35])
    for a, b in zip(lattice_of(plain), lattice_of(moved), strict=True):
        np.testing.assert_equal(a, b)


# Several bodies, and bodies cut from a lattice.


SEVERAL = {
    "boxes": box((3, 3, 3), 0.2, stiffness=50.0) + box((2, 4, 5), 0.1, stiffness=9.0, damping=1.0),
    "box, sheet and chain": box((3, 3, 3)) + sheet((4, 3), 0.5) + chain(6, 0.3),
    "chain, sheet and box": chain(6, 0.3) + sheet((4, 3), 0.5) + box((3, 3, 3)),
    "box 6 and box 26": box((3, 4, 3), neighbors=6) + box((3, 4, 3)),
    "balls": problems.ball(5) + problems.ball(6, stiffness=20.0),
}


@pytest.mark.parametrize("system", SEVERAL.values(), ids=SEVERAL.keys())
def test_several_bodies_are_lattices_of_several_kinds(system):
    lattice = lattice_of(system)
    assert not lattice.uniform
    assert len(lattice.constants["stiffness"]) == len(np.unique(lattice.kind)) == len(system.directions)


def test_what_has_no_connections_is_no_kind_of_its_own():
    one, alone = box((3, 3, 3)), System(position=[[5.0, 0, 0]])
    for both in (one + alone, alone + one):
        assert lattice_of(both).uniform


@pytest.mark.parametrize("across", [5, 6, 9])
def test_a_ball_cut_from_a_box_is_a_lattice(across):
    ball = problems.ball(across)
    assert 0.2 < ball.particle_count / across**3 < 0.7
    lattice = lattice_of(ball)
    # Rows are not equally long: how far the next one is depends on where one stands.
    assert lattice.shift.ndim == 2
    inner = np.bincount(ball.connections.ravel()) == 26
    assert inner.any()
    assert (lattice.mask[inner] == 2**26 - 1).all()


def test_a_body_with_a_direction_cut_away_is_a_lattice():
    # Every second layer along z is left out, and what joined layers with it.
    block = box((3, 3, 5))
    layers = problems.cut(block, np.arange(45) // 9 % 2 == 0)
    lattice = lattice_of(layers)
    assert lattice.uniform
    upward = [d for d, step in enumerate(lattice.steps) if step[2]]
    assert len(upward) == 9
    for d in upward:
        assert not (lattice.mask & np.uint32(1 << d | 1 << (d + 13))).any()


def test_a_hole_in_a_row_parts_neighbours_that_diagonals_need():
    # Below the hole, the neighbours x+y and −x+y of one particle now lie side by side instead of two apart.
    keep = np.arange(25) != 12
    with pytest.raises(NotALattice, match="do not lie side by side"):
        find_lattice(problems.cut(sheet((5, 5)), keep))
    lattice_of(problems.cut(sheet((5, 5), neighbors=4), keep))  # without diagonals there is one in that row


def test_a_sheet_woven_downwards_is_a_lattice():
    # All of y in reverse: rows are then numbered from the top, which is as good.
    grid = sheet((4, 3), neighbors=4)
    connections = np.array(grid.connections)
    part = grid.direction("y")
    connections[part] = connections[part, ::-1]
    lattice = lattice_of(grid.replace(connections=connections))
    assert lattice.shift.tolist() == [4, 0, -4]
