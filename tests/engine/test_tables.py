"""Tables that algorithms read: of neighbours, every connection twice, and of the kinds of connections."""

import numpy as np
import pytest

from msdwarp import System, box
from msdwarp.engine.model.model import Model
from msdwarp.engine.springs.force_algorithms import find_kinds, neighbour_table

WIDTH, CHUNK = 32, 4
"""Particles side by side, and slots that are read together."""


def random_system(count: int) -> System:
    """Return particles with few connections or none, and one with many."""
    random = np.random.default_rng(count)
    pairs = [random.choice(count, 2, replace=False) for _ in range(count)]
    hub = [(count // 2, j) for j in range(0, count, 3) if j != count // 2]
    return System(position=random.normal(size=(count, 3)), connections=random.permutation([*pairs, *hub]))


SYSTEMS = {f"{count} particles": random_system(count) for count in (2, 31, 32, 33, 64, 65, 130)}
SYSTEMS |= {
    "box": box((4, 4, 5)),
    "hub": System(
        position=np.eye(3)[[0] * 40], connections=[(7, j) for j in range(40) if j != 7], rest_length=1.0
    ),
    "pair of many": System(position=np.zeros((70, 3)), connections=[(0, 69)], rest_length=1.0),
    "none joined": System(position=np.zeros((5, 3))),
}


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS.keys())
def test_slots_of_a_particle_are_its_connections_in_their_order(plain_device, system):
    model = Model(system, device=plain_device, force_algorithm="gather")
    first, other, connection = (array.numpy() for array in neighbour_table(model))
    n = system.particle_count
    degree = np.bincount(system.connections.ravel(), minlength=n)
    assert len(first) == -(-n // WIDTH) + 1
    assert first[0] == 0
    assert first[-1] == len(connection)
    assert first[-1] + WIDTH * CHUNK <= len(other)  # a chunk more is read, and not used
    seen = np.zeros(len(other), dtype=int)
    for i in range(n):
        slots = np.arange(first[i // WIDTH] + i % WIDTH, first[i // WIDTH + 1], WIDTH)
        seen[slots] += 1
        mine = np.flatnonzero((system.connections == i).any(axis=1))
        padding = len(slots) - len(mine)
        assert connection[slots].tolist() == mine.tolist() + [-1] * padding
        there = system.connections[mine].sum(axis=1) - i
        assert other[slots].tolist() == there.tolist() + [i] * padding
    # What no particle owns pads the last slice, and is read by none; yet it names a particle there is.
    assert (seen <= 1).all()
    assert ((other >= 0) & (other < n)).all()
    # A slice is as long as its fullest particle asks for, in whole chunks.
    for part, length in enumerate(np.diff(first)):
        most = degree[part * WIDTH : (part + 1) * WIDTH].max()
        assert length == -(-most // CHUNK) * CHUNK * WIDTH


def test_the_table_is_the_same_on_every_device(plain_device):
    for system in SYSTEMS.values():
        tables = [
            neighbour_table(Model(system, device=device, force_algorithm="gather"))
            for device in ("cpu", plain_device)
        ]
        for here, there in zip(*tables, strict=True):
            np.testing.assert_array_equal(here.numpy(), there.numpy())


def springs(count: int, **constants) -> System:
    """Return a chain of so many connections."""
    ends = np.arange(count)
    return System(
        position=np.zeros((count + 1, 1)),
        connections=np.stack([ends, ends + 1], axis=1),
        **({"rest_length": 1.0} | constants),
    )


def assert_kinds_are_right(system: System, most: int) -> None:
    """Compare what the table says of each connection with what it has, and count the kinds."""
    table, kind = find_kinds(system)
    assert len(table) <= most
    assert kind.dtype == np.uint8
    for column, name in enumerate(("rest_length", "stiffness", "damping")):
        np.testing.assert_array_equal(table[kind, column], getattr(system, name))


def test_kinds_are_all_that_differ():
    random = np.random.default_rng(6)
    lengths, stiffnesses, dampings = (random.choice(random.uniform(1, 2, n), 9000) for n in (16, 8, 2))
    assert_kinds_are_right(springs(9000, stiffness=7.0, damping=0.5), 1)
    assert_kinds_are_right(springs(9000, rest_length=lengths), 16)
    assert_kinds_are_right(springs(9000, stiffness=stiffnesses, damping=dampings), 16)
    assert_kinds_are_right(springs(9000, rest_length=lengths, damping=dampings), 32)
    assert_kinds_are_right(springs(9000, rest_length=lengths, stiffness=stiffnesses, damping=dampings), 256)
    assert_kinds_are_right(springs(9000, rest_length=lengths, stiffness=stiffnesses), 128)
    assert_kinds_are_right(box((5, 5, 5)), 3)


def test_a_byte_tells_256_kinds_apart():
    assert_kinds_are_right(springs(256, stiffness=np.arange(256.0)), 256)
    assert find_kinds(springs(257, stiffness=np.arange(257.0))) is None
    lengths = 1.0 + np.arange(400) % 20
    assert find_kinds(springs(400, rest_length=lengths, stiffness=np.arange(400) // 20 % 13)) is None  # 260


def test_rare_kinds_are_found():
    # Only every so many connections are looked at first.
    for rare in (1, 2, 200):
        stiffness = np.full(100_000, 5.0)
        stiffness[1 : 2 * rare : 2] += 1 + np.arange(rare)
        assert_kinds_are_right(springs(100_000, stiffness=stiffness), rare + 1)
    stiffness[1:600:2] = 10 + np.arange(300)
    assert find_kinds(springs(100_000, stiffness=stiffness)) is None


def test_without_connections_there_is_one_kind():
    assert_kinds_are_right(System(position=np.zeros((3, 3))), 1)


def test_256_kinds_and_a_list_of_one_number():
    system = System(
        position=np.arange(257.0)[:, None],
        connections=[(k, k + 1) for k in range(256)],
        rest_length=np.arange(1.0, 257.0),
        stiffness=np.full(256, 5.0),
    )
    table, kind = find_kinds(system)
    np.testing.assert_array_equal(table[kind, 0], system.rest_length)
    np.testing.assert_array_equal(table[kind, 1], 5.0)
