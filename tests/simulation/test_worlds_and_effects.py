"""Each world of an ensemble moves as it does alone, to the last bit, with each load and each obstacle."""

import numpy as np
import pytest
import warp as wp
from alone import assert_each_is_as_alone, simulation_alone

import msdwarp as msd

# Worlds whose springs differ keep the cells of the scene, as they are warned.
pytestmark = pytest.mark.filterwarnings("ignore:.* is that of springs:msdwarp.checks.StartWarning")

WORLDS = 4
BLOCK = msd.box((3, 3, 3), 0.1, stiffness=1e3, damping=1.0).translate((0.0, 0.0, 0.25))
BLOCKS = BLOCK + BLOCK.translate((1.0, 0.0, 0.0)) + BLOCK.translate((2.0, 0.0, 0.0))
CLOTH = msd.sheet((4, 4), 0.1, stiffness=1e3, damping=1.0, mass=0.01).translate((0.0, 0.0, 0.3))
SKIN = msd.ball(0.2, 0.1, stiffness=1e3, damping=1.0)
SOFT = msd.Material(density=100.0, youngs_modulus=1e4, damping_ratio=0.1, poissons_ratio=0.4)
RUBBER = msd.box((3, 3, 3), 0.1, material=SOFT).translate((1.0, 0.0, 0.15))


@wp.func
def swirl(x: wp.vec3f, v: wp.vec3f, t: float, i: int) -> wp.vec3f:
    return wp.vec3f(-x[1], x[0], wp.sin(t)) - 0.1 * v


def swing(t):
    return np.stack([0.1 * np.sin(3 * t), 0 * t, 0.05 * np.sin(5 * t)], axis=-1)


def gait(t):
    return 0.1 * np.sin(np.arange(6.0, 6.0 + WORLDS) * t)


def lifted(t):
    return (0.0, 0.0, 0.1 * t)


# Effects that act side by side share kernels, which take longer to compile than to run: to the last bit, a world
# is as a run alone only if each of them is.
SCENES = {
    "loads": (
        BLOCK,
        {
            "loads": [
                msd.Force((0.3, 0.0, 0.5)),
                msd.Force(lambda t: np.array([np.sin(9 * t), 0.0, 0.2]), on=[9, 14]),
                msd.Force(swirl),
                msd.Wind(lambda t: np.array([3.0, np.sin(t), 0.0]), area=0.01, on=[3, 4, 5]),
                msd.Attachment([6, 8], stiffness=50.0, damping=0.5),
                msd.Attachment(
                    [18, 20], stiffness=50.0, damping=0.5, carried_by=msd.Plane(offset=-9.0, motion=lifted)
                ),
                msd.PrescribedMotion([0, 1, 2], swing),
                msd.Actuator(lambda t: 0.1 * np.sin(9 * t)),
            ],
            "gravity": lambda t: 9.82 + np.sin(20 * t),
        },
    ),
    "surfaces": (SKIN, {"loads": [msd.Wind((3.0, 1.0, -2.0)), msd.Pressure(50.0), msd.EnclosedGas(200.0)]}),
    "a sheet that tears in the wind": (
        CLOTH.pin([0, 3]).replace(break_strain=0.001),
        {"loads": [msd.Wind((3.0, 1.0, -2.0))]},
    ),
    "cells, and what yields": (
        BLOCK.replace(yield_strain=0.002, relaxation_time=0.02) + RUBBER,
        {"colliders": [msd.Plane(friction=0.4, stiffness=300.0, dissipation=0.5)]},
    ),
    "solids, some of which move": (
        BLOCKS,
        {
            "colliders": [
                msd.Sphere((0.0, 0.0, -0.4), 0.5),
                msd.Box((1.0, 0.0, -0.1), (0.4, 0.4, 0.2), motion=lifted),
                msd.Capsule((1.9, 0.1, 0.0), (2.4, 0.1, 0.0), 0.1, motion=lifted),
                msd.Cone((2.1, 0.0, 0.1), (2.1, 0.0, -0.6), 30.0),
                msd.Plane(friction=0.4, motion=lifted),
            ]
        },
    ),
}
METHODS = [
    msd.Leapfrog(),
    msd.Leapfrog(damper_extrapolation=0.5),
    msd.ExplicitEuler(),
    msd.RK4(),
    msd.RKC2(stages=4),
]


def assert_worlds_equal_runs(name: str, method, device: str, **more) -> msd.Ensemble:
    """Compare worlds of other stiffness, damping, mass and gravity with single runs."""
    system, options = SCENES[name]
    draw = np.random.default_rng(3).uniform
    differ = {"stiffness": draw(500, 1500, WORLDS), "damping": draw(0.5, 2.0, WORLDS // 2)}
    differ |= {"mass": draw(0.5, 2.0, (WORLDS, 1)) * system.mass}
    if name == "loads":
        differ |= {"strain": gait}
    if "gravity" not in options:
        differ |= {"gravity": draw(5.0, 12.0, 2)}
    how = {"device": device, "integrator": method, "force_algorithm": "gather"} | options | more
    ensemble = msd.Ensemble(system, WORLDS, **how, **differ)
    assert_each_is_as_alone(ensemble)
    work = ensemble.assembly.external_work
    if work is not None:  # which energies are judged by
        alone = simulation_alone(ensemble, WORLDS - 1)
        alone.step(ensemble.frame_index)
        done = work.totals(ensemble.state.x, ensemble.state.v)[WORLDS - 1]
        assert done == pytest.approx(alone.measure().external_work, rel=1e-9)  # another order of sums, on a GPU
    return ensemble


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_worlds_equal_single_runs_with_each_load_and_obstacle(plain_device, name):
    ensemble = assert_worlds_equal_runs(name, msd.SymplecticEuler(), plain_device)
    if name.startswith("a sheet"):
        assert all(ensemble.system_of(world).broken.any() for world in range(WORLDS))
    if name.endswith("yields"):
        given = SCENES[name][0].rest_length
        for world in range(WORLDS):  # by more than float32 rounds them
            assert np.abs(ensemble.system_of(world).rest_length / given - 1).max() > 1e-5
    if name.startswith("solids"):  # falling freely for a third of a second, all were below them
        heights = ensemble.frame().position[:, :, 2].reshape(WORLDS, 3, -1).mean(axis=-1)
        assert (heights > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "method"), [*zip(SCENES, METHODS, strict=True)], ids=str)
def test_worlds_equal_single_runs_by_each_method(name, method):
    # What a load or an obstacle does depends on no method: all of them by one other method each.
    assert_worlds_equal_runs(name, method, "cpu", fps=240, force_algorithm=("scatter", "gather")[len(name) % 2])
