"""Simulations as functions of PyTorch: `gradcheck`, and what it is given."""

import numpy as np
import pytest
from differences import CHAIN, ROWS

from msdwarp import Leapfrog, Simulation, simulate_torch

torch = pytest.importorskip("torch")
HOW = {"precision": "float64", "substeps": 4}
NAMES = ("position", "velocity", "stiffness", "damping", "rest_length", "mass")


def test_gradients_pass_gradcheck(plain_device):
    tensors = [torch.tensor(np.array(getattr(CHAIN, name)), requires_grad=True) for name in NAMES]
    tensors.append(torch.tensor([0.1, 0.0, -9.8], dtype=torch.float64, requires_grad=True))

    def run(*given):
        named = dict(zip((*NAMES, "gravity"), given, strict=True))
        how = {"integrator": Leapfrog(), "device": plain_device, **HOW}
        return simulate_torch(CHAIN, 2, **named, **how)

    # Its differences are over 1e-6, so they are right to some 1e-9 of the largest derivatives.
    assert torch.autograd.gradcheck(run, tensors, eps=1e-6, atol=1e-6, rtol=1e-5)


def test_gradients_of_worlds_pass_gradcheck(plain_device):
    tensors = [torch.tensor(one, requires_grad=True) for one in ROWS.values()]

    def run(*given):
        how = {"integrator": Leapfrog(), "device": plain_device, **HOW}
        return simulate_torch(CHAIN, 2, worlds=4, **dict(zip(ROWS, given, strict=True)), **how)

    assert run(*tensors)[0].shape == (4, 3, 3, 3)
    assert torch.autograd.gradcheck(run, tensors, eps=1e-6, atol=1e-6, rtol=1e-5)  # as above


def test_a_loss_of_pytorch_has_the_derivatives_that_it_finds():
    def loss(frames):  # frames are arrays when it is called first, and tensors then
        return (torch.as_tensor(frames.position)[-1] ** 2).sum()

    def by_hand(frames):
        by_x = np.zeros(frames.position.shape)
        by_x[-1] = 2 * frames.position[-1]
        return (frames.position[-1] ** 2).sum(), by_x, None

    run = Simulation(CHAIN, integrator=Leapfrog(), device="cpu", **HOW)
    found, wanted = (run.gradient(one, 3, by=("position", "stiffness")) for one in (loss, by_hand))
    assert found.value == pytest.approx(wanted.value, rel=1e-14)
    for name in ("position", "stiffness"):
        np.testing.assert_allclose(found[name], wanted[name], rtol=1e-13)
    with pytest.raises(ValueError, match="loss returned None for both"):
        run.gradient(lambda frames: torch.tensor(1.0), 3)


def test_numbers_and_arrays_are_constants_beside_tensors():
    how = {"device": "cpu", **HOW}
    mass = torch.tensor(0.4, dtype=torch.float64, requires_grad=True)
    position, _ = simulate_torch(CHAIN, 4, mass=mass, stiffness=60.0, damping=np.array([0.1, 0.2]), **how)
    body = CHAIN.replace(mass=0.4, stiffness=60.0, damping=[0.1, 0.2])
    np.testing.assert_array_equal(position[-1].detach(), simulate_torch(body, 4, **how)[0][-1])
