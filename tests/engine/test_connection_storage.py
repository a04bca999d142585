"""How connections lie on a device: in which order, and what is stored of each."""

import numpy as np
import problems
import pytest
import warp as wp
from tangles import CONSTANTS, assert_forces_are_right, tangle

from msdwarp import System, box, chain, sheet
from msdwarp.engine.model.algorithm_choice import scatter_order
from msdwarp.engine.springs import force_algorithms as forces
from msdwarp.engine.springs.force_algorithms import find_kinds
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.world import Problem

# Algorithms are compared from wherever bodies start, in the floor too.
pytestmark = pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")

# Order of scattering.


def by_particle(system: System) -> System:
    """Return the system with its connections listed particle by particle, in no direction any longer."""
    order = np.lexsort(system.connections.T[::-1])
    listed = {name: getattr(system, name)[order] for name in ("connections", *CONSTANTS)}
    return system.replace(**listed, directions=({},))


@pytest.mark.parametrize("system", [box((5, 5, 5)), sheet((6, 6)), box((2, 2, 8)), problems.ball(7)])
def test_neighbours_in_the_list_do_not_meet_in_a_particle(system):
    listed = by_particle(system)
    order = scatter_order(listed)
    assert (np.sort(order) == np.arange(system.connection_count)).all()
    first = listed.connections[order, 0]
    assert not (first[1:] == first[:-1]).any()
    met = listed.connections[:, 0]
    assert np.mean(met[1:] == met[:-1]) > 0.5  # as it was listed, most do


@pytest.mark.parametrize(
    "system",
    [
        chain(9),
        sheet((5, 7)),
        box((4, 4, 4)),
        box((4, 4, 4)) + sheet((5, 5)),
        chain(2),
        System(position=[[0.0], [1]]),
    ],
)
def test_what_is_listed_by_directions_keeps_its_order(system):
    assert scatter_order(system) is None


@pytest.mark.parametrize("own", [(), CONSTANTS], ids=["one constant each", "all their own"])
def test_order_of_scattering_does_not_change_forces(plain_device, own):
    # Constants go with their connections.
    body = by_particle(tangle(3, 65, own, damped=True))
    assert scatter_order(body) is not None
    for force_algorithm in ("scatter", "gather"):
        assert_forces_are_right(body, plain_device, "float64", force_algorithm)


# Memory.


def arrays(data) -> dict[str, wp.array]:
    """Return the arrays of a struct and of the structs in it."""
    found = {}
    for name in data._cls.vars:
        value = getattr(data, name)
        if isinstance(value, wp.array):
            found[name] = value
        elif hasattr(value, "_cls"):
            found |= arrays(value)
    return found


def read_beside_the_state(force_algorithm: str, system: System) -> dict[str, wp.array]:
    """Return the arrays that a route's kernels read beside positions and velocities."""
    return arrays(
        Dynamics(assemble(Problem(system=system), device="cpu", force_algorithm=force_algorithm)).scene.forces
    )


LISTS = {"scatter": {"f", "connections"}, "gather": {"first", "other"}}
by_lists = pytest.mark.parametrize(("force_algorithm", "lists"), LISTS.items(), ids=LISTS.keys())


@by_lists
def test_constants_of_all_connections_are_single_numbers(force_algorithm, lists):
    assert read_beside_the_state(force_algorithm, tangle(3, 65, (), damped=True)).keys() == lists


@by_lists
@pytest.mark.parametrize("name", CONSTANTS)
def test_constants_of_few_kinds_take_a_byte_for_each_at_most(force_algorithm, lists, name):
    found = read_beside_the_state(force_algorithm, tangle(3, 65, (name,), damped=True))
    # Where they are gathered, that byte is one of the four of the neighbour's number.
    assert found.keys() == lists | {"table"} | ({"kind"} if force_algorithm == "scatter" else set())
    assert len(found["table"]) <= 256
    assert force_algorithm == "gather" or found["kind"].dtype is wp.uint8


def test_kinds_of_very_many_particles_have_a_byte_of_their_own(monkeypatch, plain_device):
    # More than 2^24 particles leave no byte of a number free; here, by another limit, more than one.
    monkeypatch.setattr(forces, "KIND_SHIFT", 0)
    for own in (("rest_length",), ("damping",)):
        body = tangle(3, 65, own, damped=True)
        assert read_beside_the_state("gather", body).keys() == {"first", "other", "kind", "table"}
        assert_forces_are_right(body, plain_device, "float64", "gather")


def test_a_stencil_of_one_kind_has_a_mask_and_no_other_array():
    found = read_beside_the_state("stencil", box((4, 5, 6), damping=1.0))
    assert found.keys() == {"mask"}
    assert found["mask"].size == 120


# Kinds.


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
