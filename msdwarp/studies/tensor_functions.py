"""Simulations as functions of PyTorch and JAX, with gradients; each is imported when its function is called."""

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..simulation import GRADIENT_NAMES, Differentiated, Frames, Simulation

ARRAYS = tuple(name for name in GRADIENT_NAMES if name not in ("force", "strain"))


def split_arrays(system: System, options: dict[str, Any], kind: Any) -> tuple[list[str], list[Any]]:
    """Remove arrays of a kind, a type or several, from `options`; return their names and themselves.

    Raises ValueError if gravity is no vector.
    """
    names = [name for name in ARRAYS if isinstance(options.get(name), kind)]
    arrays = [options.pop(name) for name in names]
    for name, one in zip(names, arrays, strict=True):
        if name == "gravity" and tuple(one.shape) != (system.dim,):
            raise ValueError(
                f"gravity has shape {tuple(one.shape)}; it must be a vector, of shape ({system.dim},)"
            )
    return names, arrays


def differentiated(
    system: System, frames: int, values: Mapping[str, NDArray], options: Mapping[str, Any]
) -> tuple[Differentiated, Frames]:
    """Take frames of a system with other values, which can be led back; see `Simulation` for `options`."""
    names: Sequence[str] = list(values)
    own: dict[str, Any] = {name: np.asarray(one, dtype=np.float64) for name, one in values.items()}
    around: dict[str, Any] = {"gravity": own.pop("gravity")} if "gravity" in own else {}
    return Simulation(system.replace(**own), **options, **around).differentiated(frames, names)


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


def simulate_jax(system: System, frames: int, **options: Any) -> tuple[Any, Any]:
    """Return positions [m] and velocities [m/s] of the coming frames as JAX arrays that can be differentiated.

    It can be used within `jax.jit` and `jax.grad` (reverse mode, first derivatives), not within `jax.vmap`. Within
    `jax.jit` the backward pass takes the frames again, as JAX keeps arrays alone.

    Parameters
    ----------
    system
        What is simulated.
    frames
        How many frames.
    options
        Arrays for "position", "velocity", "stiffness", "damping", "rest_length", "mass" or "gravity" in place of
        the system's; gradients are led back to them. One number may stand for all connections or particles;
        gravity is a vector. Others are arguments of `Simulation`.

    Returns
    -------
    position, velocity
        Arrays of shape [frames + 1, particle_count, d], in float64 if JAX has it enabled (`jax_enable_x64`), else
        in float32.

    Raises
    ------
    ValueError
        If an argument is out of range.
    jax.errors.JaxRuntimeError
        The same within `jax.jit`, with the message in its text, if a value is out of range.
    ImportError
        Without JAX.
    """
    jax: Any = importlib.import_module("jax")
    checks.instance("system", system, System, "chain(5)")
    frames = checks.count("frames", frames, 1)
    names, arrays = split_arrays(system, options, (jax.Array, np.ndarray))
    dtype = jax.dtypes.canonicalize_dtype(np.float64)
    shape = jax.ShapeDtypeStruct((frames + 1, system.particle_count, system.dim), dtype)

    kept: list[Differentiated] = []
    """The run that is led back next, where JAX does not compile: compiled code may take others meanwhile."""

    def take_frames(*given: Any) -> Any:
        values = dict(zip(names, map(np.asarray, given), strict=True))
        run, found = differentiated(system, frames, values, options)
        return run, (found.position.astype(dtype), found.velocity.astype(dtype))

    def lead_back(given: Any, by_frames: Any) -> Any:
        run = kept.pop() if kept else take_frames(*given)[0]
        by_position, by_velocity = (np.asarray(one, dtype=np.float64) for one in by_frames)
        run.backward(list(by_position), list(by_velocity))
        found = run.found(names)
        # One number that stands for all has the sum of their derivatives.
        sums = [found[name] if one.ndim else found[name].sum() for name, one in zip(names, given, strict=True)]
        return tuple(np.asarray(one, dtype=like.dtype) for one, like in zip(sums, given, strict=True))

    def compiles(given: Any) -> bool:
        return any(isinstance(one, jax.core.Tracer) for one in jax.tree.leaves(given))

    def as_arrays(values: Any) -> Any:
        return jax.tree.map(jax.numpy.asarray, values)

    # JAX keeps every function that it has called back for ever: only what it compiles is called so.
    @jax.custom_vjp
    def simulate(*given: Any) -> Any:
        if compiles(given):
            return jax.pure_callback(lambda *values: take_frames(*values)[1], (shape, shape), *given)
        run, found = take_frames(*given)
        kept[:] = [run]
        return as_arrays(found)

    def forward(*given: Any) -> Any:
        return simulate(*given), given

    def backward(given: Any, by_frames: Any) -> Any:
        if compiles((given, by_frames)):
            shapes = tuple(jax.ShapeDtypeStruct(one.shape, one.dtype) for one in given)
            return jax.pure_callback(lead_back, shapes, given, by_frames)
        return as_arrays(lead_back(given, by_frames))

    simulate.defvjp(forward, backward)
    return simulate(*arrays)
