"""The gradient of each world of an ensemble is that of a simulation of this world alone."""

import math
from typing import Any

import numpy as np
import pytest
from differences import FRAMES, GRAVITY, NAMES, SOFT, block, loss, soft_floor

import msdwarp as msd
from msdwarp import RK4, Ensemble, Frames, Gradient, Leapfrog, Material, Plane, Scene, SymplecticEuler, System
from msdwarp.simulation import gradient_run

# Worlds whose springs differ keep the cells of the scene, as they are warned.
pytestmark = pytest.mark.filterwarnings("ignore:.* is that of springs:msdwarp.checks.StartWarning")

WORLDS = 3
BLOCK = block()
BOUNCE: dict[str, Any] = {"colliders": [Plane((0.1, 0, 1), -0.1, **SOFT), msd.Sphere((0, 0, -0.4), 0.33, **SOFT)]}


def losses(frames: Frames) -> tuple[Any, Any, Any]:
    """Return the loss of each world, and their derivatives."""
    each = [loss(Frames(frames.time, x, v)) for x, v in zip(frames.position, frames.velocity, strict=True)]
    value, by_position, by_velocity = (np.stack(parts) for parts in zip(*each, strict=True))
    return value, by_position, by_velocity


def soft_case() -> tuple[Scene, dict[str, Any]]:
    """Return a pinned block with cells and a ball in a skin, in the wind and full of gas, and a rod with angles.

    All of them are strained.
    """
    rod = msd.rod(5, 0.1, radius=0.01, material=Material(200.0, 1e5, 0.2)).translate((0.0, 0.5, 0.0))
    block = msd.box((3, 3, 3), 0.07, material=RUBBER).named("block").pin([0, 1])
    ball = msd.ball(0.1, 0.07, material=RUBBER).named("ball").translate((0.0, 1.0, 0.0))
    body = block + ball + rod
    noise = np.random.default_rng(0).normal(size=(2, body.particle_count, 3))
    noise[1, [0, 1]] = 0.0
    body = body.replace(position=body.position + 0.004 * noise[0], velocity=0.1 * noise[1])
    loads = [msd.Wind((2.0, 0.5, 3.0), drag=1.2, lift=0.7)]
    loads += [msd.EnclosedGas(60.0, on=name, outside=500.0, volume=0.004) for name in ("block", "ball")]
    own = {"damping": factors(1) * body.damping, "mass": factors(1) * body.mass, "integrator": SymplecticEuler()}
    return Scene(system=body, gravity=GRAVITY, loads=loads), own


def factors(*shape: int) -> np.ndarray:
    """Return random numbers about 1 for each world."""
    return np.random.default_rng(3).uniform(0.8, 1.2, (WORLDS, *shape))


RUBBER = Material(20.0, 1e3, 0.2, 0.4)
LOADS = [
    msd.Actuator(lambda t: 0.1 * math.sin(40 * t)),
    msd.Force(lambda t: (1.0, 40 * t, 0.0), on=[4, 7]),
    msd.Force(soft_floor),
    msd.Wind((3.0, 1.0, -2.0), area=0.01),
    msd.Attachment([5, 9], (0.1, 0.0, 0.3), stiffness=40.0, damping=0.3, rest_length=0.2),
    msd.PrescribedMotion([30, 35], lambda t: (0.02 * math.sin(30 * t), 0.1 * t, 0.0)),
]
CASES: dict[str, tuple[Scene, dict[str, Any]]] = {
    "parameters": (
        Scene(system=BLOCK),
        {
            "stiffness": factors(1) * BLOCK.stiffness,
            "damping": factors(BLOCK.connection_count) * BLOCK.damping,
            "rest_length": factors(1)[:1] * BLOCK.rest_length,
            "mass": factors(BLOCK.particle_count) * BLOCK.mass,
            "position": BLOCK.position + 0.001 * factors(BLOCK.particle_count, 3),
            "gravity": factors(1) * GRAVITY,
            "integrator": Leapfrog(),
        },
    ),
    "a method of several stages": (
        Scene(system=BLOCK, gravity=GRAVITY),
        {"stiffness": factors(1) * BLOCK.stiffness, "mass": factors(1) * BLOCK.mass, "integrator": RK4()}
        | {"precision": "float32"},
    ),
    "loads and soft obstacles": (
        Scene(system=BLOCK, loads=LOADS, gravity=GRAVITY, **BOUNCE),
        {
            "stiffness": factors(1) * BLOCK.stiffness,
            "velocity": factors(1, 1) * BLOCK.velocity,
            "strain": lambda t: 0.1 * np.sin(40 * factors() * t),
            "integrator": SymplecticEuler(),
        },
    ),
    "surfaces, skins, cells and angles": soft_case(),
}
NUMBERS = ["strain", "loads[1].force", "loads[3].velocity", "loads[4].to", "loads[5].motion"]
NUMBERS += ["colliders[0].friction", "colliders[1].position"]
EACH = [
    one if one in ("parameters", "a method of several stages") else pytest.param(one, marks=pytest.mark.slow)
    for one in CASES
]


