"""Division planes: sheets, ropes and grains do not go through anything, however fast."""

import numpy as np
import pytest

from benchmarks.accuracy import crossings
from msdwarp import (
    Contact,
    Force,
    Material,
    PrescribedMotion,
    Simulation,
    StartWarning,
    System,
    box,
    chain,
    sheet,
)
from msdwarp.engine.collision import division_planes, neighbor_list as nearby, skin

SPACING, THICKNESS, STIFFNESS, MASS = 0.1, 0.01, 400.0, 1e-3
SIZE = 64
"""Particles of the sheet, which grains follow."""


def held_sheet(bumps: float = 0.0) -> System:
    """Return a sheet around the origin that is held everywhere, with bumps of at most such a height [m]."""
    bed = sheet((8, 8), SPACING, mass=0.01, stiffness=STIFFNESS, damping=0.0)
    x = bed.position - bed.position.mean(axis=0)
    x[:, 2] = bumps * np.random.default_rng(1).uniform(-1, 1, SIZE)
    return bed.replace(position=x).pin(slice(None)).named("sheet")


def grains(position: np.ndarray, velocity: np.ndarray) -> System:
    """Return single particles, each a body."""
    return System(position=position, velocity=velocity, mass=MASS).named("grains")


def thrown(speed: float, device: str = "cpu", bumps: float = 0.0, sideways: float = 0.0, **options) -> Simulation:
    """Throw 36 grains down onto a held sheet, all over it, without damping and friction, and sideways too."""
    rng = np.random.default_rng(2)
    x = np.stack(np.meshgrid(*[np.linspace(-0.22, 0.22, 6)] * 2), axis=-1).reshape(-1, 2)
    x = np.column_stack([x + rng.uniform(-0.02, 0.02, x.shape), np.full(len(x), bumps + 1.5 * THICKNESS)])
    v = np.column_stack([rng.uniform(-sideways, sideways, (len(x), 2)), np.full(len(x), -speed)])
    contact = [
        Contact(thickness=THICKNESS, stiffness=STIFFNESS, restitution=1.0, friction=0.0),
        Contact(groups=("grains", "grains"), exclude=True),
    ]
    options = {"gravity": 0.0, "device": device, "precision": "float64", "fps": 240.0} | options
    return Simulation(held_sheet(bumps) + grains(x, v), contact=contact, **options)


@pytest.mark.parametrize("speed", [20.0, 200.0])
def test_grains_bounce_off_a_sheet(device, speed):
    # The slower ones go 4 mm in a substep, the others far more than the thickness of 10 mm.
    simulation = thrown(speed, device)
    for _ in range(3):
        simulation.step()
        x = simulation.frame().position[SIZE:]
        over = np.abs(x[:, :2]).max(axis=1) < 0.35
        assert x[over, 2].min() > 0
    after = np.linalg.norm(simulation.frame().velocity[SIZE:], axis=1)
    assert after.max() < speed * 1.0001
    if speed == 20.0:
        # Their restitution is 1. An impulse can come while the contact's spring is compressed. Its energy, k δ²/2
        # with δ = 10 mm or 0.02 J of 0.2 J at most, is lost to a grain that the next substep takes out of reach.
        assert simulation.frame().velocity[SIZE:, 2].min() > 0.8 * speed


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_nothing_goes_through_what_is_thrown_at_it(seed):
    pytest.importorskip("ipctk")
    found = crossings.simulate(crossings.throw(seed), "cpu")
    assert found["end"] == ""
    assert found["crossing"] == 0
    # Contact adds nothing. 2 % is for what a first-order method's energy swings by.
    assert found["energy"] < crossings.GAINED


