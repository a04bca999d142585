"""Bodies that touch: restitution, friction, rest, what is conserved, and which bodies touch at all."""

import math

import numpy as np
import pytest
from problems import EPS64
from scipy.integrate import solve_ivp
from surfaces import nearest_distances

from msdwarp import (
    RK4,
    RKC2,
    Contact,
    Leapfrog,
    Plane,
    Simulation,
    SymplecticEuler,
    System,
    box,
    chain,
    sheet,
)
from msdwarp.engine.collision.body_contact import BodyContact
from msdwarp.kernels.collision.law import MEMORY

G = 9.82


def contact_of(simulation: Simulation) -> BodyContact:
    return next(effect for effect in simulation.assembly.all if isinstance(effect, BodyContact))


# --- Single particles ---


def pairs(gaps: np.ndarray) -> System:
    """Return pairs of particles that come towards each other at 1 m/s each, so far from where they touch."""
    position, velocity = np.zeros((2, 2 * len(gaps), 3))
    position[:, 1] = np.repeat(np.arange(len(gaps)), 2)
    position[1::2, 0] = 0.1 + gaps
    velocity[0::2, 0], velocity[1::2, 0] = 1.0, -1.0
    return System(position=position, velocity=velocity, mass=1.0, connections=np.zeros((0, 2), int))


STIFFNESS = 1e4
OMEGA = math.sqrt(4 * STIFFNESS)
"""Angular frequency of a pair [1/s]: each of two particles of 1 kg is a point of contact with the other."""


def bounced(restitution: float, finer: int, **options) -> tuple[np.ndarray, float]:
    """Return the restitution of pairs that meet at different moments of a substep, and its length [s].

    There are `finer` times as many substeps as automatic.
    """
    contact = Contact(thickness=0.1, stiffness=STIFFNESS, friction=0.0, restitution=restitution)
    options = {"gravity": 0.0, "contact": contact, "precision": "float64"} | options
    substeps = Simulation(pairs(np.ones(1)), **options).substeps
    way = 2.0 / (60 * substeps)  # towards each other in a substep
    simulation = Simulation(pairs(way * (np.arange(16) + 0.5) / 16), substeps=finer * substeps, **options)
    simulation.step(3)  # a contact lasts π / ω = 16 ms, and longer where it is damped
    assert simulation.measure().effect_energy == 0
    v = simulation.frame().velocity
    # Forces are whole numbers of a unit, and masses are 1: what is added to one is taken from the other.
    np.testing.assert_array_equal(v[0::2], -v[1::2])
    return (v[1::2, 0] - v[0::2, 0]) / 2, 1 / (60 * finer * substeps)


def restitution_by_the_law(restitution: float, memory: float) -> float:
    """Return the restitution of x'' = −x (1 + α x'/v), in units of 1/ω, where v = exp(−t / memory)."""
    alpha = Contact(restitution=restitution).hysteresis

    def motion(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -max(0.0, y[0] * (1 + alpha * y[1] * math.exp(t / memory)))]

    def parted(t: float, y: np.ndarray) -> float:
        return y[0]

    parted.terminal, parted.direction = True, -1  # type: ignore[attr-defined]
    return -solve_ivp(motion, (0, 20), [1e-14, 1.0], events=parted, rtol=1e-9, atol=1e-12, max_step=0.1).y[1, -1]


