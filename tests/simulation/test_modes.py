"""Modes: closed forms, the spectrum of a simulation, what obstacles hold, and what has no modes."""

import math

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.engine import State, Tangent, assemble
from msdwarp.world import Problem

TENSION, MASS, STIFFNESS = 2.0, 0.002, 1e4
EXACT = 1e-9
"""Relative error by rounding: 1e-16 of the largest ω²; the slowest ω² of these bodies are 1e-6 of it at least."""


def half(n, cells: int) -> np.ndarray:
    return np.sin(np.asarray(n) * math.pi / (2 * cells))


def test_a_string_and_a_membrane_have_the_frequencies_of_their_lattices():
    # ω = 2 √(T/(m a)) sin(nπ/2N); of a membrane √(sin² + sin²) (Morse & Ingard, Theoretical Acoustics, 1968).
    cells, a = 12, 0.05
    wave = math.sqrt(TENSION / (MASS * a)) / math.pi
    string = msd.chain(cells + 1, a, mass=MASS, stiffness=STIFFNESS).replace(rest_length=a - TENSION / STIFFNESS)
    found = msd.modes(string.pin([0, cells]), 6)
    # Each twice: in both directions across the string.
    assert found.frequencies == pytest.approx(wave * half([1, 1, 2, 2, 3, 3], cells), rel=EXACT)
    first = half(2 * np.arange(cells + 1), cells)
    assert np.linalg.norm(found.shapes[0], axis=1) == pytest.approx(first, abs=1e-6)
    assert found.masses[0] == pytest.approx(MASS * (first**2).sum(), rel=1e-6)
    net = msd.sheet((cells + 1, cells + 1), a, neighbors=4, mass=MASS, stiffness=STIFFNESS)
    net = net.replace(rest_length=a - TENSION / STIFFNESS)
    rim = (np.abs(net.position[:, :2]) > 0.3 - 1e-9).any(axis=1)
    several = np.hypot(half([1, 1, 2, 2, 1, 3], cells), half([1, 2, 1, 2, 3, 1], cells))
    assert msd.modes(net.pin(rim), 6).frequencies == pytest.approx(wave * several, rel=EXACT)


def test_a_free_bar_rings_and_is_damped_as_its_material_says():
    # ω = 2 √(E/ρ)/a sin(nπ/2N), and ζ ω/ω₁ with the slowest ω₁ of the continuous bar, π √(E/ρ)/L.
    cells, ratio = 40, 0.05
    material = msd.Material(density=1000.0, youngs_modulus=1e6, damping_ratio=ratio)
    found = msd.modes(msd.chain(cells + 1, 1 / cells, material=material, area=1e-4, dim=1), 5)
    speed = math.sqrt(1e6 / 1000.0)
    assert found.frequencies == pytest.approx(speed * cells / math.pi * half(range(5), cells), rel=EXACT)
    assert np.isnan(found.damping_ratios[0])  # it moves as a whole
    assert found.damping_ratios[1:] == pytest.approx(ratio * found.frequencies[1:] / (speed / 2), rel=EXACT)


def test_a_free_rod_rings_as_a_beam():
    # (βL)² √(E I/(ρ A))/L² with βL = 4.7300 and 7.8532 (Rao, Mechanical Vibrations, 8.5), in both planes.
    radius, wire = 0.005, msd.STEEL_WIRE
    bending = math.sqrt(wire.youngs_modulus / wire.density) * radius / 2 / (2 * math.pi)
    theory = bending * np.array([4.730040745, 4.730040745, 7.853204624, 7.853204624]) ** 2
    error = []
    for count in (41, 81, 1001):
        found = msd.modes(msd.rod(count, 1 / (count - 1), radius=radius, material=wire), 9).frequencies
        assert (found[:5] == 0.0).all()  # a line of particles does not turn about itself
        error.append(np.abs(found[5:] / theory - 1).max())
    assert error[1] == pytest.approx(error[0] / 4, rel=0.05)  # of second order
    # 625 times smaller than with 40 pieces; rounding is 1e-6, as these ω² are 1e-10 of the largest.
    assert error[2] == pytest.approx(error[0] / 625, abs=3e-6)


