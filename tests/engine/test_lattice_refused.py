"""What is no lattice: it is refused with the reason, and what is not refused is right."""

import numpy as np
import problems
import pytest
from stencils import lattice_of
from tangles import CONSTANTS

from msdwarp import System, box, chain, join, sheet
from msdwarp.engine.model.lattice import NotALattice, find_lattice

GRID, LINE = sheet((4, 3)), chain(5)
DIRECTIONS = GRID.directions[0]


def wired(system: System, connections, directions=None) -> System:
    """Return particles joined otherwise, by springs that are all alike, though the directions may be the old."""
    return System(
        position=system.position,
        connections=connections,
        rest_length=1.0,
        directions=system.directions if directions is None else (directions,),
    )


REFUSED = {
    "frozen when strained": (
        GRID.replace(position=np.random.default_rng(5).normal(size=(12, 3))).set_rest_shape(),
        "rest_length differs",
    ),
    "one stiffer spring": (sheet((4, 3), stiffness=[1.0] * 28 + [2.0]), "stiffness differs"),
    "one damper": (sheet((4, 3), damping=[1.0] * 28 + [2.0]), "damping differs"),
    "no directions": (GRID.replace(directions=({},)), "no connection is in a direction"),
    "no bodies": (GRID.replace(directions=()), "no connection is in a direction"),
    "no connections": (System(position=np.zeros((4, 3))), "no connection is in a direction"),
    "fewer springs than directions say": (wired(GRID, GRID.connections[:-1]), "directions are not slices"),
    "overlapping slices": (wired(LINE, LINE.connections, {"x": slice(0, 3), "y": slice(2, 4)}), "are not slices"),
    "every second connection": (wired(LINE, LINE.connections, {"x": slice(0, 4, 2)}), "are not slices"),
    "another name": (wired(LINE, LINE.connections, {"weft": slice(0, 4)}), "direction 'weft' is none"),
    "a twin": (
        wired(LINE, [[0, 1], [1, 2], [0, 1]], {"x": slice(0, 3)}),
        "two connections in the same direction",
    ),
    "a twin turned round": (wired(LINE, [[0, 1], [1, 2], [1, 0]], {"x": slice(0, 3)}), "side by side"),
    "a chain turned round": (wired(LINE, LINE.connections[:, ::-1]), "side by side"),
    "one connection turned round": (wired(LINE, [[0, 1], [2, 1], [2, 3], [3, 4]]), "side by side"),
    "directions that have changed places": (
        wired(GRID, GRID.connections, DIRECTIONS | {"x+y": DIRECTIONS["x-y"], "x-y": DIRECTIONS["x+y"]}),
        "side by side",
    ),
    "connections of another sheet": (wired(GRID, sheet((3, 4)).connections), "side by side"),
    "particles numbered otherwise": (
        wired(GRID, np.random.default_rng(2).permutation(12)[GRID.connections]),
        "side by side",
    ),
    "unlike bodies with a particle in common": (
        System(
            position=[[0.0], [1], [2]],
            connections=[[0, 1], [1, 2]],
            stiffness=[1.0, 2.0],
            directions=({"x": slice(0, 1)}, {"x": slice(1, 2)}),
        ),
        "share particles",
    ),
}


TIED = {
    "a spring behind the directions": (wired(GRID, [*GRID.connections, (0, 11)]), [29]),
    "a spring before the directions": (wired(chain(2), [[0, 1]], {}) + GRID, [0]),
    "a gap between slices": (wired(LINE, LINE.connections, {"x": slice(0, 2), "x+y": slice(3, 4)}), [2]),
    "a twin behind": (wired(LINE, [*LINE.connections, (0, 1), (1, 0)], LINE.directions[0]), [4, 5]),
    "two bodies and a spring between": (join(LINE, GRID, pairs=[(4, 0)], stiffness=2.0), [33]),
    "a lattice and what is none": (
        join(GRID, System(position=[[5.0, 5, 0]]), pairs=[(3, 0)], stiffness=2.0),
        [29],
    ),
}


