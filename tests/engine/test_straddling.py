"""Obstacles that come in between the particles of bodies that touch: what they bear, and what is conserved."""

import math

import numpy as np
import pytest

from msdwarp import (
    RK4,
    Box,
    Capsule,
    Contact,
    Leapfrog,
    Plane,
    Simulation,
    Sphere,
    SymplecticEuler,
    System,
    ball,
    box,
    chain,
    sheet,
)
from msdwarp.checks import StartWarning
from msdwarp.engine.collision.surface_contact import SurfaceContact

G = 9.82
SPACING = 0.1
FAR = Plane(offset=-9.0)
AWAY = [Box((0, 0, -99)), Capsule((0, 0, -99), (1, 0, -99), 0.1), Sphere((0, 0, -99))]
"""Far off: scenes with the same kinds of obstacles share kernels."""
FPS = 240
"""Frames are short, for each launch of a frame is recorded, which on a CPU takes longer than the launch itself."""


def block(nx: int = 4, ny: int = 4, nz: int = 4, **constants) -> System:
    """Return a block of even numbers of particles: its middle is between them. It stands on z = 0."""
    own = box((nx, ny, nz), SPACING, **({"mass": 0.02, "stiffness": 2e4, "damping": 8.0} | constants))
    return own.translate((0, 0, -own.position[:, 2].min()))


def post(width: float, **options) -> Box:
    """Return an upright box whose top is at z = 0."""
    return Box((0, 0, -0.5), (width, width, 1.0), **({"restitution": 0.2} | options))


def straddles(simulation: Simulation) -> bool:
    return any(isinstance(effect, SurfaceContact) for effect in simulation.assembly.all)


def lowest(simulation: Simulation) -> float:
    return float(simulation.frame().position[:, 2].min())


# --- What is borne ---


@pytest.mark.slow
@pytest.mark.parametrize(("width", "high"), [(0.04, 2), (0.08, 4)])
def test_a_body_rests_on_a_post_thinner_than_its_spacing(device, width, high):
    # What is higher and bounces need not stay upright on so thin a post.
    body = block(nz=high).translate((0, 0, 0.05))
    simulation = Simulation(
        body, colliders=[post(width), *AWAY], contact=Contact(surface_colliders=True), fps=FPS, device=device
    )
    simulation.step(480)
    # Within 5 % of the spacing of where the post is drawn.
    assert lowest(simulation) > -0.05 * SPACING
    # A ten-thousandth of what it fell with: it rests.
    assert simulation.measure().kinetic_energy < 1e-4 * body.mass.sum() * G * 0.05


@pytest.mark.slow
def test_without_touch_it_goes_down_on_both_sides(plain_device):
    simulation = Simulation(block(), colliders=[post(0.08), *AWAY], fps=FPS, device=plain_device)
    simulation.step(80)
    assert not straddles(simulation)
    # Nothing is met on the way: free fall, whose sum over substeps is first order in the step.
    assert lowest(simulation) == pytest.approx(-0.5 * G / 9, rel=0.02)


@pytest.mark.slow
def test_edges_are_borne_by_edges(plain_device):
    # Rails of a square profile, an edge upwards, cross the edges of a bar half way between its particles.
    side = 0.08
    rails = [
        Box((x, 0, -side / math.sqrt(2)), (side, 1.0, side), turn=(0, math.pi / 4, 0), restitution=0.2)
        for x in (-0.2, 0.2)
    ]
    bar = block(8, 2, 2).translate((0, 0, 0.002))
    simulation = Simulation(
        bar, colliders=[*rails, *AWAY], contact=Contact(surface_colliders=True), fps=FPS, device=plain_device
    )
    simulation.step(360)
    assert lowest(simulation) > -0.05 * SPACING
    assert simulation.measure().kinetic_energy < 1e-4 * 32 * 0.02 * G * 0.05


