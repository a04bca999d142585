"""Each world of an ensemble moves as it does alone, whatever the others do."""

import numpy as np
import pytest
from alone import assert_each_is_as_alone, one_lane, simulation_alone

import msdwarp as msd
from msdwarp.simulation import substep_chooser

WORLDS = 6
MUSCLE = {"loads": [msd.Actuator(0.1)]}
METHODS = {
    "extrapolated": msd.Leapfrog(damper_extrapolation=0.5),
    "explicit": msd.ExplicitEuler(),
    "rk4": msd.RK4(),
}


def block(n: int = 3):
    """Return a small block that falls onto the ground and turns."""
    body = msd.box((n, n, n), 0.1, stiffness=1e3, damping=1.0).translate((0.0, 0.0, 0.15))
    spin = np.cross([3.0, 2.0, 1.0], body.position - body.position.mean(axis=0))
    return body.replace(velocity=spin)


def parameters(seed: int = 1) -> dict[str, np.ndarray]:
    """Return parameters of all kinds, of which some serve several worlds."""
    draw = np.random.default_rng(seed).uniform
    return {
        "stiffness": draw(500, 2000, WORLDS),
        "damping": draw(0.0, 2.0, WORLDS // 2),
        "mass": draw(0.5, 2.0, WORLDS),
        "gravity": draw(5.0, 12.0, (2, 3)),
        "friction": draw(0.0, 1.0, WORLDS),
        "velocity": draw(-1.0, 1.0, (WORLDS, 3)),
    }


def in_order(device: str, force_algorithm: str) -> None:
    """Skip an algorithm whose sums have no order."""
    if force_algorithm == "scatter" and device != "cpu":
        pytest.skip("on a GPU atomics settle who adds first: nothing repeats to the last bit")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force_algorithm", "method", "precision", "threads"),
    [
        # test_worlds_and_effects.py has each method with some loads, in float32.
        ("stencil", "rk4", "float64", "auto"),
        ("gather", "extrapolated", "float32-compensated", "auto"),
        ("scatter", "explicit", "float32", None),
    ],
)
def test_worlds_move_as_alone(plain_device, force_algorithm, method, precision, threads):
    in_order(plain_device, force_algorithm)
    how = {
        "integrator": METHODS[method],
        "precision": precision,
        "force_algorithm": force_algorithm,
        "threads": threads,
    }
    # Explicit Euler is stable with much damping only, and with short steps.
    own = parameters() | (
        {"damping": np.full(2, 2.0), "stiffness": np.full(3, 300.0)} if method == "explicit" else {}
    )
    how |= {"substeps": 5, "fps": 300.0, "colliders": [msd.Plane()], "device": plain_device}
    assert_each_is_as_alone(msd.Ensemble(block(), WORLDS, **how, **own), 60)


def random(*choices: float) -> np.ndarray:
    """Return a stiffness of each connection of a block in each of three worlds."""
    draw, shape = np.random.default_rng(2), (3, block().connection_count)
    return draw.choice(choices, shape) if choices else draw.uniform(500, 2e3, shape)


def differing(system, **surroundings) -> tuple:
    """Return a body and what it has in worlds of other stiffness and gravity."""
    stiffness = np.linspace(0.5, 1.5, WORLDS)[:, None] * system.stiffness
    own = {"stiffness": stiffness, "gravity": np.linspace(5.0, 15.0, 3), "substeps": 40}
    return system, own | surroundings


