"""Probes: what they tell against statics, the balance of momentum, and the frames themselves."""

import numpy as np
import pytest
from modes import amplification
from problems import EPS64

from msdwarp import (
    RK4,
    RKC2,
    Contact,
    Force,
    Leapfrog,
    LinearlyImplicitEuler,
    Material,
    Plane,
    Probe,
    Scene,
    Simulation,
    Sphere,
    SymplecticEuler,
    System,
    box,
    chain,
)
from msdwarp.world import BODY_CONTACT_FORCE, QUANTITIES, STRESS

pytestmark = pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")
G = 9.82
METHODS = [
    SymplecticEuler(),
    Leapfrog(),
    Leapfrog(damper_extrapolation=0.5),
    RK4(),
    RKC2(),
    LinearlyImplicitEuler(iterations=10),
]
ALONE = [one for one in QUANTITIES if one not in (BODY_CONTACT_FORCE, STRESS)]
"""What there is to be told of a body without cells that touches no other."""


def standing(**constants) -> System:
    """Return a block of 27 particles whose lowest ones are on the plane z = 0."""
    if "material" not in constants:
        constants = {"stiffness": 5000.0, "damping": 50.0, **constants}
    block = box((3, 3, 3), 0.1, **constants)
    return block.replace(position=block.position - [0, 0, block.position[:, 2].min()]).named("block")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS[2::3], ids=str)
def test_a_resting_block_presses_with_its_weight(plain_device, method):
    block = standing()
    probes = {"under": Probe("block", "contact force")}
    simulation = Simulation(block, colliders=[Plane()], integrator=method, probes=probes, device=plain_device)
    simulation.step(400)  # its slowest mode is damped at some 10/s: e⁻⁶⁰ of the fall is left
    weight = G * block.mass.sum()
    # The contact rule holds what rests at no speed: what is left is float32's rounding, 1e-7 for each of 27 × 10
    # impulses a frame, of either sign. Half a per mille would do.
    values = simulation.readings["under"].values[-20:]
    np.testing.assert_allclose(values, np.tile([0.0, 0.0, weight], (20, 1)), rtol=0, atol=1e-5 * weight)


def thrown(device: str) -> Simulation:
    """Return a block that is thrown at the ground and at a sphere that turns, with friction and restitution."""
    block = standing(stiffness=2000.0)
    block = block.translate((0, 0, 0.02)).with_velocity((2.0, 0.5, -3.0))
    colliders = [
        Plane(friction=0.4, restitution=0.6),
        Sphere((0.4, 0.1, 0.1), 0.2, motion=lambda t: ((-t, 0.0, 0.0), (0.0, 0.0, 3.0 * t))),
    ]
    return Simulation(
        block,
        colliders=colliders,
        loads=[Force((0.0, 1.0, 0.0), on=[0, 5])],
        probes={"all": Probe("block", "contact force"), "corner": Probe([0], "contact force")},
        precision="float64",
        substeps=20,
        device=device,
    )


def test_contact_impulses_are_what_momentum_lacks(device):
    # p' − p = (M g + F) t + contact impulses, with swept ways too.
    simulation = thrown(device)
    block = simulation.system
    simulation.step(30)
    times, values = simulation.readings["all"]
    np.testing.assert_allclose(times, np.arange(1, 31) / 60, rtol=1e-15)
    momentum = block.mass @ simulation.frame().velocity - block.mass @ block.velocity
    given = 0.5 * (G * block.mass.sum() * np.array([0.0, 0.0, -1.0]) + [0.0, 2.0, 0.0])
    size = np.abs(values).sum() / 60
    assert size > 50.0, "it must have been pushed"
    # 600 substeps of sums over 27 particles and their springs, rounded each.
    np.testing.assert_allclose(values.sum(axis=0) / 60, momentum - given, rtol=0, atol=600 * 27 * EPS64 * size)
    assert np.abs(simulation.readings["corner"].values).max() > 0


def test_readings_begin_anew_after_a_restore_and_a_reset(device):
    first, other = thrown(device), thrown(device)
    first.step(2)
    kept = first.checkpoint()
    first.step(2)
    other.step(3)
    other.restore(*kept)
    assert other.readings["all"].values.shape == (0, 3)
    other.step(2)
    here, there = other.readings["all"], first.readings["all"]
    np.testing.assert_array_equal(here.times, there.times[2:])
    # Exactly so in a fixed order; in another one float64 rounds forces of 100 N to some 1e-13.
    np.testing.assert_allclose(here.values, there.values[2:], rtol=0, atol=0 if device == "cpu" else 1e-9)
    first.reset()
    assert first.readings["all"].values.shape == (0, 3)


