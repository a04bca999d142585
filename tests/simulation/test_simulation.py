"""Simulation: frames, pins, repeatability, changes between frames, divergence and bad arguments."""

import math
import re

import numpy as np
import problems
import pytest
import warp as wp

from msdwarp import RK4, Leapfrog, Plane, Simulation, SimulationDiverged, SymplecticEuler, System, box
from msdwarp.engine.stepping.substep import take_stage

every_integrator = pytest.mark.parametrize(
    "integrator", [SymplecticEuler(), Leapfrog(), RK4()], ids=["symplectic euler", "leapfrog", "rk4"]
)
PAIR = System(position=[[0.0, 0, 0], [1, 0, 0]], connections=[[0, 1]])


def block(**changes) -> System:
    """Return a block that falls askew onto the ground within a few tenths of a second."""
    system = box((3, 3, 3), spacing=0.1, mass=0.1, stiffness=500.0, damping=0.5)
    return system.rotate(0.5, axis=(1, 1, 0.3)).translate((0, 0, 0.25)).replace(**changes)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it is put back hard
@every_integrator
def test_pinned_particles_never_move(device, integrator):
    # In mid-air, and one below the ground where a free particle would be pushed out.
    system = block().pin([0, 13]).translate((0, 0, -0.2))
    assert system.position[0, 2] < 0
    simulation = Simulation(
        system, colliders=[Plane()], integrator=integrator, fps=100, device=device, precision="float64"
    )
    simulation.step(50)
    now = simulation.frame()
    np.testing.assert_array_equal(now.position[[0, 13]], system.position[[0, 13]])
    assert not now.velocity[[0, 13]].any()
    assert np.abs(now.position - system.position).max() > 0.05  # the others did


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_it_stays_with_a_reference_to_rounding(device, precision):
    system, h, steps = block(), 1 / 1000, 300
    # Frictionless, so that where a particle slides during a hit does not matter.
    how = {"colliders": [Plane(restitution=0.5, friction=0.0)], "precision": precision, "device": device}
    simulation = Simulation(system, gravity=9.82, fps=1 / (h * steps), substeps=steps, **how)
    simulation.step()
    x, v = problems.symplectic_euler_loop(system, gravity=9.82, h=h, steps=steps, floor=0.0, restitution=0.5)
    assert x[:, 2].min() == 0.0  # it has met the ground
    # In float32 each substep rounds positions of 0.4 m by ε/2 · 0.4, and springs answer within their ω = 250/s:
    # 300 of one sign are 7e-6 m and, times ω, 2e-3 m/s.
    scale = 1.0 if precision == "float32" else problems.EPS64 / problems.EPS32
    now = simulation.frame()
    assert now.position.dtype == now.velocity.dtype == precision
    np.testing.assert_allclose(now.position, x, rtol=0, atol=7e-6 * scale)
    np.testing.assert_allclose(now.velocity, v, rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize(
    ("gravity", "velocity"),
    [(8.0, [0.0, -2.0]), (8.0, [0.0, 0.0, -2.0]), ((4.0, 0.0, -8.0), [1.0, 0.0, -2.0])],
)
def test_gravity_is_a_vector_or_a_number_down_the_last_coordinate(device, gravity, velocity):
    system = System(position=np.zeros((1, len(velocity))))
    how = {"fps": 4, "substeps": 1, "device": device, "precision": "float64"}
    simulation = Simulation(system, gravity=gravity, **how)
    simulation.step()
    np.testing.assert_array_equal(simulation.frame().velocity[0], velocity)  # exact in binary


def test_frames_are_the_present_one_and_those_of_the_duration(device):
    simulation = Simulation(block(), fps=50, device=device)
    frames = list(simulation.frames(0.5))
    assert len(frames) == 0.5 * 50 + 1
    np.testing.assert_allclose([f.time for f in frames], np.arange(26) / 50, rtol=1e-15)  # a division each
    np.testing.assert_array_equal(frames[0].position, block().position.astype(np.float32))
    again = list(simulation.frames(0.1))  # goes on from where it is
    assert [f.time for f in again] == [k / 50 for k in range(25, 31)]
    np.testing.assert_array_equal(again[0].position, frames[-1].position)
    assert simulation.time == 30 / 50


def test_frames_are_copies(device):
    simulation = Simulation(block(), device=device)
    first = simulation.frame()
    position, velocity = first.position.copy(), first.velocity.copy()
    simulation.step(3)
    np.testing.assert_array_equal(first.position, position)
    np.testing.assert_array_equal(first.velocity, velocity)
    assert np.abs(simulation.frame().position - position).max() > 1e-3


def test_reset_repeats_bit_for_bit():
    # On the CPU connections are added in order; on a GPU atomics are not.
    simulation = Simulation(block(), colliders=[Plane()], device="cpu")
    runs = []
    for _ in range(3):
        simulation.step(40)
        runs.append(simulation.frame())
        simulation.reset()
        assert simulation.time == 0
        np.testing.assert_array_equal(simulation.frame().position, block().position.astype(np.float32))
    assert runs[0].time == 40 / 60
    for run in runs[1:]:
        np.testing.assert_array_equal(run.position, runs[0].position)
        np.testing.assert_array_equal(run.velocity, runs[0].velocity)


CHANGES = [
    {"stiffness": 800.0},
    {"damping": 0.0},
    {"damping": 2.0, "mass": np.linspace(0.1, 0.2, 27)},
    {"rest_length": 0.12},
]


@pytest.mark.parametrize("parameters", CHANGES, ids=[" ".join(change) for change in CHANGES])
def test_change_equals_a_new_simulation(parameters):
    options = {"colliders": [Plane()], "integrator": Leapfrog(), "device": "cpu", "precision": "float64"}
    options |= {"substeps": 20}  # automatic ones know what came before the change
    simulation = Simulation(block(), **options)
    simulation.step(20)
    fresh = Simulation(simulation.snapshot().replace(**parameters), **options)
    simulation.change(**parameters)
    assert simulation.time == 20 / 60
    simulation.step(10)
    fresh.step(10)
    np.testing.assert_array_equal(simulation.frame().position, fresh.frame().position)  # the same launches
    np.testing.assert_array_equal(simulation.frame().velocity, fresh.frame().velocity)
    assert simulation.time == 30 / 60


def test_change_composes_no_new_kernels(device, monkeypatch):
    simulation = Simulation(block(), colliders=[Plane()], device=device)
    simulation.step()
    monkeypatch.setattr(wp, "kernel", None)
    rest_length = 1.1 * simulation.system.rest_length
    simulation.change(stiffness=800.0, damping=0.7, mass=0.2, rest_length=rest_length)
    simulation.step()


def test_change_may_add_a_damper_or_a_pin(device):
    simulation = Simulation(PAIR.replace(rest_length=0.5), gravity=0.0, device=device, precision="float64")
    mass = [math.inf, 1.0]
    simulation.change(damping=5.0, mass=mass)
    simulation.step(600)
    # Ten seconds with γ = b/2m = 2.5/s: e^-25 of what was.
    now = simulation.frame()
    np.testing.assert_array_equal(now.position[0], 0.0)
    np.testing.assert_allclose(now.position[1], (0.5, 0, 0), rtol=0, atol=1e-10)


def test_reset_goes_back_to_the_parameters_given():
    simulation = Simulation(block(), device="cpu")
    substeps = simulation.substeps
    simulation.step(2)
    simulation.change(stiffness=1e6)
    assert simulation.substeps > substeps
    simulation.reset()
    assert simulation.substeps == substeps
    assert simulation.system.stiffness[0] == 500.0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"color": "red"}, "parameter is 'color'.*'mass', 'velocity', 'stiffness', 'damping', 'rest_length'"),
        ({"position": np.zeros((27, 3))}, "parameter is 'position'"),
        ({"stiffness": -1.0}, "stiffness is -1; it"),
        ({"stiffness": 800.0, "damping": math.nan}, "damping is nan; it"),
        ({"mass": 0.0}, "mass is 0; it"),
        ({"rest_length": np.ones(3)}, r"rest_length has shape \(3,\)"),
    ],
)
def test_bad_change_changes_nothing(parameters, message):
    simulation, twin = (Simulation(block(), device="cpu", precision="float64") for _ in range(2))
    system = simulation.system
    for each in (simulation, twin):
        each.step(5)
    with pytest.raises(ValueError, match=message):
        simulation.change(**parameters)
    assert simulation.system is system
    for each in (simulation, twin):
        each.step(5)
    np.testing.assert_array_equal(simulation.frame().position, twin.frame().position)
    assert simulation.time == twin.time


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_divergence_names_time_particle_and_substeps(device, precision):
    # 1e6 N/m on 0.1 kg: ω is near 10⁴/s, hundreds of times what a substep of 1/60 s can follow.
    stiff = block(stiffness=1e6).spin((1.0, 0, 0))
    simulation = Simulation(
        stiff, substeps=1, allow_unstable=True, energy_limit=math.inf, device=device, precision=precision
    )
    with pytest.raises(SimulationDiverged) as caught:
        simulation.step(1000)
    error = caught.value
    assert error.time == pytest.approx(simulation.time + 1 / 60, rel=1e-14)  # the simulation is a frame back
    assert 0 <= error.particle < 27
    assert f"particle {error.particle}," in str(error)
    assert f"{error.time:.4g} s" in str(error)
    for stage in SymplecticEuler().substep(simulation.state, None, simulation.dt):
        take_stage(simulation.stepping.dynamics, stage)
    simulation.state.flip()
    x, v = simulation.state.x.numpy(), simulation.state.v.numpy()
    finite = np.isfinite(x).all(axis=1) & np.isfinite(v).all(axis=1)
    assert error.particle == np.argmin(finite)  # the first that is not finite
    needed = int(re.search(r"at least (\d+) substeps a frame are stable", str(error)).group(1))
    assert needed == error.substeps_needed >= simulation.choice.least
    held = Simulation(stiff, substeps=needed, device=device, precision=precision)
    held.step(60)
    # Free fall, with the lattice in shape: rounding and spin stretch it by far less than 1 %.
    assert np.abs(held.snapshot().strain).max() < 0.01