@pytest.mark.parametrize(("system", "ties"), TIED.values(), ids=TIED.keys())
def test_what_is_in_no_direction_is_left_over_as_ties(system, ties):
    assert lattice_of(system).ties.tolist() == ties


def test_ties_leave_the_lattices_as_they_were():
    one = box((4, 3, 3), damping=0.5)
    apart = one + one.translate((5.0, 0, 0))
    tied, free = lattice_of(join(one, one.translate((5.0, 0, 0)), within=2.0, stiffness=9.0)), lattice_of(apart)
    assert tied.uniform
    assert (tied.stride, tied.margin, tied.steps) == (free.stride, free.margin, free.steps)
    np.testing.assert_array_equal(tied.mask, free.mask)
    assert len(tied.ties) == 9
    hung = lattice_of(join(one, System(position=[[0.0, 0, -9]]), pairs=[(0, 0)], stiffness=9.0))
    assert hung.uniform  # what hangs on it is no other kind of lattice


@pytest.mark.parametrize(("system", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_what_is_no_lattice_is_refused_with_the_reason(system, message):
    with pytest.raises(NotALattice, match=message):
        find_lattice(system)


SOURCES = [
    chain(6),
    sheet((2, 2)),
    sheet((3, 2)),
    sheet((3, 3), neighbors=4),
    box((2, 2, 2)),
    box((2, 2, 3)),
    box((3, 2, 2), neighbors=6),
    chain(3) + chain(2, 0.5),
    sheet((2, 2)) + sheet((3, 2), 0.5),
    problems.ball(3),
]


def meddle(system: System, random: np.random.Generator) -> System:
    """Return the system with its connections, constants or directions changed in one or two places at random."""
    connections = np.array(system.connections)
    constants = {name: np.array(getattr(system, name)) for name in CONSTANTS}
    directions = [dict(body) for body in system.directions]
    for _ in range(random.integers(1, 3)):
        a, b = random.integers(0, len(connections), 2)
        body = directions[random.integers(0, len(directions))]
        name, other = random.choice(list(body), 2)
        match random.integers(0, 8):
            case 0:
                connections[a] = connections[a, ::-1]
            case 1:
                part = body[name]
                connections[part] = connections[part, ::-1]
            case 2:
                connections[[a, b]] = connections[[b, a]]
            case 3:
                connections[a] = random.choice(system.particle_count, 2, replace=False)
            case 4:
                body[name], body[other] = body[other], body[name]
            case 5:
                i, j = random.choice(system.particle_count, 2, replace=False)
                connections = np.where(connections == i, j, np.where(connections == j, i, connections))
            case 6:
                connections[a] = connections[b]
            case 7:
                constants[str(random.choice(CONSTANTS))][body[name]] *= 2.0
    return system.replace(connections=connections, directions=tuple(directions), **constants)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_meddled_lattice_is_refused_or_still_right(seed):
    random = np.random.default_rng(seed)
    held = refused = 0
    for _ in range(20):
        for source in SOURCES:
            system = meddle(source, random)
            try:
                lattice_of(system)
            except NotALattice:
                refused += 1
            else:
                held += 1
    assert refused > 20
    assert held > 20


def test_more_directions_than_a_mask_has_bits_for_are_no_lattice():
    half = ["x", "y", "z", "x+y", "x-y", "x+z", "x-z", "y+z"]
    names = [*half, *(f"-{name}" for name in half), "y-z"]
    system = System(
        position=np.random.default_rng(0).random((800, 3)),
        connections=[[2 * k, 2 * k + 1] for k in range(400)],
        rest_length=1.0,
        directions=({name: slice(k, k + 1 if k < 16 else 400) for k, name in enumerate(names)},),
    )
    with pytest.raises(NotALattice, match="17 directions"):
        find_lattice(system)
    with pytest.raises(NotALattice):
        find_lattice(system.replace(directions=({"x": slice(0, 400), "y": slice(0, 400)},)))