def test_a_support_reads_what_hangs_on_it(device):
    # A chain at rest: the pinned end bears all the others, the third link what is below it.
    rope = chain(6, spacing=0.1, stiffness=2000.0, damping=20.0, mass=0.5).pin(0)
    rope = rope.replace(position=-rope.position[:, ::-1])  # straight down
    probes = {"top": Probe([0], "force"), "free": Probe([1, 2, 3, 4, 5], "force"), "three": Probe([3], "force")}
    probes |= {"link": Probe([0, 1], "tension"), "links": Probe([2, 3, 4, 5], "tension")}
    simulation = Simulation(rope, probes=probes, precision="float64", device=device)
    simulation.step(600)
    down = np.array([0.0, 0.0, -1.0])
    # Rates of a few per second and more have had ten seconds; what is left is seen as nothing by the third.
    for name, expected in (("top", 2.5 * G * down), ("free", 0 * down), ("three", 0 * down)):
        np.testing.assert_allclose(simulation.readings[name].values[-1], expected, rtol=0, atol=1e-6)
    # Five masses hang on the first link; three, two and one on the last ones.
    for name, expected in (("link", (2.5 * G, 2.5 * G)), ("links", (1.0 * G, 1.5 * G))):
        np.testing.assert_allclose(simulation.readings[name].values[-1], expected, rtol=0, atol=1e-6)


def test_means_and_strains_are_those_of_the_frames(device):
    mass = 0.1 + 0.01 * np.arange(27)
    block = standing(mass=mass).pin([0, 1])
    group = np.array([0, 1, 5, 6, 14, 26])
    names = ("position", "velocity", "strain")
    simulation = Simulation(
        block,
        integrator=Leapfrog(),
        probes={name: Probe(group, name) for name in names},
        device=device,
    )
    weight = np.where(np.isin(group, [0, 1]), 0.0, mass[group])
    for k in range(3):
        simulation.step()
        frame = simulation.frame()
        position, velocity, strain = (simulation.readings[name].values[k] for name in names)
        # The same numbers of the device, summed in float64 in another order; a frame's are float32 for velocities.
        np.testing.assert_allclose(position, np.average(frame.position[group], axis=0, weights=weight), rtol=1e-12)
        np.testing.assert_allclose(
            velocity, np.average(frame.velocity[group], axis=0, weights=weight), rtol=1e-6, atol=1e-12
        )
        ends = block.connections[np.isin(block.connections, group).all(axis=1)]
        length = np.linalg.norm(np.diff(frame.position[ends].astype(float), axis=1)[:, 0], axis=1)
        rest = block.rest_length[np.isin(block.connections, group).all(axis=1)]
        own = length / rest - 1
        # Rest lengths are rounded to the device's numbers: 6e-8 of 1 in float32.
        np.testing.assert_allclose(strain, [own.mean(), np.abs(own).max()], rtol=0, atol=2e-7)


EVERYTHING = {name: Probe("block", name) for name in QUANTITIES}


def test_being_measured_changes_nothing(plain_device):
    block = standing(material=Material(1000.0, 2e4, 0.1, 0.4))
    block = block.replace(velocity=np.tile([1.0, 0.0, -2.0], (27, 1)))
    how = {
        "colliders": [Plane(friction=0.3), Sphere((0.5, 0, 0), 0.2)],
        "contact": Contact(),
        "precision": "float64",
        "fps": 240.0,  # each launch of a frame is recorded: short ones are soon done
        "device": plain_device,
    }
    runs = [Simulation(block, **how), Simulation(block, probes=EVERYTHING, **how)]
    for one in runs:
        one.step(40)
    plain, probed = (one.frame().position for one in runs)
    if plain_device == "cpu":
        np.testing.assert_array_equal(probed, plain)
    else:  # scattered sums repeat to rounding only, which the motion of a soft body multiplies
        np.testing.assert_allclose(probed, plain, rtol=0, atol=1e-4)


