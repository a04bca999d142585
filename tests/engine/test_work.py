"""Work: of what moves particles from outside: what a body has more of, or has turned to heat."""

import math

import numpy as np
import pytest

from msdwarp import (
    RK4,
    Attachment,
    Drive,
    Force,
    Leapfrog,
    Simulation,
    SimulationDiverged,
    Sphere,
    SymplecticEuler,
    System,
    at,
    box,
    chain,
)


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 20.0, "substeps": 40, "device": device, **more}


def shake(t):
    return 0.1 * np.sin(7 * t), 0.05 * t, 0 * t


def rope(damping: float = 0.0) -> System:
    """Return four particles in a line, of 0.5 kg each, on springs of 100 N/m."""
    return chain(4, 0.5, mass=0.5, stiffness=100.0, damping=damping)


def balance(simulation: Simulation) -> tuple[float, float]:
    """Return energy less work, and work [J]."""
    found = simulation.measure()
    return found.energy - found.external_work, found.external_work


def drifts(frames: int, make) -> list[float]:
    """Return by how much energy less work leaves its start, as a share of the most work, at h and h/2."""
    found = []
    for substeps in (20, 40):
        simulation = make(substeps)
        (start, _), off, most = balance(simulation), 0.0, 0.0
        for _ in range(frames):
            simulation.step()
            now, work = balance(simulation)
            off, most = max(off, abs(now - start)), max(most, abs(work))
        found.append(off / most)
    return found


METHODS = [(SymplecticEuler(), 1), (Leapfrog(), 2), (Leapfrog(damper_extrapolation=0.5), 2), (RK4(), 4)]


@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize(("method", "order"), METHODS, ids=str)
def test_what_a_drive_does_an_undamped_body_has(device, method, order, blocks):
    # Energy less work is constant, to the order of the method; the first terms beyond it are a few per cent at
    # hω = 0.03. Of RK4 the loss of energy, of order 5, is as large as its error.
    def make(substeps: int) -> Simulation:
        how = options(device, gravity=3.0, integrator=method, blocks=blocks, substeps=substeps)
        return Simulation(rope(), loads=[Drive([0], shake)], **how)

    coarse, fine = drifts(20, make)
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.6 if order == 4 else 0.1)
    assert fine < {1: 0.01, 2: 1e-4, 4: 1e-9}[order]  # (hω/2)^order and less: hω = 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), [METHODS[1], METHODS[3]], ids=str)
def test_with_dampers_the_rest_is_heat(device, method, order):
    # ∫ Σ b l'² dt over the frames by Simpson's rule, whose error at 5 Hz and 200 frames/s is (0.15)⁴/180 of it.
    # Leapfrog's dampers see speeds of half a substep before: hω/2 of a share of it, ω up to 28/s.
    how = options(device, gravity=3.0, fps=200.0, substeps=8, integrator=method)
    simulation = Simulation(rope(damping=2.0), loads=[Drive([0], shake)], **how)
    (start, _), power = balance(simulation), [simulation.measure().dissipated_power]
    for _ in range(100):
        simulation.step()
        power.append(simulation.measure().dissipated_power)
    heat = (power[0] + 4 * sum(power[1::2]) + 2 * sum(power[2:-1:2]) + power[-1]) / 600
    assert heat > 0.02
    assert start - balance(simulation)[0] == pytest.approx(heat, rel=2e-2 if order == 2 else 1e-5)


@pytest.mark.slow
def test_what_else_pulls_at_the_driven_is_counted_once(plain_device):
    # A driven particle that is attached to the world and pushed by forces as well: they do no work on the rest.
    loads = [
        Drive([0], shake),
        Force((0.0, 3.0, 0.0), on=[0, 2]),
        Force(lambda t: (np.sin(9 * t), 0.0, 0.5), on=[0, 3]),
        Attachment([0, 1], stiffness=30.0),
    ]
    simulation = Simulation(rope(), loads=loads, integrator=RK4(), **options(plain_device))
    start, _ = balance(simulation)
    simulation.step(20)
    now, work = balance(simulation)
    assert abs(work) > 0.1
    assert now == pytest.approx(start, abs=1e-7 * abs(work))  # of order 4, as above