RESTING, OTHER = block().replace(velocity=0.0), msd.box((2, 4, 3), 0.1, stiffness=2e3)
ROPE = msd.chain(10, 0.1, stiffness=1e3, damping=1.0, dim=2).pin(0)
CLOTH = msd.sheet((7, 7), 0.1, stiffness=300.0, damping=0.5)
SHIFTS, PINNED = np.linspace(0, 1, 6)[:, None, None], np.array([5, 40, 26])[:, None]
CASES = {
    "each connection its own": ("scatter", RESTING, {"stiffness": random()}),
    "few kinds": ("gather", RESTING, {"stiffness": random(700.0, 1500.0)}),
    "scaled": ("scatter", RESTING, {"rest_length": np.linspace(0.9, 1.1, 6)[:, None] * RESTING.rest_length}),
    "alike but for the start": ("gather", RESTING, {"position": RESTING.position + SHIFTS}),
    "nothing": ("stencil", RESTING, {}),
    "pinned in some": ("gather", RESTING, {"mass": np.where(np.arange(27) == PINNED, np.inf, 0.7)}),
    "a flat rope": ("gather", *differing(ROPE, colliders=[msd.Plane(offset=-9.0)])),
    "a cloth": ("scatter", *differing(CLOTH.translate((0.0, 0.0, 0.6)).pin([0, 6]))),
    "two blocks": ("stencil", *differing(block() + OTHER.translate((1.0, 0.0, 0.5)))),
    "other dampers": ("gather", *differing(block().replace(damper=msd.QuadraticDamper()))),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_parameters_and_bodies_of_any_shape(plain_device, case):
    force_algorithm, system, own = CASES[case]
    in_order(plain_device, force_algorithm)
    how = {"colliders": [msd.Plane()], "substeps": 20, "device": plain_device, "force_algorithm": force_algorithm}
    assert_each_is_as_alone(msd.Ensemble(system, WORLDS, **(how | own)), 15)


def test_a_scene_brings_its_surroundings(plain_device):
    scene = msd.Scene(system=block(), colliders=[msd.Plane(friction=0.3)], gravity=3.0)
    ensemble = msd.Ensemble(scene, 2, device=plain_device, force_algorithm="gather", damping=[0.5, 1.5])
    assert_each_is_as_alone(ensemble, 30)
    ensemble.reset()
    assert ensemble.time == 0.0
    assert_each_is_as_alone(ensemble, 10)


@pytest.mark.slow
def test_a_world_that_diverges_leaves_the_others_as_they_were(plain_device):
    # One world is so stiff that its step is far too long; another has a start that is beyond all numbers.
    stiffness = np.full(WORLDS, 1e3)
    stiffness[2] = 1e7
    velocity = np.random.default_rng(3).uniform(-1, 1, (WORLDS, 3))
    how = {
        "device": plain_device,
        "force_algorithm": "gather",
        "substeps": 15,
        "allow_unstable": True,
        "colliders": [msd.Plane()],
    }
    sound = msd.Ensemble(block(), WORLDS, **how, velocity=velocity, stiffness=[1e3])
    ensemble = msd.Ensemble(block(), WORLDS, **how, velocity=velocity, stiffness=stiffness)
    for one in (sound, ensemble):
        one.step(20)
    assert (sound.status == "running").all()
    assert ensemble.status[2] in ("not finite", "energy")
    others = np.arange(WORLDS) != 2
    assert (ensemble.status[others] == "running").all()
    assert np.isnan(ensemble.diverged_at[others]).all()
    assert 0 <= ensemble.diverged_at[2] < ensemble.time
    for a, b in zip(sound.frame()[1:], ensemble.frame()[1:], strict=True):
        np.testing.assert_array_equal(a[others], b[others])
        assert np.isfinite(b[2]).all()
    # It stays where its last good frame ended, and says of itself what a simulation says.
    alone = ensemble.simulation_of(2)
    if ensemble.diverged_at[2] > 0:
        alone.step(round(60 * ensemble.diverged_at[2]))
    np.testing.assert_array_equal(alone.frame().position, ensemble.frame().position[2])
    assert "world 2" in str(ensemble.diagnose(2))
    with pytest.raises(ValueError, match="world 1 has not diverged"):
        ensemble.diagnose(1)


@pytest.mark.slow
def test_worlds_go_on_from_checkpoints_and_after_a_reset(plain_device):
    # A reset brings back what has yielded, and the work done.
    system = block().replace(yield_strain=0.002, relaxation_time=0.02)
    how = {
        "colliders": [msd.Plane()],
        "loads": [msd.Force(lambda t: (np.sin(9 * t), 0.0, 0.5))],
        "device": plain_device,
    }
    how |= {"integrator": METHODS["extrapolated"], "precision": "float32-compensated"}
    own = {"stiffness": [700.0, 900.0, 1100.0], "gravity": [5.0, 9.0, 12.0]}
    ensemble = msd.Ensemble(system, 3, fps=240, force_algorithm="gather", **how, **own)
    ensemble.step(30)
    reached = ensemble.checkpoints()
    ensemble.step(20)
    for world in range(3):
        alone = simulation_alone(ensemble, world)
        with one_lane():
            alone.restore(*reached[world])
        alone.step(20)
        assert alone.time == ensemble.time
        np.testing.assert_array_equal(alone.frame().position, ensemble.frame().position[world])
        np.testing.assert_array_equal(alone.rest_length, ensemble.system_of(world).rest_length)
    ensemble.reset()
    assert (ensemble.system_of(1).rest_length == system.rest_length.astype(np.float32)).all()
    ensemble.step(30)
    for one, other in zip(reached, ensemble.checkpoints(), strict=True):
        assert one[1].keys() == other[1].keys()
        for name, value in one[1].items():
            # On a GPU the iteration that finds the rates adds up in no order.
            summed = name.startswith("rates.") or name in ("limit", "least")
            assert other[1][name] == (pytest.approx(value, rel=1e-12) if summed else value), name
        for name, values in one[0].items():
            np.testing.assert_array_equal(values, other[0][name], err_msg=name)


def test_substeps_are_those_of_the_world_that_needs_most(plain_device):
    stiffness, mass = np.array([1e3, 9e3, 9e3]), np.array([1.0, 100.0, 2.0])
    ensemble = msd.Ensemble(
        block(), 3, stiffness=stiffness, mass=mass, device=plain_device, force_algorithm="gather"
    )
    alone = [ensemble.simulation_of(world, substeps="auto", allow_unstable=False) for world in range(3)]
    assert ensemble.substeps == max(one.substeps for one in alone) == alone[2].substeps
    # On a GPU the iteration that finds it adds up in no order.
    assert ensemble.choice.rates.stiffness == pytest.approx(alone[2].choice.rates.stiffness, rel=1e-12)
    with pytest.raises(msd.UnstableStep, match="in world 2 substeps is 2"):
        msd.Ensemble(block(), 3, stiffness=stiffness, mass=mass, substeps=2, device="cpu")


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ({"worlds": 0}, "worlds is 0"),
        ({"stiffness": [1.0, 2.0, 3.0, 4.0]}, "stiffness has 4 rows; that must divide the number of worlds, 6"),
        (
            {"stiffness": np.ones((6, 3))},
            r"stiffness has shape \(6, 3\); it must be of shape \[rows\] or \[rows, 158\]",
        ),
        ({"stiffness": [1.0, -2.0]}, r"stiffness.* -2.*at least 0"),
        ({"rest_length": [1.0, np.nan]}, "rest_length.*nan.*finite"),
        ({"gravity": [0.0, 0.0, -9.82]}, "gravity.*-9.82.*at least 0"),
        ({"velocity": np.zeros(3)}, r"velocity has shape \(3,\)"),
        ({"friction": [0.1, 0.2]}, "friction is given; there must be colliders"),
        ({"strain": [0.1]}, "strain is given; there must be an Actuator among the loads"),
        (MUSCLE | {"strain": np.zeros((6, 2))}, r"strain has shape \(6, 2\); it must be of shape .*\[rows, 1\]"),
        (
            MUSCLE | {"strain": lambda t: np.zeros(4)},
            "strain has 4 rows; that must divide the number of worlds, 6",
        ),
        (MUSCLE | {"strain": lambda t: np.ones(6)}, "strain is 1 at 0 s; it must be above -1 and below 1"),
        (MUSCLE | {"strain": lambda t: 1 / 0}, "strain has no value at 0 s: ZeroDivisionError: division by zero"),
        (MUSCLE | {"delay": np.zeros((6, 2))}, r"delay has shape \(6, 2\); it must be of shape .*\[rows, 1, 27\]"),
        (MUSCLE | {"delay": [0.0, np.inf]}, "delay.*inf.*finite"),
        (MUSCLE | {"delay": [0.0], "strain": [0.1]}, "delay is given beside strain"),
        ({"integrator": msd.LinearlyImplicitEuler()}, "integrator is Linearly.*explicit"),
        ({"threads": 3}, "threads is 3"),
        (
            {"loads": [msd.Attachment([0], stiffness=1.0)], "position": np.tile(block().position, (2, 1, 1))},
            r"position differs between worlds, and loads\[0\]",
        ),
        (
            {"contact": msd.Contact(surface_colliders=True), "colliders": [msd.Box((0, 0, -9))]},
            "contact has surface_colliders=True",
        ),
        (
            {"scene": block().replace(break_strain=0.1), "stiffness": [1.0, 2.0], "force_algorithm": "stencil"},
            "force_algorithm is 'stencil', and the system can tear",
        ),
        (
            {"scene": msd.Scene(system=block(), contact=msd.Contact()), "contact": msd.Contact()},
            "contact is given beside a Scene",
        ),
        (
            {"scene": msd.Scene(system=block()), "loads": [msd.Force((0, 0, 1))]},
            "loads are given beside a Scene.*the same for all worlds",
        ),
        ({"scene": msd.Scene(system=block(), schedule=[msd.at(1.0, gravity=0.0)])}, "the scene has a schedule"),
        ({"scene": 3}, "scene is 3"),
        (
            {"colliders": [msd.Plane(offset=0.3)], "position": block().position[None] + np.zeros((2, 1, 1))},
            "starts 0.25 m inside an obstacle",
        ),
    ],
)
def test_what_worlds_cannot_be_is_said(own, said, monkeypatch):
    monkeypatch.setattr(substep_chooser, "world_rates", None)  # before the first kernels of a step are compiled
    given = {"scene": block(), "worlds": WORLDS, "device": "cpu"} | own
    with pytest.raises(ValueError, match=said):
        msd.Ensemble(given.pop("scene"), given.pop("worlds"), **given)


