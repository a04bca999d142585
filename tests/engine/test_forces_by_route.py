"""Forces by each algorithm: those of the plain sum over connections, of whatever they join."""

import numpy as np
import problems
import pytest
from tangles import (
    CONSTANTS,
    FAR,
    PRECISIONS,
    assert_forces_are_right,
    evaluate,
    every_route,
    lattices,
    moving,
    tangle,
)

from msdwarp import System, box, chain, sheet

# Algorithms are compared from wherever bodies start, in the floor too.
pytestmark = pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")


@pytest.mark.parametrize("force_algorithm", ["scatter", "gather"])
@pytest.mark.parametrize(
    ("own", "damped"),
    [((), True), (CONSTANTS, True), (("rest_length",), False), (("damping",), True)],
    ids=["one constant each", "all their own", "own lengths, undamped", "own dampers"],
)
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.each_value
def test_forces_of_a_tangle(plain_device, dim, own, damped, force_algorithm):
    for count in (2, 3, 31, 32, 33, 63, 64, 65, 200):
        assert_forces_are_right(tangle(dim, count, own, damped=damped), plain_device, "float64", force_algorithm)


@pytest.mark.parametrize("force_algorithm", ["scatter", "gather"])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated"])
def test_forces_of_a_tangle_in_single_precision(plain_device, precision, force_algorithm):
    for count in (3, 33, 200):
        far = tangle(3, count, CONSTANTS, damped=True).translate(FAR)
        assert_forces_are_right(far, plain_device, precision, force_algorithm)


@every_route
@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("name", lattices(0.0))
@pytest.mark.each_value
def test_forces_of_a_lattice(plain_device, name, damping, force_algorithm):
    assert_forces_are_right(moving(lattices(damping)[name]), plain_device, "float64", force_algorithm)


@pytest.mark.slow
def test_stencils_of_equally_many_rows_are_not_taken_for_one(plain_device):
    cube, cloth = box((3, 3, 3)), sheet((4, 4)).translate((9, 0, 0))
    for system in (cube + cloth, cloth + cube):  # the directions in another order
        assert_forces_are_right(moving(system), plain_device, "float64", "stencil")


@pytest.mark.slow
@every_route
@pytest.mark.parametrize("name", ["box 26", "ball"])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated"])
def test_forces_of_a_lattice_in_single_precision(plain_device, precision, name, force_algorithm):
    far = moving(lattices(2.0)[name]).translate(FAR)
    assert_forces_are_right(far, plain_device, precision, force_algorithm)


@every_route
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.each_value
def test_coincident_neighbours_feel_what_else_pulls_them(plain_device, damping, precision, force_algorithm):
    # Particles 7 and 8 of 5 × 3 lie in one place; their spring has no axis, the other springs are as ever.
    grid = moving(sheet((5, 3), stiffness=30.0, damping=damping))
    position = grid.position.astype(np.float32).astype(np.float64)  # the same place in every precision
    position[8] = position[7]
    grid = grid.replace(position=position)
    found = evaluate(grid, plain_device, precision, force_algorithm)
    (away,) = np.nonzero((grid.connections == (7, 8)).all(axis=1))
    assert len(away) == 1
    rest = {name: np.delete(getattr(grid, name), away, axis=0) for name in ("connections", *CONSTANTS)}
    others = System(position=position, velocity=grid.velocity, **rest)
    expected = problems.forces(others, position, grid.velocity)
    # 8 springs of some 30 N/m · 1.5 m and 2 Ns/m · 3 m/s, as many roundings as `assert_forces_are_right` has.
    np.testing.assert_allclose(found, expected, rtol=0, atol=8 * (8 + 4) * 50 * PRECISIONS[precision])


@pytest.mark.parametrize("force_algorithm", ["scatter", "gather"])
def test_all_particles_in_one_place_feel_nothing(plain_device, force_algorithm):
    heap = tangle(3, 40, CONSTANTS, damped=True).replace(position=np.full((40, 3), 0.7))
    for precision in PRECISIONS:
        assert not evaluate(heap, plain_device, precision, force_algorithm).any()  # NaN would count as true


@every_route
def test_without_connections_there_is_no_force(plain_device, force_algorithm):
    # As a lattice: one of which no connection is left.
    alone = problems.cut(chain(7), np.arange(7) % 2 == 0)
    assert alone.connection_count == 0
    assert alone.particle_count == 4
    assert not evaluate(alone, plain_device, "float64", force_algorithm).any()