def test_weight_and_tension_count_and_an_upside_down_pendulum_is_unstable():
    mass, stiffness, damping, g = 2.0, 200.0, 4.0, 9.82
    pendulum = msd.System(
        position=[[0, 0, 1.0], [0, 0, 0]],
        mass=[np.inf, mass],
        connections=[[0, 1]],
        stiffness=stiffness,
        damping=damping,
        rest_length=1.0,
    )
    swing, bounce = math.sqrt(g / (1 + mass * g / stiffness)), math.sqrt(stiffness / mass)
    found = msd.modes(msd.Scene(system=pendulum, settled=True), 3)
    # The force that settling leaves is 1e-3 of the weight, which is a tenth of the length.
    assert 2 * math.pi * found.frequencies == pytest.approx([swing, swing, bounce], rel=1e-4)
    assert found.damping_ratios[2] == pytest.approx(damping / (2 * math.sqrt(stiffness * mass)), rel=EXACT)
    simulation = msd.Simulation(pendulum, precision="float64", device="cpu")
    simulation.settle()
    assert msd.modes(simulation, 3).frequencies == pytest.approx(found.frequencies, rel=1e-4)
    length = 1 - mass * g / stiffness
    standing = msd.modes(pendulum.replace(position=[[0, 0, 0], [0, 0, length]]), 3)
    fall = -math.sqrt(g / length)
    assert 2 * math.pi * standing.frequencies == pytest.approx([fall, fall, bounce], rel=EXACT)


def block(**changes) -> msd.System:
    material = msd.Material(density=1000.0, youngs_modulus=1e5, poissons_ratio=0.45)
    body = msd.box((4, 4, 4), 0.05, material=material)
    return body.translate((0, 0, 0.075)).replace(**changes)


@pytest.mark.slow
def test_a_simulation_vibrates_with_these_frequencies():
    # A block with cells on a soft floor, tied at a corner, in float64, thrown a little at random.
    system = block()
    floor, tie = msd.Plane(friction=0.0, stiffness=2e3), msd.Attachment([0], to=(0, 0, 0), stiffness=50.0)
    scene = msd.Scene(system=system, colliders=[floor], loads=[tie], settled=True)
    found = msd.modes(scene, 12)
    thrown = 1e-5 * np.random.default_rng(0).normal(size=system.position.shape)
    begun = scene.replace(system=system.replace(position=found.position, velocity=thrown), settled=False)
    fps, seconds = 120.0, 8.0
    how = {"fps": fps, "device": "cpu", "precision": "float64"}
    simulation = msd.Simulation(begun, integrator=msd.RK4(), **how)
    moved = np.array([frame.position - found.position for frame in simulation.frames(seconds)])
    modal = np.einsum("tid,i,kid->tk", moved - moved.mean(axis=0), system.mass, found.shapes)
    spectrum = np.log(np.abs(np.fft.rfft(np.hanning(len(moved))[:, None] * modal, axis=0)))
    for k in range(3, 12):
        # The other modes are orthogonal: their peaks do not show.
        n = int(spectrum[:, k].argmax())
        left, top, right = spectrum[n - 1 : n + 2, k]
        peak = n + 0.5 * (left - right) / (left - 2 * top + right)  # a Hann window's is nearly a Gaussian
        # The parabola is off by 0.016 of a line at most, and lines are 1/8 Hz apart.
        assert peak * fps / len(moved) == pytest.approx(found.frequencies[k], abs=0.03 / seconds)


def test_what_presses_on_an_obstacle_is_held_and_slides_without_friction():
    def standing(friction: float) -> msd.Modes:
        scene = msd.Scene(system=block(), colliders=[msd.Plane(friction=friction)], settled=True)
        return msd.modes(scene, 12)

    rough, smooth = standing(0.5), standing(0.0)
    bottom = rough.position[:, 2] < 0.01
    assert bottom.sum() == 16
    held = block(position=rough.position).pin(bottom)
    assert rough.frequencies == pytest.approx(msd.modes(held, 12).frequencies, rel=EXACT)
    assert np.abs(smooth.shapes[:, bottom, 2]).max() < 1e-9
    assert np.abs(smooth.frequencies[:3]).max() < 0.05  # it slides, and turns on the floor
    free = msd.modes(block(position=smooth.position), 12).frequencies
    # The fewer directions are held, the slower (Rayleigh's theorem): 48, 16 and 0.
    assert (rough.frequencies[3:] > smooth.frequencies[3:]).all()
    assert (smooth.frequencies[3:] > free[3:]).all()
    # Far from an obstacle, or without force on it, nothing is held.
    away = msd.Scene(system=block(), colliders=[msd.Plane((0, 0, 1), -0.2), msd.Plane((0, 0, -1), -0.4)])
    assert msd.modes(away, 7).frequencies[6] == pytest.approx(msd.modes(block(), 7).frequencies[6], rel=EXACT)


