"""Simulations as functions of JAX: its own check of gradients, and what is told of wrong values."""

import gc

import numpy as np
import pytest
from differences import CHAIN, ROWS

from msdwarp import Ensemble, Leapfrog, Simulation, simulate_jax

jax = pytest.importorskip("jax")
test_util = pytest.importorskip("jax.test_util")
NAMES = ("position", "velocity", "stiffness", "damping", "rest_length", "mass")
HOW = {"integrator": Leapfrog(), "precision": "float64", "substeps": 4}
CHECK = {"order": 1, "modes": ["rev"], "eps": 1e-5, "atol": 1e-6, "rtol": 1e-5}
"""Its differences are over 1e-5 of the arguments, so they are right to some 1e-9 of the largest derivatives."""


@pytest.fixture(autouse=True)
def float64():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.mark.parametrize("compiled", [False, True])
def test_gradients_pass_the_check_of_jax(compiled, plain_device):
    arrays = [jax.numpy.array(getattr(CHAIN, name)) for name in NAMES] + [jax.numpy.array([0.1, 0.0, -9.8])]

    def run(*given):
        named = dict(zip((*NAMES, "gravity"), given, strict=True))
        return simulate_jax(CHAIN, 2, **named, **HOW, device=plain_device)

    test_util.check_grads(jax.jit(run) if compiled else run, arrays, **CHECK)


@pytest.mark.slow
def test_gradients_of_worlds_pass_the_check_of_jax(plain_device):
    def run(*given):
        named = dict(zip(ROWS, given, strict=True))
        return simulate_jax(CHAIN, 2, worlds=4, **named, **HOW, device=plain_device)

    test_util.check_grads(run, list(map(jax.numpy.array, ROWS.values())), **CHECK)


@pytest.mark.parametrize("worlds", [None, 4])
def test_frames_are_those_of_the_run(worlds, plain_device):
    how = ROWS if worlds else {"mass": np.array(0.5)}
    position, velocity = simulate_jax(CHAIN, 3, worlds=worlds, **how, **HOW, device=plain_device)
    run = Ensemble(CHAIN, 4, **ROWS, **HOW, device=plain_device)
    if worlds is None:
        run = Simulation(CHAIN.replace(mass=0.5), **HOW, device=plain_device)
    run.step(3)
    np.testing.assert_array_equal(position[..., -1, :, :], run.frame().position)
    np.testing.assert_array_equal(velocity[..., -1, :, :], run.frame().velocity)


def end(stiffness, **others):
    return simulate_jax(CHAIN, 4, stiffness=stiffness, **others, **HOW, device="cpu")[0][-1].sum()


def test_numbers_of_python_are_values_too():
    one = jax.numpy.array(60.0)
    assert end(60.0) == end(60) == end(one)
    assert end([60.0, 60.0], gravity=9.82, damping=np.array(0.2)) == end(one)
    assert jax.grad(end)(60.0) == jax.grad(end)(one)


def test_one_value_for_all_has_the_sum_of_derivatives():
    one, each = (jax.grad(end)(value) for value in (jax.numpy.array(60.0), jax.numpy.full(2, 60.0)))
    assert one.shape == ()
    assert float(one) == pytest.approx(float(each.sum()), rel=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_mapped_values_are_worlds(compiled):
    # The worlds of an ensemble sum in the same order as a run alone, on the CPU to the last bit.
    def end(stiffness, mass):
        return (simulate_jax(CHAIN, 4, stiffness=stiffness, mass=mass, **HOW, device="cpu")[0][-1] ** 2).sum()

    step = jax.value_and_grad(end, (0, 1))
    stiffness, mass = CHAIN.stiffness * np.array([[0.8], [1.2]]), jax.numpy.array([0.3, 0.5])
    over_mass = jax.vmap(jax.jit(step) if compiled else step, (None, 0))
    value, found = jax.vmap(over_mass, (0, None))(jax.numpy.array(stiffness), mass)
    assert [one.shape for one in found] == [(2, 2, 2), (2, 2)]
    for k, row in enumerate(stiffness):
        for w in range(2):
            alone, wanted = step(jax.numpy.array(row), mass[w])
            assert value[k, w] == pytest.approx(float(alone), rel=1e-14)
            for one, other in zip(found, wanted, strict=True):  # rounding of 16 substeps
                np.testing.assert_allclose(one[k, w], other, rtol=0, atol=1e-13 * np.abs(other).max())


def test_worlds_are_not_mapped_again():
    def end(stiffness):
        return simulate_jax(CHAIN, 2, worlds=2, stiffness=stiffness, **HOW, device="cpu")[0].sum()

    with pytest.raises(jax.errors.JaxRuntimeError, match=r"worlds is 2; within jax\.vmap it must be None"):
        jax.block_until_ready(jax.vmap(end)(jax.numpy.array([50.0, 60.0])))


@pytest.mark.parametrize("worlds", [None, 4])
def test_a_loss_of_jax_has_the_derivatives_that_jax_finds(worlds, plain_device):
    def run():
        made = Simulation(CHAIN, **HOW, device=plain_device)
        return made if worlds is None else Ensemble(CHAIN, worlds, **ROWS, **HOW, device=plain_device)

    def loss(frames):
        return (frames.position[..., -1, :, :] ** 2).sum((-1, -2)) + jax.numpy.sin(frames.velocity[..., 2, 0, 1])

    def by_hand(frames):
        by_x, by_v = np.zeros((2, *frames.position.shape))
        by_x[..., -1, :, :] = 2 * frames.position[..., -1, :, :]
        by_v[..., 2, 0, 1] = np.cos(frames.velocity[..., 2, 0, 1])
        return np.asarray(loss(frames)), by_x, by_v

    found, wanted = (run().gradient(one, 3, by=("position", "stiffness")) for one in (loss, by_hand))
    np.testing.assert_allclose(found.value, wanted.value, rtol=1e-14)
    for name in ("position", "stiffness"):  # of a few roundings in the derivatives of the loss
        np.testing.assert_allclose(found[name], wanted[name], rtol=0, atol=1e-13 * np.abs(wanted[name]).max())


@pytest.mark.slow
def test_a_loop_keeps_nothing():
    def kept() -> int:
        """Return how many functions of past calls are alive."""
        gc.collect()
        return sum(getattr(one, "__name__", "") == "take_frames" for one in gc.get_objects())

    def end(stiffness):
        return simulate_jax(CHAIN, 2, stiffness=stiffness, **HOW, device="cpu")[0][-1].sum()

    before, step = kept(), jax.value_and_grad(end)
    for _ in range(3):
        step(jax.numpy.array([50.0, 80.0]))
    assert kept() == before


def test_wrong_values_are_told():
    for wrong, said in (
        ({"gravity": jax.numpy.zeros(2)}, "gravity has shape"),
        ({"worlds": 4, "mass": jax.numpy.ones(3)}, "mass has 3 rows; that must divide the number of worlds, 4"),
        ({"worlds": 0}, "worlds is 0"),
        ({"frames": 0}, "frames is 0"),
    ):
        with pytest.raises(ValueError, match=said):
            simulate_jax(CHAIN, **({"frames": 4, "device": "cpu"} | wrong))

    def run(mass):
        return simulate_jax(CHAIN, 2, mass=mass, device="cpu")

    with pytest.raises(ValueError, match=r"mass is .*; it must be"):
        run(jax.numpy.array(-1.0))
    with pytest.raises(jax.errors.JaxRuntimeError, match=r"mass is .*; it must be"):
        jax.block_until_ready(jax.jit(run)(jax.numpy.array(-1.0)))
