"""Particles in another order: the same body, with numbers that lie near each other."""

import numpy as np
import pytest
from tangles import tangle

from msdwarp import Simulation, System, ball, box, chain, sheet, space_filling_order


def shuffled(body: System) -> System:
    return body.renumbered(np.random.default_rng(5).permutation(body.particle_count))


def test_every_field_goes_with_its_particle_or_connection():
    body = (ball(0.5, 0.1).named("ball") + chain(4)).pin(3)
    random = np.random.default_rng(2)
    body = body.replace(
        velocity=np.where(body.pinned[:, None], 0.0, random.normal(size=body.position.shape)),
        stiffness=random.uniform(1, 2, body.connection_count),
        break_strain=random.uniform(1, 2, body.connection_count),
    )
    order = random.permutation(body.particle_count)
    other = body.renumbered(order)
    for name in ("position", "velocity", "mass"):
        assert np.array_equal(getattr(other, name), getattr(body, name)[order])
    assert np.array_equal(other.surface.points(other.position), body.surface.points(body.position))
    assert np.array_equal(other.group("ball"), body.group("ball")[order])

    def by_ends(system: System, ends: np.ndarray) -> set:
        columns = [np.sort(ends, axis=1), system.rest_length, system.stiffness, system.break_strain]
        return {tuple(row) for row in np.column_stack(columns).tolist()}

    assert by_ends(other, order[other.connections]) == by_ends(body, body.connections)
    assert other.original_length is other.rest_length


def test_what_joins_second_neighbours_is_known_by_another_number():
    cloth = sheet((5, 4), stiffness=100.0, bending=1e-3) + chain(3)
    other = cloth.renumbered(np.random.default_rng(3).permutation(cloth.particle_count))
    assert cloth.between_neighbors is not None
    lengths = [np.sort(one.rest_length[~one.between_neighbors]) for one in (cloth, other, other.renumbered())]
    np.testing.assert_array_equal(lengths[1], lengths[0])
    np.testing.assert_array_equal(lengths[2], lengths[0])
    assert Simulation(other, device="cpu").model.force_algorithm in ("scatter", "gather")


@pytest.mark.slow
def test_a_renumbered_body_moves_as_before():
    body = tangle(3, 65, ("stiffness",), damped=True)
    order = space_filling_order(body.position)
    how = {"device": "cpu", "precision": "float64", "force_algorithm": "gather", "gravity": 1.0}
    one, other = Simulation(body, **how), Simulation(body.renumbered(), **how)
    for simulation in (one, other):
        simulation.step(20)
    # Sums are in another order: some hundred substeps round lengths of about a metre otherwise.
    np.testing.assert_allclose(other.frame().position, one.frame().position[order], rtol=0, atol=1e-11)


def test_joined_particles_lie_near_each_other_along_the_curve():
    def apart(system: System) -> float:
        return float(np.median(np.abs(np.diff(system.connections, axis=1))))

    lost = shuffled(box((12, 12, 12)))
    # Two of 1728 at random are 500 apart in the middle; along the curve most neighbours share a small cube.
    assert apart(lost) > 400
    assert apart(lost.renumbered()) < 30


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_the_curve_fills_a_cube_before_it_goes_on(dim):
    # Points of a grid of 4 along each axis, shuffled: each cube of 2 along each axis comes as a whole.
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    points = np.random.default_rng(0).permutation(grid)
    ordered = points[space_filling_order(points)]
    cubes = ordered.reshape(-1, 2**dim, dim)
    assert (np.ptp(cubes, axis=1) == 1).all()


def test_points_in_one_place_keep_their_order():
    assert space_filling_order(np.zeros((4, 3))).tolist() == [0, 1, 2, 3]
    assert space_filling_order(np.zeros((0, 2))).tolist() == []


@pytest.mark.parametrize("position", [[[np.nan, 0.0]], [0.0, 1.0], np.zeros((2, 4))])
def test_a_curve_needs_points(position):
    with pytest.raises(ValueError, match="position has shape"):
        space_filling_order(position)


@pytest.mark.parametrize("order", [[0, 1], [0, 0, 1], [1, 2, 3], [0.0, 1.0, 2.0], "012"])
def test_an_order_has_each_particle_once(order):
    with pytest.raises(ValueError, match="order is"):
        chain(3).renumbered(order)