@pytest.mark.parametrize(
    ("restitution", "method"),
    [
        pytest.param(0.2, SymplecticEuler(), marks=pytest.mark.slow),
        pytest.param(0.5, RK4(), marks=pytest.mark.slow),
        (0.9, SymplecticEuler()),
        pytest.param(0.9, Leapfrog(), marks=pytest.mark.slow),
        (1.0, SymplecticEuler()),
    ],
)
def test_two_particles_bounce_as_asked(plain_device, restitution, method):
    # As damping grows while the fastest approach is forgotten, restitution is less than asked: by less than 2 %.
    lawful = restitution_by_the_law(restitution, math.sqrt(2) * MEMORY)  # one point's √(k/m) is ω/√2
    assert 0.98 < lawful / restitution < 1.0 + 1e-6  # as exactly as the motion is solved
    for finer in (1, 2, 4):
        found, h = bounced(restitution, finer, device=plain_device, integrator=method)
        # A symplectic method keeps (v² + ω² x² − ω² h x v) / 2 in contact, and v² / 2 without. Contact begins and
        # ends with an overlap x below h v: there the energy is wrong by up to (ωh)²/4 of itself, v by (ωh)²/8.
        # 1e-3: a contact forgets nothing before it slows down, but the reference does.
        assert np.abs(found / lawful - 1).max() < (OMEGA * h) ** 2 / 4 + 1e-3
        assert abs(found.mean() / restitution - 1) < 0.02


@pytest.mark.slow
def test_a_particle_bounces_off_tiles_as_asked(plain_device):
    # Only the particle is a point of contact, as all points of a tile are far away: ω² = k/m.
    count, restitution, options = 8, 0.5, {"gravity": 0.0, "precision": "float64", "device": plain_device}
    contact = Contact(thickness=0.05, stiffness=STIFFNESS, friction=0.0, restitution=restitution)
    tile = sheet((2, 2), 1.0, mass=float("inf"), stiffness=STIFFNESS)
    grain = System(
        position=[[0.2, -0.1, 0.05]], velocity=[[0, 0, -1]], mass=1.0, connections=np.zeros((0, 2), int)
    )
    options |= {"contact": contact, "integrator": RK4()}
    h = 1 / (60 * Simulation(tile + grain.translate((0, 0, 1)), **options).substeps)
    whole = None
    for k in range(count):  # each meets its tile at another moment of a substep
        both = (tile + grain.translate((0, 0, h * (k + 0.5) / count))).translate((0, 2 * k, 0))
        whole = both if whole is None else whole + both
    simulation = Simulation(whole, substeps=round(1 / (60 * h)), **options)
    simulation.step(5)  # π / ω = 31 ms, and longer as it is damped
    found = simulation.frame().velocity[4::5, 2]
    lawful = restitution_by_the_law(restitution, MEMORY)
    # As above: it tells whether a method of stages notes how fast a particle was before it was slowed down.
    assert np.abs(found / lawful - 1).max() < STIFFNESS * h**2 / 4 + 1e-3


def test_unequal_particles_share_momentum(device):
    system = pairs(np.array([0.01])).replace(mass=[1.0, 3.0])
    contact = Contact(thickness=0.1, stiffness=1e4, friction=0.0, restitution=0.9)
    simulation = Simulation(system, contact=contact, gravity=0.0, device=device, precision="float64")
    simulation.step(4)
    v = simulation.frame().velocity[:, 0]
    # One rounding of v in each of some hundred substeps, of 4 kg m/s.
    assert v[0] + 3 * v[1] == pytest.approx(-2.0, abs=100 * 4 * EPS64)
    assert v[1] - v[0] == pytest.approx(2 * 0.9, rel=0.025)


# --- Blocks ---


def dice(**constants) -> System:
    return box((3, 3, 3), 0.1, **({"mass": 0.02, "stiffness": 2e4, "damping": 8.0} | constants))


def on_a_slope(angle: float, friction: float, frames: int, device: str, finer: int = 1) -> np.ndarray:
    """Return where a block on a pinned one is along a slope, and how fast, shape [frames, 2]."""
    low = box((9, 5, 2), 0.1, mass=0.02, stiffness=2e4, damping=8.0)
    x = low.position
    low = low.pin(np.flatnonzero(x[:, 2] < x[:, 2].min() + 1e-6))
    die = dice()
    die = die.translate(np.array([x[:, 0].min() + 0.07, -0.09, x[:, 2].max()]) - die.position.min(axis=0))
    falls = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    options = {"gravity": falls, "contact": Contact(friction=friction), "device": device}
    substeps = Simulation(low + die, **options).substeps
    simulation, found = Simulation(low + die, substeps=finer * substeps, **options), []
    for _ in range(frames):
        simulation.step()
        found.append([each[-27:, 0].mean() for each in simulation.frame()[1:3]])
    # What lies on a surface lies where that is drawn: within 5 % of the spacing.
    assert 0 < contact_of(simulation).deepest < 0.05 * 0.1
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("finer", [1, 4])
def test_a_block_holds_on_a_gentle_slope(plain_device, finer):
    x = on_a_slope(math.radians(15), 0.5, 60, plain_device, finer)[:, 0]  # tan 15° = 0.27 < 0.5
    assert abs(x[-1] - x[-31]) / 0.5 < 1e-4  # [m/s] over the last half second
    assert abs(x[-1] - x[0]) < 1e-3