def test_shapes_are_orthogonal_and_what_can_tear_or_yield_is_whole():
    body = msd.box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0).pin([0, 1, 3])
    found = msd.modes(body, 12)
    mass = np.where(body.pinned, 0.0, body.mass)
    overlap = np.einsum("kid,i,lid->kl", found.shapes, mass, found.shapes)
    assert overlap == pytest.approx(np.diag(found.masses), abs=1e-9 * found.masses.max())
    assert np.linalg.norm(found.shapes, axis=2).max(axis=1) == pytest.approx(1.0)
    assert not found.shapes[:, body.pinned].any()
    tearing = body.replace(break_strain=0.1, yield_strain=0.05)
    assert msd.modes(tearing, 12).frequencies == pytest.approx(found.frequencies, rel=EXACT)
    cut = np.arange(body.connection_count) == 100
    torn, gone = body.replace(broken_at=np.where(cut, 0.0, np.inf)), body.replace(stiffness=300.0 * ~cut)
    expected = msd.modes(gone, 12).frequencies
    assert expected[0] < found.frequencies[0]
    assert msd.modes(torn, 12).frequencies == pytest.approx(expected, rel=EXACT)
    # Above half of the number of free coordinates all are found, by another solver.
    everything = msd.modes(body, 99)
    assert len(everything.masses) == 72
    assert everything.frequencies[:12] == pytest.approx(found.frequencies, rel=EXACT)


@pytest.mark.slow
def test_matrices_are_derivatives_of_the_simulations_forces():
    # Springs, cells, angles, a gas, an attachment, and a soft floor at once.
    ball = msd.ball(0.1, 0.05, material=msd.RUBBER).named("ball")
    rod = msd.rod(5, 0.05, radius=0.01, material=msd.RUBBER).translate((0.5, 0, 0))
    system = (ball + rod).replace(damping=0.2)
    rng = np.random.default_rng(0)
    system = system.replace(position=system.position + 0.002 * rng.normal(size=system.position.shape))
    loads = [
        msd.EnclosedGas(3e5, on="ball"),
        msd.Attachment([0, 1], to=(0, 0, 0.3), stiffness=20.0, damping=0.1, rest_length=0.1),
    ]
    problem = Problem(system=system, loads=loads, colliders=[msd.Plane(offset=-0.08, stiffness=1e3)]).begun()
    assembly = assemble(problem, device="cpu", precision="float64")
    way, step = rng.normal(size=system.position.shape), 1e-7

    def tangent(x: np.ndarray, v: np.ndarray) -> Tangent:
        return Tangent(assembly, State.from_system(system.replace(position=x, velocity=v), assembly.model), 0.0)

    x, still = system.position, np.zeros_like(way)
    for k, move in enumerate((lambda s: (x + s * way, still), lambda s: (x, s * way))):
        matrix = tangent(x, still).matrices()[k]
        there, back = (tangent(*move(s)).forces() for s in (step, -step))
        found = (matrix @ way.ravel()).reshape(way.shape)
        # The difference is rounded at 1e-16 of positions and forces over 1e-7, and cut off at its square.
        assert found == pytest.approx((back - there) / (2 * step), abs=1e-6 * np.abs(found).max())


@pytest.mark.parametrize(
    ("system", "count", "message"),
    [
        (3, 4, "system is 3; it must be a System"),
        (msd.chain(3), 0, "count is 0; it must be a whole number of at least 1"),
        (msd.chain(3).pin([0, 1, 2]), 7, "the system has no particle that can move"),
    ],
)
def test_bad_input_is_named(system, count, message):
    with pytest.raises(ValueError, match=message):
        msd.modes(system, count)


def test_what_has_no_modes_is_told():
    ball = msd.ball(0.1, 0.05, mass=1e-3, stiffness=50.0)
    with pytest.raises(ValueError, match="the stiffness matrix is not symmetric"):
        msd.modes(msd.Scene(system=ball, loads=[msd.Wind((3, 0, 0))]))


@pytest.mark.slow
def test_bodies_have_modes_until_they_touch():
    def above(height: float) -> msd.Scene:
        return msd.Scene(system=block() + block().translate((0, 0, height)), contact=msd.Contact())

    with pytest.raises(ValueError, match="bodies touch each other"):
        msd.modes(above(0.1499))
    apart = msd.modes(above(0.4), 14)
    one = msd.modes(block(), 7).frequencies[6]
    assert apart.frequencies[12:] == pytest.approx(one, rel=EXACT)