@pytest.mark.slow
@pytest.mark.parametrize(("thickness", "speed"), [(1e-5, 20.0), (1e-6, 400.0)])
def test_thin_sheets_do_not_pass_unseen(plain_device, thickness, speed):
    # In a substep they go hundreds of times as far as the distance at which they touch, and are not flying apart.
    ipctk = pytest.importorskip("ipctk")
    low = sheet((6, 6), 0.05, mass=MASS, stiffness=20.0, damping=0.0)
    high = low.translate((0.013, 0.007, 0.3)).with_velocity((0.0, 0.0, -speed))
    options = {"contact": Contact(thickness=thickness), "gravity": 0.0, "device": plain_device}
    substeps = Simulation(low + high, **options).substeps
    simulation = Simulation(low + high, fps=240 * substeps, **options)
    oracle = crossings.Oracle(low + high, itself=False)
    places, held_back = oracle.places(simulation.system.position), 0.0
    for _ in range(16 * substeps):
        simulation.step()
        assert simulation.substeps == 1  # so that particles move on straight lines in between
        held_back, before = max(held_back, simulation.held_back), places
        places = oracle.places(simulation.frame().position.astype(float))
        assert ipctk.is_step_collision_free(oracle.mesh, before, places)
    assert held_back > 500 * thickness
    assert simulation.frame().velocity.reshape(2, -1, 3)[0, :, 2].mean() < -0.2 * speed


def crush(device: str, speed: float, bricks: int) -> Simulation:
    """Return a block that flies at light ones, whose speed of sound is 22 m/s. It is seven times as dense."""
    material = {"youngs_modulus": 2e5, "damping_ratio": 0.1}
    brick = box((3, 3, 3), 0.05, material=Material(density=400.0, **material))
    system = box((4, 4, 4), 0.05, material=Material(density=3000.0, **material))
    system = system.rotate(0.5, (1, 0.3, 0.2)).translate((-0.2, 0.0, 0.0)).with_velocity((speed, 0.0, 0.0))
    for k in range(bricks):
        system = system + brick.rotate(0.3 * k, (1, 0, 0)).translate((0.101 * k, 0.0, 0.0))
    return Simulation(system, contact=Contact(), gravity=0.0, device=device)


def check_momentum(simulation: Simulation, frames: int = 6) -> float:
    """Check that momentum is kept and no energy added; return how far particles were held back."""
    mass, velocity = simulation.system.mass, simulation.system.velocity
    momentum, energy, furthest = mass @ velocity, simulation.measure().energy, 0.0
    for _ in range(frames):
        simulation.step()
        furthest = max(furthest, simulation.held_back)
        # The total is what dampers and plastic collisions leave. By a first-order method contacts that have just
        # begun store what they take from velocities only in the next substep.
        found = simulation.measure()
        assert found.energy < energy + found.effect_energy
    # 40 to 510 kg m/s; rounding in float32 over some hundred substeps. Holding back alone takes 6 kg m/s.
    np.testing.assert_allclose(mass @ simulation.frame().velocity, momentum, atol=2.4e-5 * momentum.max())
    return furthest


# At 4 m/s impulses suffice. The last is twice as fast as sound in what it crushes.
@pytest.mark.slow
@pytest.mark.parametrize(("speed", "bricks", "held"), [(4.0, 2, False), (50.0, 4, True)])
def test_a_heavy_block_that_crushes_light_ones_keeps_its_momentum(plain_device, speed, bricks, held):
    furthest = check_momentum(crush(plain_device, speed, bricks), 3 if speed > 40 else 6)
    assert (furthest > 0.0) == held


@pytest.mark.gpu
def test_phases_that_are_separate_launches_keep_momentum_too(monkeypatch):
    monkeypatch.setattr(division_planes, "MOST_IN_CLUSTER", 16)
    assert check_momentum(crush("cuda:0", 50.0, 4), 3) > 0.0


