"""Worlds whose state stays in the shared memory of a GPU: they move as they do in the memory of the device."""

import numpy as np
import pytest

from msdwarp import RK4, RKC2, Ensemble, Leapfrog, Plane, SymplecticEuler, box, chain, sheet

WORLDS = 5
BODIES = {
    "die": (box((3, 3, 3), 0.1, stiffness=1e3, damping=1.0).translate((0, 0, 0.15)), "stencil", 32),
    # A thread for each column of particles, in layers of 81: the last column has one particle only.
    "block": (box((9, 9, 9), 0.1, stiffness=1e3, damping=1.0).translate((0, 0, 0.15)), "stencil", 512),
    "two lattices": (
        box((3, 3, 3), 0.1, damping=1.0) + box((2, 2, 5), 0.1, damping=1.0).translate((1, 0, 0)),
        "stencil",
        64,
    ),
    "mesh": (box((4, 3, 3), 0.1, stiffness=1e3, damping=1.0).translate((0, 0, 0.15)), "gather", 64),
    "flat rope": (chain(40, 0.1, stiffness=1e3, damping=1.0, dim=2).translate((0, 0.3)), "gather", 64),
}
METHODS = [SymplecticEuler(), Leapfrog(damper_extrapolation=0.5), RK4(), RKC2()]


def chip_of(ensemble: Ensemble):
    return ensemble.stepping.stepper.chip


def ensemble_of(name: str, device: str, **how) -> Ensemble:
    body, force_algorithm, _ = BODIES[name]
    random = np.random.default_rng(3)
    own = {
        "stiffness": random.uniform(500, 1500, WORLDS),
        "velocity": random.uniform(-1, 1, (WORLDS, body.dim)),
        "gravity": random.uniform(5, 12, WORLDS),
    }
    return Ensemble(
        body, WORLDS, colliders=[Plane()], device=device, force_algorithm=force_algorithm, **(own | how)
    )


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("name", BODIES)
def test_worlds_on_the_chip_move_as_in_the_memory_of_the_device(name, method, precision):
    # With an odd number of substeps what is written last lies where the next frame does not begin.
    how = {"integrator": method, "precision": precision, "fps": 300.0, "substeps": 5}
    threads = BODIES[name][2]
    on_chip, in_memory = (ensemble_of(name, "cuda:0", threads=one, **how) for one in ("auto", threads))
    if (precision, method) == ("float32", METHODS[0]):
        assert chip_of(on_chip).threads == threads
        assert chip_of(on_chip).in_columns == (name == "block")
    for one in (on_chip, in_memory):
        one.step(60)
    for field in ("position", "velocity"):
        assert np.array_equal(getattr(on_chip.frame(), field), getattr(in_memory.frame(), field))


@pytest.mark.gpu
def test_a_world_that_diverges_on_the_chip_is_frozen_and_the_others_go_on():
    how = {"fps": 300.0, "substeps": 5, "allow_unstable": True}
    stiffness = np.array([800.0, 1e7, 900.0, 1000.0, 1100.0])
    whole = ensemble_of("die", "cuda:0", stiffness=stiffness, **how)
    sound = ensemble_of("die", "cuda:0", stiffness=np.where(stiffness > 1e6, 850.0, stiffness), **how)
    assert chip_of(whole) is not None
    for one in (whole, sound):
        one.step(60)
    assert (whole.status == "running").tolist() == [True, False, True, True, True]
    others = stiffness < 1e6
    assert np.array_equal(whole.frame().position[others], sound.frame().position[others])


@pytest.mark.gpu
@pytest.mark.parametrize("body", [box((12, 12, 12), 0.1), sheet((31, 31), 0.1)], ids=["block", "cloth"])
def test_large_worlds_are_not_on_the_chip(body):
    ensemble = Ensemble(body, 3, stiffness=np.array([900.0, 1000.0, 1100.0]), device="cuda:0")
    assert chip_of(ensemble) is None
    ensemble.step(2)


def test_a_cpu_has_no_such_memory():
    assert chip_of(ensemble_of("die", "cpu")) is None
