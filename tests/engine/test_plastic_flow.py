"""Springs that give way for good: what they keep, lose and obey, by closed forms."""

import math

import numpy as np
import pytest
from problems import EPS32, EPS64
from springs import INTEGRATORS, pair, relaxed, rest_lengths, simulate

from msdwarp import Leapfrog, System


@pytest.mark.parametrize("length", [1.3, 0.75], ids=["stretched", "compressed"])
@pytest.mark.parametrize("substeps", [4, 8, 16])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_held_spring_relaxes_whatever_the_step(device, dim, substeps, length):
    law = {"yield_strain": 0.05, "relaxation_time": 0.02}
    simulation = simulate(pair(length, dim, **law), device, h=1 / (60 * substeps), substeps=substeps)
    for frame in range(1, 4):
        simulation.step()
        # A rounding or two of 1 m a substep; the excess shrinks, and with it what it has of them.
        expected = relaxed(length, frame / 60, **law)
        assert rest_lengths(simulation)[0] == pytest.approx(expected, rel=0, abs=2 * frame * substeps * EPS64)


@pytest.mark.parametrize("stays", [True, False], ids=["one launch", "launches"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=str)
@pytest.mark.each_value
def test_every_integrator_flows_once_a_substep(device, integrator, stays):
    options = {} if stays else {"blocks": None}
    law = {"yield_strain": 0.05, "relaxation_time": 0.02}
    system = pair(1.3, damping=1.0, **law)  # RKC2 wants a damper
    simulation = simulate(system, device, h=1 / 300, substeps=5, integrator=integrator, **options)
    for frame in range(1, 4):
        simulation.step()
        simulation.frame()  # reading velocities, which Leapfrog evaluates forces for, lets nothing flow
        expected = relaxed(1.3, frame / 60, **law)
        assert rest_lengths(simulation)[0] == pytest.approx(expected, rel=0, abs=2 * frame * 5 * EPS64)


def test_compensated_lengths_count(device):
    # 400 m from the origin float32 rounds places to 3e-5 m; what it took is kept, and the flow sees it.
    x = [[400.0], [401.3000123]]
    system = pair(1.0, 1, yield_strain=0.05, relaxation_time=0.0).replace(position=x)
    found = {}
    for precision in ("float32", "float32-compensated"):
        simulation = simulate(system, device, h=1 / 60, precision=precision)
        simulation.step()
        found[precision] = abs(rest_lengths(simulation)[0] - (1.3000123 - 0.05))
    assert found["float32-compensated"] < 4 * EPS32  # roundings of 1.3 m
    assert found["float32"] > 4 * EPS32  # else compensation was not needed, and nothing has been tested


@pytest.mark.parametrize(("length", "kept"), [(2.0, 1.3), (0.3, 0.7), (1.35, 1.25), (0.65, 0.75)])
def test_flow_ends_at_its_cap_or_at_the_yield(device, length, kept):
    # |l0 − L0| ≤ 0.3; where that leaves room |l − l0| falls to 0.1.
    system = pair(length, yield_strain=0.1, relaxation_time=0.01, largest_plastic_strain=0.3)
    simulation = simulate(system, device, h=1 / 60)
    simulation.step(60)  # 100 relaxation times
    assert rest_lengths(simulation)[0] == pytest.approx(kept, abs=4 * EPS64)  # roundings of 1 m
    assert simulation.measure().largest_strain == pytest.approx(abs(length / kept - 1), abs=4 * EPS64)


def test_yield_follows_the_original_length(device):
    # 0.1 of 2 m may be stretched away before it yields, not 0.1 of the 2.5 m that it has come to.
    system = pair(2.9, rest_length=2.5, original_length=2.0, yield_strain=0.1, relaxation_time=0.0)
    simulation = simulate(system, device, h=1 / 60)
    simulation.step()
    assert rest_lengths(simulation)[0] == pytest.approx(2.7, abs=4 * EPS64)


def scattered(rng: np.random.Generator, count: int = 40) -> System:
    """Return pinned particles anywhere, joined at random by springs of any state that can come about."""
    connections = np.array([[i, j] for i in range(count) for j in range(i) if rng.random() < 0.3])
    original, most = rng.uniform(0.2, 1.5, len(connections)), rng.uniform(0, 0.9, len(connections))
    return System(
        position=rng.uniform(0, 1, (count, 3)),
        mass=math.inf,
        connections=connections,
        stiffness=rng.uniform(1, 100, len(connections)),
        original_length=original,
        rest_length=original * (1 + most * rng.uniform(-1, 1, len(connections))),
        yield_strain=rng.choice([0.0, 0.01, 0.1, math.inf], len(connections)),
        relaxation_time=rng.choice([0.0, 0.01, 1.0], len(connections)),
        largest_plastic_strain=most,
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_flow_never_raises_elastic_energy(device, seed):
    system = scattered(np.random.default_rng(seed))
    simulation = simulate(system, device, h=1 / 240)
    energy, before = simulation.measure().elastic_energy, simulation.snapshot()
    for _ in range(4):
        simulation.step()
        now, after = simulation.measure().elastic_energy, simulation.snapshot()
        assert now < energy
        stretch, less = (one.length - one.rest_length for one in (before, after))
        # One by one: nothing is stretched further, or past where it is slack, but for roundings of 1.7 m.
        assert (np.abs(less) <= np.abs(stretch) + 2 * EPS64).all()
        assert (less * stretch >= -2 * EPS64).all()
        bound = system.largest_plastic_strain * system.original_length
        assert (np.abs(after.rest_length - system.original_length) <= bound + 2 * EPS64).all()
        never = np.isinf(system.yield_strain)
        np.testing.assert_array_equal(after.rest_length[never], system.rest_length[never])
        energy, before = now, after


def pull(system: System, device: str, speed: float, way: float, *, h: float, substeps: int = 1) -> list[System]:
    """Return a pair, frame by frame, whose second particle is moved so far, and where it has come to.

    It weighs so much that a spring cannot change its speed: in the seconds that it takes, by 1e-14 m/s.
    """
    system = system.replace(mass=[math.inf, 1e15]).with_velocity([[0.0], [math.copysign(speed, way)]])
    simulation = simulate(system, device, h=h, substeps=substeps, energy_limit=math.inf)
    path = [system]
    for _ in range(round(abs(way) / (speed * h * substeps))):
        simulation.step()
        path.append(simulation.snapshot())
    return path


def tension(system: System) -> float:
    """Return the force of a spring [N]."""
    return float(system.stiffness[0] * (system.length[0] - system.rest_length[0]))


def loop_area(path: list[System]) -> float:
    """Return the area within a closed path of lengths and forces, by the shoelace formula."""
    x, y = np.array([(system.length[0], tension(system)) for system in (*path, path[0])]).T
    return float(abs((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2)


@pytest.mark.slow
def test_a_cycle_of_pulling_and_pushing_costs_its_loop(device):
    # A parallelogram: 2 F_y high, and 2 (A − e_y) wide wherever it is.
    k, e_y, A, h, speed = 50.0, 0.02, 0.1, 1 / 1000, 0.2
    way = speed * h  # of a substep
    start = pull(pair(1.0, 1, stiffness=k, yield_strain=e_y, relaxation_time=0.0), device, speed, A, h=h)
    # It flows before it moves: a way less, and 500 roundings of 1 m.
    assert start[-1].rest_length[0] == pytest.approx(1 + A - e_y - way, abs=500 * EPS64)
    down = pull(start[-1], device, speed, -2 * A, h=h)
    assert down[-1].rest_length[0] == pytest.approx(1 - A + e_y + way, abs=1500 * EPS64)
    up = pull(down[-1], device, speed, 2 * A, h=h)
    # The force is told after the move, k (e_y + way): the loop is higher by so much. Corners lie within a way.
    assert loop_area(down[:-1] + up[:-1]) == pytest.approx(4 * k * (e_y + way) * (A - e_y), abs=4 * k * way**2)
    assert loop_area(down[:-1] + up[:-1]) == pytest.approx(4 * k * e_y * (A - e_y), rel=1.01 * way / e_y)


@pytest.mark.parametrize("relaxation_time", [0.0, 0.003, 0.05])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_fast_pull_meets_more_force(device, relaxation_time, sign):
    # Steady flow at speed v leaves an excess d: of it exp(−h/τ) is left, and v h comes to it, so that
    # d = v h / (1 − exp(−h/τ)), which goes to v τ: Bingham's overstress.
    h, speed, k, tau = 1 / 1000, 0.2, 50.0, relaxation_time
    system = pair(1.0, 1, stiffness=k, yield_strain=0.02, relaxation_time=tau, largest_plastic_strain=0.9)
    *_, end = pull(system, device, speed, sign * 0.5, h=h, substeps=50)
    d = speed * h / (1 - math.exp(-h / tau) if tau else 1.0)
    # For 2.4 s the excess has settled, by exp(−48) at least; 2500 roundings of 1 m.
    assert tension(end) == pytest.approx(sign * k * (0.02 + d), abs=k * 2500 * EPS64 + k * d * math.exp(-48))
    assert abs(d - speed * tau) <= speed * h


def test_work_of_a_pull_is_stored_or_lost(device):
    # A mass thrown outwards on a spring that yields stops where its energy is stored or turned into heat:
    # m v²/2 = F_y e_y/2 + F_y s, s the plastic stretch; then it swings elastically for ever.
    m, k, e_y, v, h = 0.5, 200.0, 0.02, 1.5, 1 / 4000
    system = pair(1.0, 1, stiffness=k, mass=[math.inf, m], yield_strain=e_y, relaxation_time=0.0)
    simulation = simulate(
        system.with_velocity([[0.0], [v]]), device, h=h, substeps=40, integrator=Leapfrog(), energy_limit=0.01
    )
    simulation.step(200)
    yielded = rest_lengths(simulation)[0] - 1.0
    # The force runs a substep ahead of the flow: by v h/e_y = 1.9 % at most, on average over the pull half.
    assert yielded == pytest.approx((m * v**2 / 2 - k * e_y**2 / 2) / (k * e_y), rel=0.015)
    energies = []
    for _ in range(200):
        simulation.step()
        energies.append(simulation.measure().energy)
    assert rest_lengths(simulation)[0] - 1.0 == yielded
    # What swings is k e_y²/2, kept to Leapfrog's (hω)²/8 = 3e-6.
    assert np.ptp(energies) < 1e-5 * k * e_y**2 / 2
    # It had its whole yield force where it turned, but for a substep's way there, v² of it: a h²/2.
    assert energies[0] == pytest.approx(k * e_y**2 / 2, rel=1e-3)


def test_each_connection_has_its_own_law(device):
    # On every algorithm, in whatever order connections lie on the device: here many begin at one particle.
    system = scattered(np.random.default_rng(2))
    simulation = simulate(system, device, h=0.02)
    simulation.step()
    stretch = system.length - system.rest_length
    excess = np.maximum(np.abs(stretch) - system.yield_strain * system.original_length, 0.0)
    with np.errstate(divide="ignore"):
        share = 1 - np.exp(-0.02 / system.relaxation_time)
    most = system.largest_plastic_strain * system.original_length
    expected = system.rest_length + share * excess * np.sign(stretch)
    expected = np.clip(expected, system.original_length - most, system.original_length + most)
    np.testing.assert_allclose(rest_lengths(simulation), expected, rtol=0, atol=8 * EPS64)  # roundings of 2 m
