"""Simulations as functions of PyTorch, with gradients. PyTorch is imported when `simulate_torch` is called."""

import importlib
from typing import Any

import numpy as np

from .. import checks
from ..bodies import System
from .given_arrays import differentiated, split_arrays


def simulate_torch(system: System, frames: int, **options: Any) -> tuple[Any, Any]:
    """Return positions [m] and velocities [m/s] of the coming frames as tensors that can be differentiated.

    Parameters
    ----------
    system
        What is simulated.
    frames
        How many frames.
    options
        Tensors for "position", "velocity", "stiffness", "damping", "rest_length", "mass" or "gravity" in place of
        the system's; gradients are led back to those that require them. One number may stand for all connections
        or particles; gravity is a vector. Others are arguments of `Simulation`.

    Returns
    -------
    position, velocity
        Tensors of shape [frames + 1, particle_count, d], in float64 on the host.

    Raises
    ------
    ValueError
        See `Simulation` and `Simulation.gradient`.
    ImportError
        Without PyTorch.
    """
    torch: Any = importlib.import_module("torch")
    checks.instance("system", system, System, "chain(5)")
    names, tensors = split_arrays(system, options, torch.Tensor)

    def on_host(tensor: Any) -> Any:
        return tensor.detach().cpu().numpy().astype(np.float64)

    class Run(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, *given: Any) -> Any:
            values = dict(zip(names, map(on_host, given), strict=True))
            ctx.run, found = differentiated(system, frames, values, options)
            return tuple(torch.from_numpy(one.astype(np.float64)) for one in (found.position, found.velocity))

        @staticmethod
        def backward(ctx: Any, *by_frames: Any) -> Any:
            ctx.run.backward(*map(on_host, by_frames))
            found = ctx.run.found(names)
            return tuple(
                # One number that stands for all has the sum of their derivatives.
                torch.as_tensor(found[name], dtype=one.dtype, device=one.device).sum_to_size(one.shape)
                for name, one in zip(names, tensors, strict=True)
            )

    return Run.apply(*tensors)