def test_what_flies_together_is_not_held_back(plain_device):
    # Two sheets meet and fly on together, in a substep 8 mm each: farther than the gap that is left between them.
    low = sheet((8, 8), 0.05, mass=MASS, stiffness=20.0, damping=0.0)
    high = low.translate((0.013, 0.007, 0.1)).with_velocity((0.0, 0.0, -6.0))
    how = {"gravity": 0.0, "device": plain_device, "precision": "float64"}
    simulation = Simulation(low + high, contact=Contact(thickness=1e-3), **how)
    for _ in range(10):
        simulation.step()
        assert simulation.held_back == 0.0
    velocity = simulation.frame().velocity
    np.testing.assert_allclose(MASS * velocity.sum(axis=0), [0.0, 0.0, -6.0 * MASS * SIZE], atol=1e-11)
    assert velocity[:SIZE, 2].mean() < -2.5  # it has been pushed


@pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")  # the blow is that hard
@pytest.mark.parametrize("speed", [2.0, 20.0, pytest.param(200.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("pinned", [False, True])
@pytest.mark.each_value
def test_blocks_do_not_pass_through_a_slab(plain_device, speed, pinned):
    pytest.importorskip("ipctk")
    # The slab is one cell thick; the speed of sound in both is 20 m/s. The contact is much softer than springs.
    constants = {"mass": 0.01, "stiffness": 400.0, "damping": 0.02}
    slab, block = box((5, 5, 2), 0.1, **constants), box((3, 3, 3), 0.1, **constants).rotate(0.4, axis=(1, 1, 0.3))
    slab, block = (one.translate(tuple(-one.position.mean(axis=0))) for one in (slab, block))
    slab = slab.pin(slice(None)) if pinned else slab
    system = slab + block.translate((0.01, 0.02, -0.4)).with_velocity((0.0, 0.0, speed))
    how = {"gravity": 0.0, "device": plain_device, "precision": "float64"}
    simulation = Simulation(system, contact=Contact(stiffness=50.0), **how)
    energy, oracle = simulation.measure().energy, crossings.Oracle(system)
    for _ in range(12):
        simulation.step()
        assert not oracle.crosses(simulation.frame().position)
    assert simulation.measure().energy < energy
    if not pinned and speed <= 20.0:
        momentum = 0.01 * simulation.frame().velocity.sum(axis=0)
        np.testing.assert_allclose(momentum, [0.0, 0.0, 0.27 * speed], atol=1e-10)


@pytest.mark.slow
def test_what_crosses_at_the_start_is_left_out_until_it_is_apart():
    cloth = sheet((4, 4), 0.1, mass=0.01, stiffness=400.0, damping=0.5)
    cloth = cloth.translate(tuple(-cloth.position.mean(axis=0)))
    across = cloth.rotate(np.pi / 2, axis=(1, 0, 0)).translate((0.013, 0.017, 0.12))
    with pytest.warns(StartWarning, match="starts"):
        simulation = Simulation(cloth + across, contact=Contact(), gravity=0.0, device="cpu")
    planes = simulation.assembly.body_contact.planes
    assert planes.tangles
    assert planes.pairs.tangled.numpy().any()
    simulation.change(velocity=(0, 0, 0))
    simulation.step(60)


@pytest.mark.slow
def test_what_goes_around_the_border_is_let_go(device):
    # It slides off the sheet, whose border is at 0.35 m, and falls.
    grain = grains(np.array([[0.33, 0.02, THICKNESS]]), np.array([[1.0, 0.0, 0.0]]))
    contact = Contact(thickness=THICKNESS, stiffness=STIFFNESS, restitution=0.2, friction=0.0)
    simulation = Simulation(held_sheet() + grain, contact=contact, device=device, fps=240.0)
    simulation.step(48)
    x, v = (values[SIZE] for values in simulation.frame()[1:])
    falling = 0.2 - (0.35 - 0.33) / 1.0
    assert v[0] == pytest.approx(1.0, abs=0.1)  # less or more by the way around the edge
    assert v[2] == pytest.approx(-9.82 * falling, rel=0.15)
    assert x[2] < -0.1


@pytest.mark.slow
def test_lists_and_overflow_change_nothing(device, monkeypatch):
    def run() -> np.ndarray:
        simulation = thrown(20.0, device, bumps=0.03, sideways=1.0, precision="float32")
        simulation.step(4)
        return np.concatenate(simulation.frame()[1:])

    expected = run()
    for module, name, value in ((skin, "LEAST_SKIN", 1.5), (nearby, "ROOM", 1), (division_planes, "ROOM", 0)):
        monkeypatch.setattr(module, name, value)
        np.testing.assert_array_equal(run(), expected)


def test_a_grain_lies_on_a_sheet_that_hangs():
    cloth = sheet((6, 6), 0.05, mass=0.01, stiffness=300.0, damping=0.3).pin([0, 5, 30, 35])
    cloth = cloth.translate(-cloth.position.mean(axis=0))
    simulation = Simulation(
        cloth + grains(np.array([[0.03, 0.02, 0.03]]), np.zeros((1, 3))),
        contact=Contact(thickness=THICKNESS, stiffness=STIFFNESS),
        device="cpu",
        precision="float64",
    )
    # 25 grains fit where the cloth has a particle: with 32 contacts each, some ten times what springs take.
    assert simulation.substeps < 1000
    simulation.step(120)
    x = simulation.frame().position
    middle = x[:36].reshape(6, 6, 3)[2:4, 2:4, 2]
    assert middle.min() < x[-1, 2] < middle.max() + 2 * THICKNESS


@pytest.mark.slow
def test_a_driven_end_that_meets_a_wall_of_cloth_is_held_back_and_told():
    # It is moved by 0.3 m within a frame, through a sheet that is held everywhere.
    moved = chain(3, 0.05, mass=0.01, stiffness=400.0).rotate(np.pi / 2, axis=(1, 0, 0))
    moved = moved.translate(tuple(np.array([0.01, 0.02, 0.15]) - moved.position.mean(axis=0)))
    down = PrescribedMotion(slice(SIZE, None), lambda t: [0.0, 0.0, -0.3 * np.minimum(np.asarray(t) * 60, 1)])
    how = {"contact": Contact(thickness=THICKNESS), "gravity": 0.0, "device": "cpu"}
    simulation = Simulation(held_sheet() + moved, loads=[down], **how)
    simulation.step()
    assert simulation.held_back > 0.1
    thrown_apart = thrown(1.0)
    thrown_apart.step()
    assert thrown_apart.held_back == 0.0
    simulation.step(3)
    assert simulation.frame().position[SIZE:, 2].min() > 0


@pytest.mark.filterwarnings("ignore::msdwarp.checks.StepWarning")  # one substep is too long on purpose
@pytest.mark.parametrize("driven", [False, True], ids=["pushed", "driven"])
def test_what_starts_within_a_substep_goes_through_nothing(driven):
    # From rest, so that no speed foretells it: 4000 N move a particle of 0.02 kg by 0.2 m in the first substep.
    constants = {"mass": 0.02, "stiffness": 2e3, "damping": 0.5}
    wall = box((5, 5, 2), 0.1, **constants).pin(slice(None))
    die = box((2, 2, 2), 0.05, **constants).translate((0.02, 0.01, 0.105))
    on = np.arange(50, 58)
    if driven:
        load = PrescribedMotion(on=on, motion=lambda t: (0.0, 0.0, -300.0 * min(0.01, max(0.0, t - 0.0305))))
    else:
        load = Force(lambda t: (0.0, 0.0, -4000.0 if 0.0305 < t < 0.0405 else 0.0), on=on)
    how = {"gravity": 0.0, "precision": "float64", "device": "cpu", "fps": 1000.0, "substeps": 1}
    simulation = Simulation(wall + die, contact=Contact(), loads=[load], **how)
    heights = [frame.position[on, 2].mean() for frame in simulation.frames(0.06)]
    assert min(heights) > 0.0  # where the middle of the wall is