@every_integrator
@pytest.mark.parametrize("damping", [0.0, 100.0])
def test_automatic_substeps_are_the_least_within_the_margin(integrator, damping):
    # For two equal particles λ(M⁻¹K) = 2k/m exactly, and the bound from either particle is that too.
    # At 47 frames/s the quotients that are rounded up below, here computed otherwise, are 20.3, 26.6 and 29.4: far
    # from whole numbers, on either side of which roundings could bring one.
    k, m, fps = 1e6, 0.5, 47.0
    pair = PAIR.replace(stiffness=k, damping=damping, mass=m)
    simulation = Simulation(pair, integrator=integrator, fps=fps, device="cpu")
    stiffness_rate, damping_rate = 2 * k / m, 2 * damping / m
    if isinstance(integrator, RK4):
        limit = min(2.615 / math.sqrt(stiffness_rate), 2.785 / damping_rate if damping else math.inf)
    else:
        limit = max(np.roots([stiffness_rate, 2 * damping_rate, -4]))
    assert simulation.substeps == math.ceil(1 / (fps * 0.8 * limit))
    assert simulation.dt == 1 / (fps * simulation.substeps)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": "abacus"}, "device is 'abacus'; it must be one of .*cpu"),
        ({"device": "cuda:99"}, "device is 'cuda:99'; it must be one of .*cpu"),
        ({"precision": "float16"}, "precision is 'float16'.*'float32', 'float32-compensated', 'float64'"),
        ({"fps": 0}, "fps is 0"),
        ({"fps": -60.0}, "fps is -60"),
        ({"fps": math.inf}, "fps is inf"),
        ({"fps": "fast"}, "fps is 'fast'"),
        ({"substeps": 0}, "substeps is 0"),
        ({"substeps": 2.5}, "substeps is 2.5"),
        ({"substeps": True}, "substeps is True"),
        ({"substeps": "many"}, "substeps is 'many'"),
        ({"gravity": math.nan}, "gravity is nan"),
        ({"gravity": (0.0, -9.82)}, r"gravity has shape \(2,\)"),
        ({"gravity": "down"}, "gravity must be an array of numbers, not 'down'"),
    ],
)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        Simulation(PAIR, **({"device": "cpu"} | options))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"duration": 0.0}, "duration is 0"),
        ({"duration": -1.0}, "duration is -1"),
        ({"duration": math.nan}, "duration is nan"),
        ({"duration": 0.001}, "duration is 0.001; it must be at least one frame"),
        ({"duration": "long"}, "duration is 'long'"),
        ({"frames": 0}, "frames is 0"),
        ({"frames": -1}, "frames is -1"),
        ({"frames": 1.5}, "frames is 1.5"),
    ],
)
def test_a_bad_duration_is_named_at_once(given, message):
    simulation = Simulation(PAIR, device="cpu")
    call = simulation.frames if "duration" in given else simulation.step
    with pytest.raises(ValueError, match=message):
        call(**given)  # not only when the first frame is asked for