def test_a_frame_that_is_taken_again_is_read_once(device):
    # The pace takes back frames whose steps were too long: a body thrown at the ground, squeezed hard.
    block = standing(stiffness=3000.0, damping=0.0)
    block = block.replace(velocity=np.tile([0.0, 0.0, -12.0], (27, 1)))
    probes = {"under": Probe("block", "contact force"), "it": Probe("block", "position", every="substep")}
    simulation, times = Simulation(block, colliders=[Plane()], probes=probes, device=device), []
    for k in range(20):
        simulation.step()
        times += [(k + (n + 1) / simulation.substeps) / 60 for n in range(simulation.substeps)]
    assert len(simulation.substep_history) > 1, "the pace must have refined"
    np.testing.assert_allclose(simulation.readings["it"].times, times, rtol=1e-12)
    momentum = block.mass @ (simulation.frame().velocity - block.velocity)
    impulse = simulation.readings["under"].values.sum(axis=0) / 60
    gravity = np.array([0.0, 0.0, -G]) * block.mass.sum() / 3
    # The half step by which velocities lag is another one when substeps change: (h/2) times the forces then.
    np.testing.assert_allclose(impulse, momentum - gravity, rtol=0, atol=0.02 * np.abs(impulse).max())


@pytest.mark.parametrize(
    ("probes", "message"),
    [
        ({"foot": Probe("foot", "force")}, r"probes\['foot'\].*no group|probes\['foot'\]"),
        ({"foot": Probe([99], "force")}, r"probes\['foot'\]\.on"),
        ({"foot": Probe([0], "strain")}, r"probes\['foot'\]\.on is \[0\]; for the strain"),
        (
            {"foot": Probe([0], "contact force")},
            r"probes\['foot'\]\.what is 'contact force'; there must be colliders",
        ),
        ({"foot": "force"}, r"probes\['foot'\] is 'force'; it must be a Probe"),
        ([Probe([0], "force")], r"probes is .*; it must be a mapping"),
    ],
    ids=["group", "index", "strain", "contact", "kind", "list"],
)
def test_probes_are_refused_by_name(probes, message):
    for make in (lambda: Simulation(chain(3), probes=probes), lambda: Scene(system=chain(3), probes=probes)):
        with pytest.raises(ValueError, match=message):
            make()