@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize(("method", "order"), METHODS, ids=str)
def test_what_carries_attachments_along_does_the_same(device, method, order, blocks):
    # Beside a point that stands still, along an axis and in all directions, and turning too. How fast a carrier is
    # at the very start is that of h/100 later: of RK4's work a share that falls with less than its order.
    def make(substeps: int) -> Simulation:
        arm = Sphere((0, 0, 1), 0.1, motion=lambda t: (shake(t), (0 * t, 0 * t, 2 * t)))
        loads = [
            Attachment([0, 1], (0.3, 0.4, 0.5), carried_by=arm, stiffness=50.0, rest_length="now"),
            Attachment([1, 3], arm, stiffness=20.0),
            Attachment([3], stiffness=9.0),
        ]
        how = options(device, gravity=3.0, integrator=method, blocks=blocks, substeps=substeps)
        return Simulation(rope(), loads=loads, **how)

    coarse, fine = drifts(20, make)
    if order < 4:
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.1)
    assert fine < {1: 0.01, 2: 1e-4, 4: 1e-8}[order]  # as above


def test_with_their_dampers_the_rest_is_heat(device):
    # b |v − u|² by Simpson's rule, as above.
    load = Attachment([0], Sphere((0, 0, 1), 0.1, motion=shake), stiffness=50.0, damping=3.0)
    how = options(device, fps=200.0, substeps=8, integrator=RK4())
    simulation = Simulation(rope(), loads=[load], **how)
    (start, _), power = balance(simulation), [simulation.measure().dissipated_power]
    for _ in range(100):
        simulation.step()
        power.append(simulation.measure().dissipated_power)
    heat = (power[0] + 4 * sum(power[1::2]) + 2 * sum(power[2:-1:2]) + power[-1]) / 600
    assert heat > 0.02
    assert start - balance(simulation)[0] == pytest.approx(heat, rel=1e-5)


@pytest.mark.slow
def test_it_goes_on_over_a_change_and_a_restart(plain_device):
    def make():
        schedule = [at(0.3, stiffness=120.0), at(0.6, release=[0])]
        drives = [Drive([0], shake), Drive([3], lambda t: (0 * t, 0 * t, 0.1 * t))]
        how = options(plain_device, integrator=Leapfrog(), route="gather")
        return Simulation(rope(), loads=drives, schedule=schedule, **how)

    whole, other = make(), make()
    whole.step(5)
    before = whole.measure().external_work
    assert before != 0.0
    whole.change(damping=0.1)
    assert whole.measure().external_work == before
    whole = make()
    whole.step(8)
    other.restore(*whole.checkpoint())
    for simulation in (whole, other):
        simulation.step(8)
    assert other.measure().external_work == whole.measure().external_work != 0.0


# The watch


def test_a_drive_that_does_much_is_no_divergence(device):
    # Lifted by fifty times its size with fixed substeps: far more energy than at the start, all of it the drive's.
    body = box((3, 2, 2), 0.1, mass=0.1, stiffness=200.0, damping=0.5)
    lift = Drive([0, 1], lambda t: (0 * t, 0 * t, 10 * t**2 / (1 + t)))
    simulation = Simulation(body, loads=[lift], substeps=20, device=device)
    start = simulation.measure().energy
    simulation.step(90)
    assert simulation.measure().energy > start + 10 * 2 * 1.0 * 9.82 * 0.2


@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=["euler", "rk4"])
def test_what_heats_is_found_though_a_drive_shakes_it(device, method):
    # A step beyond the limit: its energy is far from infinite in the frame in which it is found.
    body = box((3, 3, 3), 0.1, mass=0.1, stiffness=200.0)
    how = {"integrator": method, "device": device, "gravity": 1.0, "fps": 1.0}
    limit = Simulation(body, safety=1.0, loads=[Drive([0, 1, 2], shake)], **how)
    steps = math.floor(limit.substeps / 1.6)  # the bound may be twice the largest rate
    how |= {"fps": steps / 10, "substeps": 10, "allow_unstable": True}
    simulation, unwatched = (
        Simulation(body, loads=[Drive([0, 1, 2], shake)], energy_limit=most, **how) for most in (10.0, math.inf)
    )
    with pytest.raises(SimulationDiverged):
        simulation.step(100)
    unwatched.step(simulation.frame_index + 1)
    assert np.isfinite(unwatched.measure().energy)