def ensemble_of(case: str, device: str = "cpu", **more) -> Ensemble:
    scene, options = CASES[case]
    how = {"precision": "float64", "substeps": 12, "device": device}
    return Ensemble(scene, WORLDS, **(how | options | more))


@pytest.mark.slow
@pytest.mark.parametrize("case", EACH)
def test_each_world_has_the_gradient_of_its_run(case, plain_device):
    names, ensemble, frames = [*NAMES, "force"], ensemble_of(case, plain_device), 3
    alone = [ensemble.simulation_of(world) for world in range(WORLDS)]
    if case.startswith("surfaces"):
        names += ["loads[0].drag", "loads[1].volume", "loads[2].volume"]
    if case.startswith("loads"):  # from the third frame on
        names += NUMBERS
        for run in (ensemble, *alone):
            run.step(2)
    found = ensemble.gradient(losses, frames, by=names)
    assert found.value.shape == (WORLDS,)
    assert found.growth.shape == (WORLDS, frames + 1)
    for world, run in enumerate(alone):
        single = run.gradient(loss, frames, by=names)
        for name in ("value", "growth", *names):
            of_all, of_one = (one[name] if name in names else getattr(one, name) for one in (found, single))
            # The same sums in the same order on a CPU, except that gravity is taken from the mass's at the end.
            exact = plain_device == "cpu" and not (name == "mass" and case == "parameters")
            # On a GPU they are in another order: 1e-16 or 6e-8 in each of some hundred stages, and what grows of
            # it.
            rounding = 1e-10 if ensemble.model.dtype == np.float64 else 1e-4
            tolerance = 0.0 if exact else rounding * np.abs(of_one).max()
            np.testing.assert_allclose(of_all[world], of_one, rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.slow
def test_states_that_do_not_fit_are_taken_again_to_the_last_bit(monkeypatch, plain_device):
    names = [*NAMES, "force"] + (["strain"] if plain_device == "cpu" else [])  # a GPU sums strains in any order
    ensemble = ensemble_of("loads and soft obstacles", plain_device, substeps=13)  # an odd number swaps arrays
    ensemble.step(1)
    for run, told in ((ensemble, losses), (ensemble.simulation_of(1), loss)):
        found = []
        for share, of_substeps in ((1.0, 1.0), (1.0, 0.0), (0.0, 0.0)):
            monkeypatch.setattr(gradient_run, "MOST_MEMORY", share)
            monkeypatch.setattr(gradient_run, "MOST_FOR_SUBSTEPS", of_substeps)
            found.append(run.gradient(told, 10, by=names))  # the last has 11 states: 4, 4 and 3
        for one in found[1:]:
            for name in names:
                np.testing.assert_array_equal(one[name], found[0][name], err_msg=name)


@pytest.mark.slow
def test_the_gradient_of_a_world_that_diverges_is_nan_and_others_do_not_notice(plain_device):
    how = {"allow_unstable": True, "stiffness": np.array([1.0, 1e5, 1.2])[:, None] * BLOCK.stiffness}
    ensemble = ensemble_of("loads and soft obstacles", plain_device, **how)
    for frames in (FRAMES, 2):  # it diverges meanwhile, and before
        names = ("position", "stiffness", *NUMBERS)
        found = ensemble.gradient(losses, frames, by=names)
        assert np.isnan(found.frames.position[1, -1]).all()
        for values in (found.value, found.growth, *found.derivatives.values()):
            assert np.isnan(values[1]).all()
            assert np.isfinite(values[[0, 2]]).all()
        single = ensemble.simulation_of(2)
        if ensemble.frame_index:
            single.step(ensemble.frame_index)
        alone = single.gradient(loss, frames, by=names)["stiffness"]
        np.testing.assert_allclose(found["stiffness"][2], alone, rtol=0, atol=1e-10 * np.abs(alone).max())
        ensemble.step(FRAMES)


def test_bodies_with_strains_of_their_own_have_the_derivatives_of_each_alone(plain_device):
    def run(body: System, loads: list[msd.Actuator]) -> Gradient:
        how = {"integrator": Leapfrog(), "precision": "float64", "substeps": 12, "device": plain_device}
        return msd.Simulation(body, loads=loads, **how).gradient(end, FRAMES, by=("strain",))

    def end(frames: Frames) -> tuple[float, np.ndarray, None]:
        by_x = np.zeros(frames.position.shape)
        by_x[-1] = frames.position[-1]
        return 0.5 * (by_x**2).sum(), by_x, None

    strains = {"one": lambda t: 0.1 * math.sin(40 * t), "two": lambda t: 0.05 * math.cos(30 * t)}
    bodies = BLOCK.named("one") + BLOCK.named("two")
    found = run(bodies, [msd.Actuator(strain, on=name) for name, strain in strains.items()])["strain"]
    for column, strain in zip(found.T, strains.values(), strict=True):
        alone = run(BLOCK, [msd.Actuator(strain)])["strain"][:, 0]
        # The same sums in the same order on a CPU; by atomics on a GPU.
        tolerance = 0.0 if plain_device == "cpu" else 1e-10 * np.abs(alone).max()
        np.testing.assert_allclose(column, alone, rtol=0, atol=tolerance)


def test_a_chaotic_motion_warns_and_its_world_is_named(plain_device):
    # A chain of three links that stands on its end, and turns over and over; the other hangs at rest.
    links = np.array([[0.0, 0, 0], [0.0, 0, 0.1], [0.02, 0, 0.2], [0.05, 0.01, 0.29]])
    chain = System(position=links, connections=[[0, 1], [1, 2], [2, 3]], stiffness=2000.0, mass=0.05).pin([0])
    hanging = np.array([[0.0, 0, 0], [0.0, 0, -0.1], [0.0, 0, -0.2], [0.0, 0, -0.3]])
    ensemble = Ensemble(chain, 2, position=[hanging, links], precision="float64", device=plain_device)

    def place(frames: Frames) -> tuple[np.ndarray, np.ndarray, None]:
        by_x = np.zeros(frames.position.shape)
        by_x[..., -1, 3, :] = 1.0
        return frames.position[..., -1, 3, :].sum(axis=-1), by_x, None

    for run, said in ((ensemble, "the gradient of world 1 is"), (ensemble.simulation_of(1), "chaotic")):
        with pytest.warns(msd.GradientWarning, match=said):
            found = run.gradient(place, 600, by=("position",))
    assert found.growth[0] > 1e3 * found.growth[-2]


def test_what_an_ensemble_cannot_differentiate_is_refused_by_name():
    def refused(message: str, loss: Any = losses, by: tuple[str, ...] = ("position",), **options) -> None:
        with pytest.raises(ValueError, match=message):
            Ensemble(BLOCK.translate((0, 0, 1)), 2, device="cpu", **options).gradient(loss, 2, by=by)

    refused("the scene has obstacles without a stiffness", colliders=[Plane()])
    refused("contact between bodies", contact=msd.Contact())
    refused("integrator is Leapfrog", integrator=Leapfrog(damper_extrapolation=0.5))
    refused("there must be an Actuator", by=("strain",))
    refused(r"loads\[0\].strain has 2 numbers", loads=[msd.Actuator(lambda t: (0.1, 0.2))])
    refused(
        r"value of shape \(\); it must be of shape \(2,\), a number for each world", lambda f: (0.0, None, None)
    )
    refused("∂/∂velocity of the loss has shape", lambda f: (np.zeros(2), None, np.zeros((2, 36, 3))))