def test_gravity_of_worlds_takes_the_place_of_a_function_of_time(plain_device):
    rope = msd.Scene(system=msd.chain(2), gravity=lambda t: 9.0)
    ensemble = msd.Ensemble(rope, 2, gravity=[5.0, 0.0], precision="float64", substeps=100, device=plain_device)
    before = ensemble.frame().position[:, 0, 2]
    ensemble.step(6)
    # After t = 0.1 s by steps of h it has fallen by g t (t + h)/2; 600 sums are rounded to 600 times 1e-16.
    fallen = 0.5 * 5.0 * 0.1 * (0.1 + 1 / 6000)
    np.testing.assert_allclose(before - ensemble.frame().position[:, 0, 2], [fallen, 0.0], rtol=0, atol=1e-13)


def test_springs_scaled_without_their_cells_are_told():
    block = msd.box((2, 2, 2), 0.1, material=msd.JELLY)
    both = block + msd.chain(3, 0.1, stiffness=50.0, damping=0.1).translate((0, 0, 1))
    rope = np.arange(both.connection_count) >= block.connection_count
    for own in ({"stiffness": np.outer([1, 2], both.stiffness)}, {"stiffness": 500.0}, {"damping": [0.1, 0.2]}):
        with pytest.warns(
            msd.StartWarning, match=f"{next(iter(own))} is that of springs; the (modulus|damping) of"
        ):
            msd.Ensemble(both, 2, device="cpu", **own)
    # Nothing is told of a rope beside, nor of springs without cells.
    msd.Ensemble(both, 2, device="cpu", stiffness=both.stiffness * np.where(rope, [[1], [2]], 1))
    msd.Ensemble(block.replace(cells=None), 2, device="cpu", stiffness=[1e3, 2e3])