@pytest.mark.slow
def test_a_block_slides_on_a_steep_slope(plain_device):
    angle = math.radians(35)
    v = on_a_slope(angle, 0.3, 33, plain_device)[10:, 1]
    # Its points pass over edges one at a time; what vibrates then is damped, which takes 2 to 3 % of the work.
    expected = G * (math.sin(angle) - 0.3 * math.cos(angle))
    assert np.polyfit(np.arange(len(v)) / 60, v, 1)[0] == pytest.approx(expected, rel=0.03)


@pytest.mark.slow
def test_a_stack_of_five_rests(plain_device):
    stack = dice().translate((0, 0, 0.1))
    for k in range(1, 5):
        stack = stack + dice().rotate(0.3 * k, axis=(0, 0, 1)).translate((0.01 * k, 0, 0.1 + 0.201 * k))
    floor = Plane(friction=0.5)
    simulation = Simulation(stack, colliders=[floor], contact=Contact(), device="cpu")
    simulation.step(360)
    assert simulation.measure().kinetic_energy < 1e-4 * stack.mass.sum() * G * 0.1
    deepest = contact_of(simulation).deepest
    assert 0 < deepest < 0.05 * 0.1
    # Two that lie on each other share at most a layer as thick as that on a side of a die.
    assert deepest * 0.2**2 < 0.005 * 0.2**3
    lowest = simulation.frame().position.reshape(5, 27, 3)[:, :, 2].min(axis=1)
    np.testing.assert_allclose(np.diff(lowest), 0.2, rtol=0, atol=0.005)  # as tall as they are


def thrown(**constants) -> System:
    """Return four dice that fly at each other, turning."""
    whole = None
    for k in range(4):
        way = np.array([math.cos(1.6 * k), math.sin(1.6 * k), 0.1 * k])
        die = dice(**constants).rotate(0.7 * k + 0.2, axis=(1, k, 2)).translate(0.26 * way)
        die = die.replace(velocity=-1.5 * way + np.cross([0, k - 1.0, 2.0], die.position - 0.26 * way))
        whole = die if whole is None else whole + die
    return whole