@pytest.mark.slow
def test_what_is_thin_hangs_over_a_thin_rod(plain_device):
    # The rod is met by links and triangles alone: the particles are 50 mm off on either side of it.
    rod = Capsule((0, -2, 0), (0, 2, 0), 0.015, restitution=0.0, friction=0.8)
    rope = chain(12, SPACING, mass=0.01, stiffness=500.0, damping=0.5)
    cloth = sheet((12, 5), SPACING, mass=0.002, stiffness=150.0, damping=0.2)
    rope, cloth = (
        one.translate(-one.position.mean(axis=0)).translate((0, y, 0.03)) for one, y in ((rope, -1), (cloth, 1))
    )
    simulation = Simulation(
        rope + cloth, colliders=[rod, *AWAY], contact=Contact(surface_colliders=True), fps=FPS, device=plain_device
    )
    simulation.step(240)
    for x in np.split(simulation.frame().position, [12]):
        assert np.abs(x[:, 0].mean()) < SPACING  # it has slid to neither side
        assert x[:, 2].max() > 0.0
        assert x[:, 2].min() < -0.3  # its ends hang


@pytest.mark.slow
def test_a_cloth_lets_less_of_a_ball_be_seen(plain_device):
    # Straight edges between particles on the ball cut into it, by s²/8R = 1.25 mm in one without strain.
    cloth = sheet((17, 17), 0.05, mass=0.002, stiffness=150.0, damping=0.2)
    cloth = cloth.translate(-cloth.position.mean(axis=0)).translate((0.01, 0.013, 0.26))
    ball, deep = Sphere((0, 0, 0), 0.25, restitution=0.0), {}
    for contact in (None, Contact(surface_colliders=True)):
        how = {"contact": contact, "fps": FPS, "device": plain_device}
        simulation = Simulation(cloth, colliders=[ball, *AWAY], **how)
        simulation.step(160)
        x = simulation.frame().position
        assert cloth.surface is not None
        corners = x[cloth.surface.particle[cloth.surface.triangles]]
        middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
        deep[contact is not None] = 0.25 - np.linalg.norm(middles, axis=1).min()
    assert deep[True] < 0.6 * deep[False]  # seen 1.1 and 2.7 mm
    assert deep[True] < 0.05 * 0.05  # 5 % of the spacing


@pytest.mark.slow
def test_friction_holds_on_a_gentle_slope(plain_device):
    # tan 15° = 0.27 < 0.5. The block is low, so that it does not tip over the edge of the post.
    angle = math.radians(15)
    falls = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    floor = post(0.09, friction=0.5)
    contact = Contact(surface_colliders=True)
    options = {"contact": contact, "gravity": falls, "fps": FPS, "device": plain_device}
    simulation = Simulation(block(4, 4, 2), colliders=[floor, *AWAY], **options)
    simulation.step(240)
    before = simulation.frame().position[:, 0].mean()
    simulation.step(120)
    assert abs(simulation.frame().position[:, 0].mean() - before) / 0.5 < 1e-4  # [m/s], as between bodies