def test_worlds_by_number():
    with pytest.raises(ValueError, match="stiffness differs among the connections of a direction"):
        msd.Ensemble(RESTING, WORLDS, stiffness=random(), force_algorithm="stencil", device="cpu")
    ensemble = msd.Ensemble(block(), 4, stiffness=[1e3, 2e3], device="cpu")
    assert (ensemble.system_of(3).stiffness == 2e3).all()
    assert (ensemble.system_of(2, start=True).position == block().position).all()
    for wrong in (4, -1, 1.5):
        with pytest.raises(ValueError, match="world is"):
            ensemble.system_of(wrong)


def test_a_start_serves_every_second_world():
    starts, speeds = block().position + np.array([0.0, 1.0])[:, None, None], [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    ensemble = msd.Ensemble(block(), 4, position=starts, velocity=speeds, device="cpu", precision="float64")
    _, position, velocity = ensemble.frame()
    for world in range(4):
        assert (position[world] == starts[world % 2]).all()
        assert (velocity[world] == speeds[world % 2]).all()


@pytest.mark.slow
def test_a_world_whose_energy_grows_is_told_from_one_that_is_not_finite(plain_device):
    # Four substeps are stable for the first stiffness. For the other the fastest modes are beyond the limit by so
    # little that energy is noticed long before numbers overflow.
    how = {
        "device": plain_device,
        "force_algorithm": "gather",
        "substeps": 4,
        "allow_unstable": True,
        "damping": 0.0,
    }
    ensemble = msd.Ensemble(block(), 2, stiffness=[1e4, 2.5e4], **how)
    for _ in range(20):
        ensemble.step(10)
        if ensemble.status[1] != "running":
            break
    assert list(ensemble.status) == ["running", "energy"]
    assert ensemble.diverged_particle[1] == -1
    assert np.abs(ensemble.frame().position).max() < 1e6
    error = ensemble.diagnose(1)
    assert error.time > ensemble.diverged_at[1] > 0.0
