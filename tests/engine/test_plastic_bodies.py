"""Bodies that keep their dents: by every algorithm, and through changes, resets and divergence."""

import itertools
import math

import numpy as np
import problems
import pytest
from problems import EPS64
from springs import INTEGRATORS, pair, relaxed, rest_lengths, simulate

from msdwarp import Plane, Simulation, SimulationDiverged, System, box, chain


def test_nothing_yields_below_its_strain(device):
    plain = problems.tumbling_box(damping=0.3)
    strong = plain.replace(yield_strain=0.5, relaxation_time=0.0)
    assert 0.1 < np.abs(plain.strain).max() < 0.5  # it starts from its largest strains
    found = {}
    for name, system in (("plain", plain), ("strong", strong)):
        simulation = simulate(system, device, h=1 / 500, substeps=100)
        simulation.step(5)
        found[name] = simulation.snapshot()
    np.testing.assert_array_equal(found["strong"].rest_length, plain.rest_length)
    # The same sums of the same numbers, from another place in memory: compilers may round some otherwise, and
    # atomics add in any order. 500 substeps of a rounding of 1 m/s each, which the swinging at most doubles.
    for name in ("position", "velocity"):
        np.testing.assert_allclose(
            getattr(found["strong"], name), getattr(found["plain"], name), rtol=0, atol=2 * 500 * EPS64
        )


def dropped(**changes) -> System:
    """Return a block that falls so hard on its corner that it keeps the dent."""
    block = box((3, 3, 3), spacing=0.1, mass=0.1, stiffness=500.0, damping=0.5)
    block = block.rotate(0.5, axis=(1, 1, 0.3)).translate((0, 0, 0.2)).with_velocity((0, 0, -2.0))
    return block.replace(**{"yield_strain": 0.05, "relaxation_time": 0.02} | changes)


def drop(system: System, device: str, **options) -> Simulation:
    simulation = Simulation(
        system,
        colliders=[Plane(friction=0.0)],
        fps=100,
        **{"substeps": 20, "device": device, "precision": "float64"} | options,
    )
    simulation.step(20)
    return simulation


@pytest.mark.slow
def test_a_dropped_block_keeps_its_dent_by_every_route(plain_device):
    a, b = (
        drop(dropped(), plain_device, force_algorithm=force_algorithm).snapshot()
        for force_algorithm in ("scatter", "gather")
    )
    assert np.abs(a.rest_length / a.original_length - 1).max() > 0.05
    # 400 substeps of roundings of 1 m/s and 0.3 m, which springs answer within 1/ω = 7 ms: in 0.2 s of an
    # impact by up to a hundred times.
    np.testing.assert_allclose(a.rest_length, b.rest_length, rtol=0, atol=100 * 400 * EPS64)
    np.testing.assert_allclose(a.position, b.position, rtol=0, atol=100 * 400 * EPS64)


@pytest.mark.parametrize("integrator", INTEGRATORS[:4:3], ids=str)
def test_dents_converge_with_the_step(device, integrator):
    # The law is first order in a step that also moves: halving it halves the difference to within a third.
    dents = [
        drop(dropped(), device, integrator=integrator, substeps=n).snapshot().rest_length for n in (40, 80, 160)
    ]
    coarse, fine = (np.linalg.norm(a - b) for a, b in itertools.pairwise(dents))
    assert fine < 0.75 * coarse
    assert coarse < 0.1 * np.linalg.norm(dents[-1] - dropped().rest_length)


def test_the_flow_outlives_a_change_of_substeps(device):
    # Beside a spring that is held hangs a particle that is made stiffer; the held one goes on by the same law.
    law = {"yield_strain": 0.05, "relaxation_time": 0.05}
    swing = System(position=[[0.0, 0, 0], [1, 0, 0]], connections=[[0, 1]], stiffness=10.0).pin(0).named("swing")
    simulation = Simulation(pair(1.3, **law) + swing, gravity=0.0, device=device, precision="float64")
    simulation.step(3)
    few = simulation.substeps
    simulation.change(group="swing", stiffness=1e6)
    assert simulation.substeps > 10 * few
    simulation.step(3)
    assert simulation.system.original_length[0] == 1.0
    # A rounding or two a substep, of which there are 6 of the more numerous kind at most.
    allowed = 2 * 6 * simulation.substeps * EPS64
    assert rest_lengths(simulation)[0] == pytest.approx(relaxed(1.3, 0.1, **law), rel=0, abs=allowed)


def test_a_route_that_cannot_yield_says_why():
    with pytest.raises(
        ValueError, match="force_algorithm is 'stencil', which this system cannot take: connections yield"
    ):
        Simulation(chain(3).replace(yield_strain=0.1), force_algorithm="stencil", device="cpu")


def test_divergence_goes_back_to_the_last_good_rest_lengths(device):
    # Just beyond the stable step: a swing grows from frame to frame until energy has no source.
    system = pair(1.02, 1, mass=[math.inf, 1.0], stiffness=1e4, yield_strain=0.2, relaxation_time=1.0)
    simulation = simulate(system, device, h=0.0203, allow_unstable=True, energy_limit=1e3)
    kept = [simulation.snapshot()]

    def run() -> None:
        for _ in range(1000):
            simulation.step()
            kept.append(simulation.snapshot())

    with pytest.raises(SimulationDiverged) as caught:
        run()
    now, good = simulation.snapshot(), kept[-1]
    assert abs(good.rest_length[0] - system.rest_length[0]) > 0.001  # it had yielded before
    for name in ("position", "velocity", "rest_length"):
        np.testing.assert_array_equal(getattr(now, name), getattr(good, name))
    # The strain that is told is by the rest length that the spring has come to.
    assert caught.value.connection == 0
    assert caught.value.strain == pytest.approx(good.strain[0], rel=1e-12)  # a few roundings


def test_a_simulation_tells_what_has_yielded(device):
    system = pair(1.4, yield_strain=0.1, relaxation_time=0.0)
    simulation = simulate(system, device, h=1 / 60)
    simulation.step()
    now = simulation.snapshot()
    assert now.rest_length[0] == pytest.approx(1.3, abs=4 * EPS64)
    assert now.original_length[0] == 1.0
    assert simulation.measure().elastic_energy == pytest.approx(50.0 * 0.1**2 / 2, rel=100 * EPS64)  # 0.1 of 1.4
    simulation.change(set_rest_shape=True)
    # The kernel's length of 1.4 m may round otherwise than NumPy's: each to 2 ε at most.
    assert simulation.measure().elastic_energy <= 50.0 * (4 * EPS64) ** 2 / 2
    assert simulation.system.original_length[0] == now.length[0]
