"""Bodies touch in each world of an ensemble as they do alone, whatever happens in the others."""

import numpy as np
import pytest
from alone import assert_each_is_as_alone, simulation_alone

from msdwarp import (
    RK4,
    RKC2,
    Contact,
    Ensemble,
    Leapfrog,
    Plane,
    SymplecticEuler,
    System,
    UnstableStep,
    box,
    chain,
    sheet,
)

WORLDS = 4
FPS = 600
"""Frames are short, for each launch of a frame is recorded, which on a CPU takes longer than the launch itself."""
TOUCH = Contact(friction=0.5, restitution=0.3)
LIFTED = np.repeat([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 27, axis=0)
"""Upwards for the particles of the upper die."""
METHODS = {"symplectic": SymplecticEuler(), "extrapolated": Leapfrog(damper_extrapolation=0.5), "rk4": RK4()}


def two_dice() -> System:
    """Return a die that falls onto another one."""
    die = box((3, 3, 3), 0.1, mass=0.02, stiffness=2e4, damping=8.0)
    upper = die.rotate(0.3).translate((0.02, 0.0, 0.345)).with_velocity((0.0, 0.0, -1.0))
    return die.translate((0.0, 0.0, 0.12)) + upper


def around(device: str, **more) -> dict:
    return {
        "colliders": [Plane(friction=0.4)],
        "contact": TOUCH,
        "device": device,
        "force_algorithm": "gather",
        "fps": FPS,
    } | more


def parameters(worlds: int = WORLDS) -> dict[str, np.ndarray]:
    """Return parameters of all kinds, of which some serve several worlds; lengths of contacts differ too."""
    draw = np.random.default_rng(1).uniform
    system = two_dice()
    return {
        "stiffness": draw(1e4, 3e4, worlds),
        "damping": draw(2.0, 8.0, worlds // 2),
        "rest_length": np.array([[1.0], [1.01]]) * system.rest_length,
        "mass": draw(0.01, 0.03, worlds),
        "friction": draw(0.0, 1.0, 1),
        "velocity": draw(-0.5, 0.5, (worlds, system.particle_count, 3)) * 0.1 + system.velocity,
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force_algorithm", "method", "precision"),
    [
        ("gather", "symplectic", "float32"),
        ("stencil", "symplectic", "float32"),
        ("gather", "extrapolated", "float64"),
        ("scatter", "rk4", "float32"),
    ],
)
def test_worlds_touch_as_alone(plain_device, force_algorithm, method, precision):
    if force_algorithm == "scatter" and plain_device != "cpu":
        pytest.skip("on a GPU atomics settle who adds first: nothing repeats to the last bit")
    how = around(plain_device, integrator=METHODS[method], precision=precision, force_algorithm=force_algorithm)
    worlds, frames = (WORLDS, 100) if method == "symplectic" else (2, 40)
    ensemble = Ensemble(two_dice(), worlds, **how, **parameters(worlds))
    # They meet in the fifteenth frame.
    assert_each_is_as_alone(ensemble, frames)
    if method == "symplectic":  # what falls freely for that long ends in the lower one
        assert (ensemble.frame().position[:, 27:, 2].mean(axis=1) > 0.25).all()
        ensemble.reset()  # what sticks is forgotten
        assert_each_is_as_alone(ensemble, 40)


def hammock() -> System:
    """Return a cloth that is held by two edges, on which a ball of rope falls."""
    cloth = sheet((6, 6), 0.1, mass=0.01, stiffness=200.0, damping=0.3).pin([0, 5, 30, 35])
    rope = chain(6, 0.08, mass=0.01, stiffness=200.0, damping=0.3).translate((0.02, 0.03, 0.06))
    return cloth + rope


@pytest.mark.slow
def test_worlds_of_sheets_and_ropes(plain_device):
    how = around(plain_device, colliders=[], contact=Contact(friction=0.5, self_contact=True))
    ensemble = Ensemble(hammock(), 3, **how, gravity=[5.0, 10.0, 15.0])
    assert_each_is_as_alone(ensemble, 200)


@pytest.mark.slow
def test_a_world_that_diverges_leaves_the_others_as_they_were(plain_device):
    # One world is so stiff that its step is far too long: its bodies fly apart, through each other and away.
    stiffness, velocity = np.full(WORLDS, 2e4), np.random.default_rng(3).uniform(-0.5, 0.5, (WORLDS, 3))
    stiffness[1] = 1e7
    how = around(plain_device, substeps=13, allow_unstable=True)
    sound = Ensemble(two_dice(), WORLDS, **how, velocity=velocity, stiffness=[2e4])
    ensemble = Ensemble(two_dice(), WORLDS, **how, velocity=velocity, stiffness=stiffness)
    for one in (sound, ensemble):
        one.step(120)
    assert (sound.status == "running").all()
    assert ensemble.status[1] in ("not finite", "energy")
    others = np.arange(WORLDS) != 1
    assert (ensemble.status[others] == "running").all()
    for a, b in zip(sound.frame()[1:], ensemble.frame()[1:], strict=True):
        np.testing.assert_array_equal(a[others], b[others])
        assert np.isfinite(b[1]).all()


def sliding(device):
    """Return worlds where a die slides on another one: friction holds by springs that are stretched."""
    system = two_dice().with_velocity(np.repeat([[0.0, 0.0, 0.0], [1.0, 0.0, -1.0]], 27, axis=0))
    ensemble = Ensemble(system, 2, **around(device))
    ensemble.step(16)
    return ensemble


@pytest.mark.slow
def test_the_simulation_of_a_world_on_its_way_may_have_other_options(plain_device):
    ensemble = sliding(plain_device)
    for options in ({"precision": "float64"}, {"contact": (), "loads": ()}, {"substeps": "auto"}):
        other = ensemble.simulation_of(0, start=False, **options)
        now = other.frame().position
        np.testing.assert_allclose(now, ensemble.frame().position[0], rtol=0, atol=1e-7)  # rounding of 0.4 m
        other.step()


@pytest.mark.slow
def test_the_simulation_of_a_world_on_its_way_knows_what_sticks(plain_device):
    ensemble = sliding(plain_device)
    assert ensemble.assembly.body_contact is not None
    contact_body = ensemble.assembly.body_contact.checkpoints()[1]["touch.partner"]
    assert (contact_body >= 0).any(), "nothing sticks: the test is of nothing"
    alone = simulation_alone(ensemble, 1, start=False)
    for _ in range(3):
        ensemble.step()
        alone.step()
    # Its contact mesh is laid a quarter of the spacing inwards from where the particles are now, not at the start.
    strain, inset = alone.measure().largest_strain, 0.25 * 0.1
    assert 0.0 < strain < 0.01
    found, expected = alone.frame().position, ensemble.frame().position[1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=strain * inset)


@pytest.mark.slow
def test_lists_that_are_too_short_are_made_longer_and_the_frame_repeated(plain_device, monkeypatch):
    from msdwarp.engine.collision import neighbor_list as nearby

    system = two_dice()
    system = system.replace(position=system.position + 0.2 * LIFTED)
    velocity = np.array([-3.0, -4.0])[:, None, None] * LIFTED
    long_enough = Ensemble(system, 2, **around(plain_device), velocity=velocity)
    monkeypatch.setattr(nearby, "ROOM", 1)
    short = Ensemble(system, 2, **around(plain_device), velocity=velocity)
    # At the start no facet is near any point; what comes near while they fall is too much for the lists.
    assert short.assembly.body_contact.neighbors.data.candidates.shape[1] < 4
    for one in (long_enough, short):
        one.step(100)
    assert short.assembly.body_contact.neighbors.data.candidates.shape[1] >= 8
    np.testing.assert_array_equal(short.frame().position, long_enough.frame().position)


@pytest.mark.slow
def test_worlds_do_not_see_each_other():
    """A search looks at the bodies of one world alone: none is beside those of the others in the same place."""
    ensemble = Ensemble(two_dice(), 64, **around("cpu"))
    ensemble.step(20)
    data = ensemble.assembly.body_contact.neighbors.data
    body_pairs, count = data.body_pairs.numpy(), data.body_pair_count.numpy()
    assert count.max() == 1
    for body in np.flatnonzero(count):
        assert body_pairs[body, 0] == body ^ 1  # of each pair of bodies the other one


def test_substeps_count_contact(plain_device):
    how = around(plain_device, fps=60)
    ensemble = Ensemble(two_dice(), 2, **how, stiffness=[2e4, 1e4], mass=[0.02, 0.03])
    needs_most = []
    for world in range(2):
        alone = ensemble.simulation_of(world, substeps="auto", allow_unstable=False)
        assert ensemble.substeps >= alone.substeps
        if ensemble.choice.substeps == alone.substeps:
            # Rates of worlds are summed in another order: to a few units of float64 of some hundred summands.
            rates, own = alone.choice.rates, ensemble.choice.rates
            assert own.stiffness == pytest.approx(rates.stiffness, rel=1e-12)
            assert own.damping == pytest.approx(rates.damping, rel=1e-12)
            needs_most.append(world)
    assert needs_most == [0]
    with pytest.raises(UnstableStep, match="in world 0 substeps is 3"):
        Ensemble(two_dice(), 2, **how, substeps=3)


def test_worlds_in_which_bodies_come_near_by_their_inner_surfaces_equal_single_runs():
    fast = np.zeros((2, 54, 3))
    fast[1, 27:, 2] = -80.0
    ensemble = Ensemble(two_dice(), 2, **around("cpu"), velocity=fast)
    alone = ensemble.simulation_of(1)
    for _ in range(3):
        ensemble.step()
        alone.step()
        np.testing.assert_array_equal(ensemble.frame().position[1], alone.frame().position)
    assert alone.assembly.body_contact.planes.awake


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ({"integrator": RKC2(stages=4)}, "where bodies touch it must be another"),
        ({"threads": 1}, "threads is 1; it must be 'auto' or None where bodies touch"),
        (
            {"contact": Contact(surface_colliders=True)},
            "contact has surface_colliders=True, which worlds of an ensemble cannot have yet",
        ),
        (
            {"position": two_dice().position - np.array([0.0, 0.1])[:, None, None] * LIFTED},
            "in world 1 the body of particle",
        ),
    ],
)
def test_what_cannot_be_is_said(own, said):
    given = {"scene": two_dice(), **around("cpu", colliders=[])} | own
    with pytest.raises(ValueError, match=said):
        Ensemble(given.pop("scene"), 2, **given)


@pytest.mark.slow
def test_energies_hold_what_contacts_store(plain_device):
    pytest.importorskip("xarray")
    ensemble = Ensemble(two_dice(), 2, **around(plain_device), gravity=[5.0, 9.82], precision="float64")
    observed = ensemble.run(0.2, observe={"energy": "energy"}, every=10)
    for world in range(2):
        alone, in_contact = ensemble.simulation_of(world), 0
        for k in range(12):
            alone.step(10)
            measures = alone.measure()
            stored = measures.kinetic_energy + measures.elastic_energy + measures.gravitational_energy
            in_contact += measures.effect_energy > 0  # they bounce
            # Sums of 54 particles and 316 springs in another order. On a GPU states differ by rounding too, and
            # impacts make that larger.
            assert observed.energy[world, k - 12] == pytest.approx(stored + measures.effect_energy, rel=1e-9)
        assert in_contact