def of_dice(simulation: Simulation) -> np.ndarray:
    """Return the momentum of each of four dice [kg m/s], shape [4, 3]."""
    return (0.02 * simulation.frame().velocity).reshape(4, 27, 3).sum(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_momentum_over_many_substeps(plain_device, friction):
    options = {"gravity": 0.0, "device": plain_device, "precision": "float64"}
    simulation = Simulation(thrown(), contact=Contact(friction=friction), substeps=200, **options)
    before, started = simulation.measure(), of_dice(simulation)
    simulation.step(50)
    after = simulation.measure()
    size = float((thrown().mass * np.linalg.norm(thrown().velocity, axis=1)).sum())
    assert np.linalg.norm(of_dice(simulation) - started, axis=1).min() > 0.01 * size  # each has met another
    # Each of 10⁴ substeps rounds each momentum by ε/2 at most; of those about the origin the arm is below 1 m.
    # Forces on two bodies act along one line, and friction at one point.
    rounded = {"rtol": 0, "atol": 1e4 * EPS64 * size}
    np.testing.assert_allclose(after.momentum, before.momentum, **rounded)
    np.testing.assert_allclose(after.angular_momentum, before.angular_momentum, **rounded)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "most", "less"),
    [(SymplecticEuler(), 0.02, 3.0), (Leapfrog(), 0.002, 1.5), (RK4(), 0.002, 3.0)],
    ids=["euler", "leapfrog", "rk4"],
)
def test_undamped_bodies_keep_their_energy(plain_device, method, most, less):
    # Euler's energy swings by a share h ω/2 of what springs hold: first order, seen 1.0 % and 0.23 % at a quarter
    # of the step. The others err by where forces have kinks or jump, which is where contacts begin and end, and
    # where another facet comes to be the nearest: irregularly, seen 0.10 % and 0.05 %, 0.12 % and 0.02 %.
    options = {"gravity": 0.0, "device": plain_device, "precision": "float64", "integrator": method}
    worst = []
    for substeps in (60, 240):
        contact = Contact(friction=0.0, restitution=1.0)
        simulation = Simulation(thrown(damping=0.0), contact=contact, substeps=substeps, **options)
        energies, stored = [simulation.measure().energy], 0.0
        for _ in range(12):
            simulation.step()
            measures = simulation.measure()
            energies.append(measures.energy)
            stored = max(stored, measures.effect_energy)
        assert stored > 0.01 * energies[0]  # contact has had its share
        worst.append(np.abs(np.array(energies) / energies[0] - 1).max())
    assert worst[0] < most
    assert worst[1] < worst[0] / less


# --- Who touches ---


def meeting(*names: str) -> System:
    """Return dice one above the other that approach at 1 m/s, each in a group of its own."""
    whole = None
    for k, name in enumerate(names):
        die = dice(stiffness=2e3).translate((0.01 * k, 0.02 * k, 0.21 * k)).named(name)
        die = die.replace(velocity=(0, 0, 0.5 - k))
        whole = die if whole is None else whole + die
    return whole


@pytest.mark.parametrize(
    ("contact", "touches"),
    [
        (Contact(), True),
        (Contact(groups=("a", "b")), True),
        (Contact(groups=("b", "a")), True),
        (Contact(groups=("a", "a")), False),
        (Contact(exclude=True), False),
        ([Contact(), Contact(groups=("a", "b"), exclude=True)], False),
        ([Contact(groups=("a", "b"), exclude=True), Contact()], True),  # the last one counts
        ([Contact(exclude=True), Contact(groups=("a", "b"))], True),
        (None, False),
    ],
)
def test_which_bodies_touch(device, contact, touches):
    options = {"gravity": 0.0, "device": device, "precision": "float64"}
    simulation = Simulation(meeting("a", "b"), contact=contact, **options)
    simulation.step(6)
    free = Simulation(meeting("a", "b"), **options)
    free.step(6)
    same = np.abs(simulation.frame().velocity - free.frame().velocity).max() < 1e-12  # as if alone, to rounding
    assert same == (not touches)


def test_rules_hold_for_their_own_pairs(device):
    rules = [Contact(), Contact(groups=("a", "b"), exclude=True)]
    simulation = Simulation(meeting("a", "b", "c"), contact=rules, gravity=0.0, device=device, precision="float64")
    simulation.step(5)
    vertical = simulation.frame().velocity.reshape(3, 27, 3)[:, :, 2].mean(axis=1)
    assert vertical[0] == pytest.approx(0.5, abs=1e-12)  # nothing has held it up
    assert vertical[1] < -0.6  # c has pushed it
    assert vertical[1] + vertical[2] == pytest.approx(-2.0, abs=1e-12)


def folded(thickness: float) -> System:
    """Return a sheet folded in two by half a turn, whose layers are three times as far apart as it is thick."""
    flat = sheet((21, 5), 0.05, mass=0.005, stiffness=300.0, damping=0.2)
    along, radius = flat.position[:, 0] - flat.position[:, 0].min(), 1.5 * thickness
    bend = 0.5 - math.pi * radius / 2
    turn = np.clip((along - bend) / radius, 0, math.pi)
    x = np.minimum(along, bend) + radius * np.sin(turn) - np.maximum(along - bend - math.pi * radius, 0)
    return flat.replace(position=np.stack([x, flat.position[:, 1], radius * (1 - np.cos(turn))], axis=1))


