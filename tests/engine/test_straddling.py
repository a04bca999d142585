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


# --- What is conserved ---


@pytest.mark.slow
@pytest.mark.parametrize("method", [Leapfrog(), RK4()], ids=str)
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


# --- Where there is any ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("colliders", "contact", "expected"),
    [
        ([FAR], Contact(surface_colliders=True), False),
        ([FAR, Sphere((0, 0, -3))], Contact(surface_colliders=True), True),
        ([Sphere((0, 0, -3))], Contact(), False),
    ],
    ids=["planes", "a ball", "not asked for"],
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