def test_there_is_a_list_of_what_can_be_measured():
    with pytest.raises(ValueError, match="what is 'weight'; it must be one of 'position', 'velocity'"):
        Probe("foot", "weight")
    with pytest.raises(KeyError, match="there is no probe 'foot'"):
        Simulation(chain(3), device="cpu").readings["foot"]


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_by_substep_a_particle_on_a_spring_follows_its_method(device, method):
    # x'' = −k x − b x' along the spring: the mode of the linear theory in tests/modes.py, substep by substep.
    k, b, h, substeps, frames = 100.0, 1.0, 1 / 600, 10, 3
    system = chain(2, spacing=1.0, stiffness=k, damping=b, mass=[1.0, 1.0]).pin(0)
    system = system.replace(position=system.position + np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    probes = {name: Probe([1], name, every="substep") for name in ("position", "velocity", "force")} | {
        name: Probe([0, 1], name, every="substep") for name in ("strain", "tension")
    }
    simulation = Simulation(
        system,
        gravity=0.0,
        integrator=method,
        substeps=substeps,
        probes=probes,
        precision="float64",
        device=device,
    )
    simulation.step(frames)
    times, position = simulation.readings["position"]
    names = "velocity", "force", "strain", "tension"
    velocity, force, strain, tension = (simulation.readings[name].values for name in names)
    np.testing.assert_allclose(times, h * np.arange(1, frames * substeps + 1), rtol=1e-14)
    np.testing.assert_allclose(position[:, 1:], 0.0, atol=EPS64)
    x, v = _oscillator(simulation.integrator, k, b, h, 0.1, frames * substeps)
    # The chain lies around the origin. Each substep rounds positions by EPS64, and conjugate gradients end at
    # rounding of their own.
    most = 4 * EPS64 * frames * substeps
    np.testing.assert_allclose(position[:, 0], 0.5 + x, rtol=0, atol=most)
    np.testing.assert_allclose(velocity[:, 0], v, rtol=0, atol=most / h)
    np.testing.assert_allclose(force[:, 0], -k * x - b * v, rtol=0, atol=k * most + b * most / h)
    np.testing.assert_allclose(strain, np.stack([x, np.abs(x)], axis=1), rtol=0, atol=most)
    np.testing.assert_allclose(tension[:, 0], k * x + b * v, rtol=0, atol=k * most + b * most / h)


def _oscillator(method, k, b, h, x, steps):
    """Return places and velocities at their instants behind each substep, by what the method does on paper."""
    v, found = 0.0, []
    if isinstance(method, Leapfrog):  # velocities half a substep behind; `seen` are those that dampers see
        theta, seen = method.damper_extrapolation, v
        v -= 0.5 * h * (-k * x - b * seen)
        seen = seen if theta else v
        for _ in range(steps):
            before = v
            v += h * (-k * x - b * seen)
            x += h * v
            seen = v + theta * (v - before)
            found.append((x, v + 0.5 * h * (-k * x - b * seen)))
    elif isinstance(method, SymplecticEuler):
        for _ in range(steps):
            v += h * (-k * x - b * v)
            x += h * v
            found.append((x, v))
    elif isinstance(method, LinearlyImplicitEuler):
        for _ in range(steps):
            v += h * (-k * x - b * v - h * k * v) / (1 + h * b + h * h * k)
            x += h * v
            found.append((x, v))
    else:
        matrix, state = amplification(method, h * h * k, h * b), np.array([x, 0.0])
        for _ in range(steps):
            state = matrix @ state
            found.append((state[0], state[1] / h))
    return np.array(found).T


@pytest.mark.slow
@pytest.mark.parametrize(  # methods of several stages, and with lagging velocities
    ("method", "force_algorithm"),
    [(METHODS[2], "gather"), (RK4(), "stencil")],
    ids=str,
)
def test_by_substep_and_by_frame_agree_where_frames_end(plain_device, method, force_algorithm):
    # With what depends on time, works, and moves, so that looking in between must leave all of it as it is.
    block = standing(stiffness=2000.0).pin([26])
    block = block.replace(position=block.position + np.array([0, 0, 0.02]))
    surroundings = {
        "colliders": [Plane(friction=0.4, motion=lambda t: (-0.1 * t, 0.0, 0.2 * t))],
        "loads": [
            Force(lambda t: (5.0 * np.sin(40 * t), 0.0, 0.0), on=[0, 5]),
            Force((0.0, 1.0, 0.0), on=[3]),
        ],
    }
    by = {
        every: {f"{name} {every}": Probe("block", name, every=every) for name in ALONE}
        for every in ("frame", "substep")
    }
    how = {"integrator": method, "substeps": 20, "precision": "float64", "device": plain_device} | surroundings
    how |= {"force_algorithm": force_algorithm}
    runs = [Simulation(block, probes=probes, **how) for probes in ({}, by["frame"], by["frame"] | by["substep"])]
    if (
        method == Leapfrog(damper_extrapolation=0.5)
        and plain_device.startswith("cuda")
        and runs[0].model.force_algorithm == "scatter"
    ):
        pytest.skip(
            "it extrapolates but after a contact, however light: rounding of sums without an order decides"
        )
    for one in runs:
        one.step(5)
    plain, framed, both = runs
    # Exactly so in a fixed order; else sums are made in another one: 1e-16 of forces of 1000 N, 100 times.
    most = 0 if plain_device == "cpu" else 1e-9
    for one in (framed, both):
        np.testing.assert_allclose(one.frame().position, plain.frame().position, rtol=0, atol=most)
        work, expected = one.measure().external_work, plain.measure().external_work
        assert work == pytest.approx(expected, rel=1e-12, abs=most)
    for name in ALONE:
        alone, frame = (one.readings[f"{name} frame"] for one in (framed, both))
        steps = both.readings[f"{name} substep"]
        np.testing.assert_allclose(frame.values, alone.values, rtol=0, atol=most)
        np.testing.assert_array_equal(steps.times[19::20], frame.times)
        values = steps.values[19::20]
        if name == "contact force":  # the frame's is the mean over its substeps
            values = steps.values.reshape(5, 20, 3).mean(axis=1)
        np.testing.assert_allclose(values, frame.values, rtol=1e-12, atol=1e-9)
    assert np.abs(both.readings["contact force substep"].values).max() > 0


def test_how_often_it_is_read_is_refused_by_name():
    with pytest.raises(ValueError, match="every is 'second'; it must be one of 'frame', 'substep'"):
        Probe("foot", "force", every="second")
    assert repr(Probe("foot", "force", every="substep")) == "Probe('foot', 'force', every='substep')"