# --- What is refused ---


def test_stiffness_must_be_given_where_there_is_none():
    grains = pairs(np.ones(2))
    with pytest.raises(ValueError, match=r"contact.stiffness is None, but 4 of the bodies have no connections"):
        Simulation(grains, contact=Contact(thickness=0.1), device="cpu")
    with pytest.raises(ValueError, match=r"contact.stiffness is None, but 4 of the bodies"):
        Simulation(grains + dice(), contact=[Contact(stiffness=1.0), Contact()], device="cpu")
    Simulation(grains, contact=Contact(thickness=0.1, stiffness=100.0), device="cpu")


def test_a_group_must_hold_whole_bodies():
    system = dice().named("a") + dice().translate((0, 0, 1)).named("b")
    torn = system.replace(groups=system.groups | {"half": np.arange(13)})
    with pytest.raises(ValueError, match=r"contact.groups names 'half', which holds a part of a body"):
        Simulation(torn, contact=Contact(groups=("half", "b")), device="cpu")


def test_nothing_of_it_is_there_where_nothing_touches():
    plain = Simulation(meeting("a", "b"), device="cpu").stepping.dynamics.composition
    for contact in (Contact(exclude=True), [Contact(groups=("a", "b"), exclude=True)]):
        simulation = Simulation(meeting("a", "b"), contact=contact, device="cpu")
        assert not any(isinstance(effect, BodyContact) for effect in simulation.assembly.all)
        assert simulation.stepping.dynamics.composition == plain  # from which all kernels are made
    touching = Simulation(meeting("a", "b"), contact=Contact(), device="cpu").stepping.dynamics.composition
    assert [term.field for term in touching.terms] == ["body_contact"]
    assert touching._replace(terms=()) == plain


@pytest.mark.slow
def test_ropes_and_bodies_meet(plain_device):
    # A rope falls over a bar and lies on it by half its own thickness: 1/4 of the length of its connections.
    bar = box((5, 3, 3), 0.1, mass=float("inf"), stiffness=300.0)
    rope = chain(21, 0.05, mass=0.002, stiffness=300.0, damping=0.2)
    rope = rope.translate(np.array([0, 0, 0.13]) - rope.position.mean(axis=0))
    simulation = Simulation(bar + rope, contact=Contact(friction=0.9), device=plain_device)
    simulation.step(60)
    position = simulation.frame().position
    x, s = position[45:], contact_of(simulation).surfaces.on_host
    # It goes around the edges, r inside the drawn ones at 0.2, as a polygon: its vertices there lie higher.
    on = np.abs(x[:, 0]) < 0.125
    assert on.sum() == 5
    # It sinks in by its weight over the stiffness: 0.02 m of 0.04 kg/m by 300 N/m.
    np.testing.assert_allclose(x[on, 2], 0.1 + 0.0125, rtol=0, atol=2e-4)
    assert x[:, 2].min() < 0
    # At an edge two parts pull, at right angles, by the weight of what hangs. A rope has two points for each
    # particle, which have half of the stiffness.
    vertices = np.einsum("vk,vkd->vd", s.weight, position[s.particle])
    facets = vertices[s.corner[s.body[s.corner[:, 0]] == 0]]
    deepest = math.sqrt(2) * (x[:, 2] < 0.1).sum() / 2 * 0.002 * G / 150
    for t in np.linspace(0, 1, 11):
        points = np.repeat(x[:-1] + t * np.diff(x, axis=0), len(facets), axis=0)
        away = nearest_distances(points, np.tile(facets, (len(x) - 1, 1, 1)))
        assert away.min() > s.radius.sum() - deepest


def test_a_method_of_too_long_steps_is_refused():
    with pytest.raises(ValueError, match=r"integrator is RKC2.*; where bodies touch it must be another"):
        Simulation(dice(), contact=Contact(), integrator=RKC2(), device="cpu")
