"""Which algorithm is taken to the forces: the one that is asked for, or the fastest, before and after a change."""

import numpy as np
import problems
import pytest
from tangles import CONSTANTS, lattices, moving, tangle

from msdwarp import Plane, Simulation, System, box, chain, join, sheet
from msdwarp.engine.model import algorithm_choice as routes
from msdwarp.engine.model.algorithm_choice import (
    FORCE_ALGORITHMS,
    automatic_force_algorithm,
    choose_force_algorithm,
)
from msdwarp.engine.model.model import Model


def test_unknown_route_is_named():
    with pytest.raises(ValueError, match=r"force_algorithm is 'teleport'.*'auto', 'scatter', 'gather', 'stencil'"):
        Simulation(chain(3), device="cpu", force_algorithm="teleport")


def test_a_stencil_of_no_lattice_is_refused_with_the_reason():
    said = "force_algorithm is 'stencil', which this system cannot take: no connection is in a direction"
    with pytest.raises(ValueError, match=said):
        Simulation(tangle(3, 40, (), damped=False), device="cpu", force_algorithm="stencil")


def test_a_route_asked_for_is_taken():
    for name in FORCE_ALGORITHMS:
        assert Simulation(chain(4), device="cpu", force_algorithm=name).model.force_algorithm == name
    assert Model(chain(4), device="cpu").lattice is None
    assert Model(chain(4), device="cpu", force_algorithm="stencil").lattice.steps == ((1, 0, 0),)


@pytest.mark.parametrize("on_gpu", [False, True])
def test_an_automatic_route_is_one_that_can_be_taken(on_gpu):
    systems = [
        *lattices(1.0).values(),
        tangle(3, 40, CONSTANTS, damped=True),
        System(position=np.zeros((1, 1))),
        System(position=np.zeros((5, 3))),
        chain(4, stiffness=[1.0, 2, 3]),
        chain(5).replace(directions=({"weft": slice(0, 4)},)),
        chain(5).replace(directions=()),
        moving(box((3, 3, 3))).set_rest_shape(),
    ]
    for system in systems:
        force_algorithm, lattice = automatic_force_algorithm(system, on_gpu=on_gpu)
        assert force_algorithm in FORCE_ALGORITHMS
        assert (lattice is not None) == (force_algorithm == "stencil")


def test_automatic_routes_are_those_that_are_fastest():
    cube, jumble, few, grid = box((8, 8, 8)), tangle(3, 200, (), damped=True), chain(200), sheet((150, 300))
    threads = problems.cut(grid, np.arange(grid.particle_count) // 150 % 2 == 0)  # every second row of a cloth
    bodies = (cube, jumble, few, threads)
    assert {automatic_force_algorithm(system, on_gpu=False)[0] for system in bodies} == {"scatter"}
    # Most of what a stencil of threads reads is no neighbour.
    fastest = ["stencil", "gather", "scatter", "gather"]
    assert [automatic_force_algorithm(system, on_gpu=True)[0] for system in bodies] == fastest
    # Of a die's particles each has several threads, but not if its connections may break.
    assert automatic_force_algorithm(box((3, 3, 3)), on_gpu=True)[0] == "stencil"
    assert automatic_force_algorithm(box((3, 3, 3)).replace(break_strain=1.0), on_gpu=True)[0] == "scatter"


def test_a_lattice_with_few_ties_keeps_its_stencil():
    one, other = box((8, 8, 8)), box((8, 8, 8)).translate((8.0, 0, 0))
    pair, hosts = join(one, other, within=1.0, stiffness=9.0), join(one, other, within=8.0, stiffness=9.0)
    few, most = pair.connection_count - 2 * one.connection_count, 0.05 * pair.connection_count
    assert few == 64 < most
    force_algorithm, lattice = automatic_force_algorithm(pair, on_gpu=True)
    assert (force_algorithm, len(lattice.ties)) == ("stencil", 64)
    assert hosts.connection_count - 2 * one.connection_count > 0.05 * hosts.connection_count
    assert automatic_force_algorithm(hosts, on_gpu=True) == ("gather", None)
    assert (
        len(choose_force_algorithm(hosts, "stencil", on_gpu=False)[1].ties) > most
    )  # asked for, any number will do


def test_tests_run_over_every_route(device, request):
    # What the fixture `device` promises to all tests that use it.
    force_algorithm = request.node.callspec.params["device"].split()[-1]
    # What is small is scattered on a GPU, too, unless it is a lattice.
    expected = {"cpu": "scatter", "cuda:0": "stencil"}.get(force_algorithm, force_algorithm)
    assert Model(chain(9), device=device).force_algorithm == expected
    assert Model(tangle(3, 9, (), damped=True), device=device).force_algorithm == expected.replace(
        "stencil", "scatter" if force_algorithm == "cuda:0" else "gather"
    )


# Change of parameters.


@pytest.fixture
def as_on_gpu(monkeypatch) -> None:
    """Choose automatic algorithms as on a GPU."""
    monkeypatch.setattr(
        routes,
        "automatic_force_algorithm",
        lambda system, on_gpu, choose=automatic_force_algorithm: choose(system, on_gpu=True),
    )


def cloth(force_algorithm: str) -> Simulation:
    """Return a cloth in free fall onto the ground, that has fallen a while."""
    grid = sheet((10, 11), 0.1, mass=0.05, stiffness=40.0, damping=0.1).rotate(0.4, (1, 1, 0))
    grid = grid.translate((0, 0, 0.5))
    simulation = Simulation(
        grid, colliders=[Plane()], device="cpu", precision="float64", force_algorithm=force_algorithm
    )
    simulation.step(10)
    assert simulation.model.force_algorithm == ("stencil" if force_algorithm == "auto" else force_algorithm)
    return simulation


def changes(simulation: Simulation) -> dict[str, dict]:
    """Return changes after which the connections of a direction are no longer alike."""
    uneven = np.linspace(30.0, 50.0, simulation.system.connection_count)
    return {
        "stiffness": {"stiffness": uneven},
        "damping": {"damping": uneven / 400},
        "frozen": {"rest_length": simulation.snapshot().length},
    }


@pytest.mark.slow
@pytest.mark.parametrize("change", ["stiffness", "frozen"])
def test_a_body_that_is_a_lattice_no_longer_changes_its_route(as_on_gpu, change):
    simulation = cloth("auto")
    parameters = changes(simulation)[change]
    fresh = Simulation(
        simulation.snapshot().replace(**parameters), colliders=[Plane()], device="cpu", precision="float64"
    )
    simulation.change(**parameters)
    assert simulation.model.force_algorithm == fresh.model.force_algorithm == "gather"
    simulation.step(10)
    fresh.step(10)
    np.testing.assert_array_equal(simulation.frame().position, fresh.frame().position)  # the same launches
    simulation.change(stiffness=40.0, damping=0.1, rest_length=0.1)
    assert simulation.model.force_algorithm == "stencil"
    simulation.step()
    simulation.reset()
    assert simulation.model.force_algorithm == "stencil"


@pytest.mark.parametrize("change", ["damping", "frozen"])
def test_a_stencil_that_was_asked_for_refuses_such_a_change(change):
    simulation, twin = cloth("stencil"), cloth("stencil")
    before, name = simulation.system, {"frozen": "rest_length"}.get(change, change)
    with pytest.raises(ValueError, match=f"force_algorithm is 'stencil'.* {name} differs among the connections"):
        simulation.change(**changes(simulation)[change])
    assert simulation.system is before
    for each in (simulation, twin):
        each.step(5)
    np.testing.assert_array_equal(simulation.frame().position, twin.frame().position)
    assert simulation.time == twin.time