# --- What is conserved ---


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), Leapfrog(), RK4()], ids=str)
def test_the_obstacle_takes_what_the_body_loses(plain_device, method):
    thrown = block().translate((0, 0, 0.01)).replace(velocity=(0.1, 0.0, -1.0))
    options = {
        "gravity": 0.0,
        "contact": Contact(surface_colliders=True),
        "device": plain_device,
        "precision": "float64",
    }
    options |= {"fps": FPS}
    simulation = Simulation(thrown, colliders=[post(0.08)], integrator=method, contact_forces=True, **options)
    taken = np.zeros(3)
    for _ in range(36):
        simulation.step()
        taken += simulation.contact_force().sum(axis=0) / FPS
    gained = 0.02 * (simulation.frame().velocity - thrown.velocity).sum(axis=0)
    assert np.abs(gained).max() > 0.5  # it has been thrown back
    assert simulation.measure().effect_energy == 0.0
    # Forces are whole numbers of 2^-40 of the largest, cut off for each particle in some hundred substeps.
    np.testing.assert_allclose(taken, gained, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_undamped_it_keeps_its_energy(plain_device):
    smooth = {"restitution": 1.0, "friction": 0.0}
    options = {
        "gravity": 0.0,
        "contact": Contact(**smooth, surface_colliders=True),
        "device": plain_device,
        "precision": "float64",
        "fps": FPS,
    }
    thrown = block(damping=0.0).translate((0, 0, 0.01)).replace(velocity=(0.0, 0.0, -1.0))
    worst = []
    for substeps in (15, 60):
        options["integrator"] = Leapfrog()
        simulation = Simulation(thrown, colliders=[post(0.08, **smooth)], substeps=substeps, **options)
        energies, stored = [simulation.measure().energy], 0.0
        for _ in range(36):
            simulation.step()
            measures = simulation.measure()
            energies.append(measures.energy)
            stored = max(stored, measures.effect_energy)
        assert stored > 0.01 * energies[0]  # the post has had its share
        worst.append(np.abs(np.array(energies) / energies[0] - 1).max())
    assert worst[0] < 0.01
    # Irregularly: forces have kinks where contacts begin and end. See test_touching.
    assert worst[1] < worst[0] / 1.5


@pytest.mark.slow
def test_an_obstacle_that_moves_does_work(plain_device):
    # Undamped, on a post that rises by 0.1 m in 1 s, smoothly: what the body has is what the post has done.
    lift = post(0.08, restitution=1.0, friction=0.0, motion=lambda t: (0, 0, 0.05 * (1 - math.cos(math.pi * t))))
    contact = Contact(restitution=1.0, friction=0.0, surface_colliders=True)
    options = {
        "contact": contact,
        "device": plain_device,
        "precision": "float64",
        "integrator": Leapfrog(),
        "fps": FPS,
    }
    simulation = Simulation(block(damping=0.0), colliders=[lift], substeps=60, **options)
    start = simulation.measure()
    simulation.step(240)
    end = simulation.measure()
    lifted = 64 * 0.02 * G * 0.1
    done = end.external_work - start.external_work
    assert done == pytest.approx(lifted, rel=0.1)  # the rest is what it vibrates with
    # Work is known to first order in the step: seen 0.1 %.
    assert end.energy - start.energy == pytest.approx(done, abs=0.01 * lifted)


@pytest.mark.slow
def test_a_restart_in_contact_goes_on_to_the_last_bit(device):
    def begun() -> Simulation:
        body = block().translate((0, 0, 0.001)).replace(velocity=(0.2, 0.0, -0.5))
        return Simulation(
            body, colliders=[post(0.04)], contact=Contact(surface_colliders=True), fps=FPS, device=device
        )

    whole, again = begun(), begun()
    if device.startswith("cuda") and whole.model.force_algorithm == "scatter":
        pytest.skip("scattered sums on the GPU are not repeatable")
    whole.step(4)
    kept = whole.checkpoint()
    assert (kept[0]["straddle.partner"] >= 0).any()
    again.restore(*kept)
    for one in (whole, again):
        one.step(16)
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(getattr(whole.frame(), name), getattr(again.frame(), name))


# --- Where there is any ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("colliders", "contact", "expected"),
    [
        ([FAR], Contact(surface_colliders=True), False),
        ([FAR, Sphere((0, 0, -3))], Contact(surface_colliders=True), True),
        ([Sphere((0, 0, -3))], Contact(), False),
        ([Sphere((0, 0, -3))], None, False),
    ],
    ids=["planes", "a ball", "not asked for", "no touch"],
)
def test_only_solids_come_between(colliders, contact, expected):
    simulation = Simulation(block(), colliders=colliders, contact=contact, device="cpu")
    assert straddles(simulation) is expected


def test_planes_count_where_a_surface_is_outside_of_its_particles():
    simulation = Simulation(
        ball(0.15, 0.05), colliders=[Plane(offset=-1)], contact=Contact(surface_colliders=True), device="cpu"
    )
    assert straddles(simulation)
    assert simulation.assembly.colliders.spared.all()


def test_single_particles_have_nothing_between_them():
    heap = System(position=[[0, 0, 0], [1, 0, 0]], connections=np.zeros((0, 2), int))
    contact = Contact(thickness=0.1, stiffness=1e3, surface_colliders=True)
    assert not straddles(Simulation(heap, colliders=[Sphere((0, 0, -3))], contact=contact, device="cpu"))


@pytest.mark.slow
def test_what_starts_on_an_obstacle_is_led_off_it(plain_device):
    # 20 mm deep; put out at once it would leap by 0.5 k δ² by the mass, some metres.
    low = block().translate((0, 0, -0.02))
    options = {"contact": Contact(surface_colliders=True), "fps": FPS, "device": plain_device}
    with pytest.warns(StartWarning, match=r"an obstacle reaches 0\.02 m into the surface at particle"):
        simulation = Simulation(low, colliders=[post(0.08)], **options)
    highest = -1.0
    for _ in range(360):
        simulation.step()
        highest = max(highest, lowest(simulation))
    assert lowest(simulation) > -0.05 * SPACING
    assert highest < 0.02
