"""Simulations as functions of PyTorch and JAX, with gradients; each library is imported on the first call."""

import importlib
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..simulation import ARRAYS, Differentiated, Ensemble, Frames, Simulation


def split_arrays(options: dict[str, Any], kind: Any) -> tuple[list[str], list[Any]]:
    """Remove arrays of a type, or of several types, from `options`; return (names, arrays)."""
    names = [name for name in ARRAYS if isinstance(options.get(name), kind)]
    return names, [options.pop(name) for name in names]


def differentiated(
    system: System, frames: int, worlds: int | None, values: Mapping[str, NDArray], options: Mapping[str, Any]
) -> tuple[Differentiated, Frames]:
    """Simulate frames of a system, or of many worlds of it, with other values, ready for differentiation."""
    given = {**options, **{name: np.asarray(one, dtype=np.float64) for name, one in values.items()}}
    if worlds is not None:
        return Ensemble(system, worlds, **given).differentiated(frames, list(values))
    own = {name: given.pop(name) for name in ARRAYS if name in given and name != "gravity"}
    return Simulation(system.replace(**own), **given).differentiated(frames, list(values))


def derivatives_of(
    run: Differentiated, by_frames: Sequence[NDArray], shapes: Mapping[str, tuple[int, ...]]
) -> list[NDArray]:
    """Return derivatives by arrays of these shapes, given derivatives by positions and velocities of frames.

    A value for several particles, connections or worlds gets the sum of their derivatives.
    """
    run.backward(*map(run.by_frame, by_frames))
    sums = []
    for name, found in run.found(shapes).items():
        shape = shapes[name]
        if name == "gravity" and len(shape) < found.ndim:  # a number means downwards
            found = -found[..., -1]
        rows = min(len(shape), run.stopped.ndim)
        if rows:  # world w has row w mod (number of rows)
            found = found.reshape(-1, shape[0], *found.shape[1:]).sum(axis=0)
        found = found.sum(axis=tuple(range(rows, rows + found.ndim - len(shape))))
        sums.append(found.sum(axis=tuple(k for k, n in enumerate(shape) if n == 1), keepdims=True))
    return sums


def simulate_torch(system: System, frames: int, *, worlds: int | None = None, **options: Any) -> tuple[Any, Any]:
    """Return positions [m] and velocities [m/s] of the coming frames as tensors that can be differentiated.

    Parameters
    ----------
    system
        The system to simulate.
    frames
        Number of frames to simulate.
    worlds
        Number of worlds to simulate at once; None for one without an axis of worlds.
    options
        Tensors, arrays or numbers for "position", "velocity", "stiffness", "damping", "rest_length", "mass" or
        "gravity" in place of the system's; tensors that require gradients receive them. One number may stand for
        all connections or particles; gravity is a vector, or a number downwards. Other options are arguments of
        `Simulation`; with `worlds`, of `Ensemble`, and tensors have the shapes of its arguments: rows first, one
        for each world.

    Returns
    -------
    position, velocity
        Tensors of shape [frames + 1, particle_count, d], in float64 on the host; with `worlds` their axis is
        first. A world that diverges has NaN from that frame on, and NaN derivatives.

    Raises
    ------
    ValueError
        See `Simulation` and `Simulation.gradient`, or `Ensemble` and `Ensemble.gradient`.
    ImportError
        Without PyTorch.
    """
    torch: Any = importlib.import_module("torch")
    checks.instance("system", system, System, "chain(5)")
    names, tensors = split_arrays(options, torch.Tensor)

    def on_host(tensor: Any) -> Any:
        return tensor.detach().cpu().numpy().astype(np.float64)

    class Run(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, *given: Any) -> Any:
            values = dict(zip(names, map(on_host, given), strict=True))
            ctx.run, found = differentiated(system, frames, worlds, values, options)
            return tuple(torch.from_numpy(one.astype(np.float64)) for one in (found.position, found.velocity))

        @staticmethod
        def backward(ctx: Any, *by_frames: Any) -> Any:
            shapes = {name: tuple(one.shape) for name, one in zip(names, tensors, strict=True)}
            found = derivatives_of(ctx.run, [on_host(one) for one in by_frames], shapes)
            return tuple(
                torch.as_tensor(each, dtype=one.dtype, device=one.device)
                for each, one in zip(found, tensors, strict=True)
            )

    return Run.apply(*tensors)


def simulate_jax(system: System, frames: int, *, worlds: int | None = None, **options: Any) -> tuple[Any, Any]:
    """Return positions [m] and velocities [m/s] of the coming frames as JAX arrays that can be differentiated.

    Works within `jax.jit`, `jax.grad` (reverse mode, first derivatives) and `jax.vmap`, which simulates worlds of
    an `Ensemble`: then options are those of `Ensemble`, without `worlds`. Within `jax.jit` and `jax.vmap` the
    backward pass repeats the simulation, as JAX keeps only arrays.

    Parameters
    ----------
    system
        The system to simulate.
    frames
        Number of frames to simulate.
    worlds, options
        As for `simulate_torch`, with arrays or numbers in place of tensors; all of them receive gradients.

    Returns
    -------
    position, velocity
        Arrays of the shapes that `simulate_torch` returns, in float64 if JAX has it enabled (`jax_enable_x64`),
        else in float32.

    Raises
    ------
    ValueError
        If an argument is out of range.
    jax.errors.JaxRuntimeError
        The same errors within `jax.jit` or `jax.vmap`, with the message in the text, if a value is out of range.
    ImportError
        Without JAX.
    """
    jax: Any = importlib.import_module("jax")
    checks.instance("system", system, System, "chain(5)")
    frames = checks.count("frames", frames, 1)
    names, arrays = split_arrays(options, (jax.Array, np.ndarray, np.number, int, float))
    dtype = jax.dtypes.canonicalize_dtype(np.float64)
    each_world = () if worlds is None else (checks.count("worlds", worlds, 1),)
    shape = jax.ShapeDtypeStruct((*each_world, frames + 1, system.particle_count, system.dim), dtype)

    kept: list[Differentiated] = []
    """The run to differentiate next when JAX does not compile; compiled code may run others meanwhile."""

    def mapped_over(values: Any, own: tuple[int, ...]) -> tuple[int, ...]:
        """Return the axes that `jax.vmap` has put before those of a value."""
        return np.shape(values)[: np.ndim(values) - len(own)]

    def take_frames(shapes: Any, given: Any) -> tuple[Differentiated, tuple[NDArray, ...]]:
        axes = mapped_over(given[0], shapes[0]) if given else ()
        if axes and worlds is not None:
            raise ValueError(f"worlds is {worlds}; within jax.vmap it must be None: each value has its own world")
        rows = (math.prod(axes),) * bool(axes)
        each = [np.asarray(one).reshape(rows + own) for own, one in zip(shapes, given, strict=True)]
        values = dict(zip(names, each, strict=True))
        run, found = differentiated(system, frames, rows[0] if rows else worlds, values, options)
        return run, tuple(one.reshape(axes + shape.shape).astype(dtype) for one in found[1:])

    def propagate(shapes: Any, given: Any, by_frames: Any) -> Any:
        axes = mapped_over(by_frames[0], shape.shape)
        rows = (math.prod(axes),) * bool(axes)
        run = kept.pop() if kept and not axes else take_frames(shapes, given)[0]
        by = [np.asarray(one, dtype=np.float64).reshape(rows + shape.shape) for one in by_frames]
        found = derivatives_of(run, by, {name: rows + own for name, own in zip(names, shapes, strict=True)})
        return tuple(one.reshape(like.shape).astype(like.dtype) for one, like in zip(found, given, strict=True))

    def compiles(given: Any) -> bool:
        return any(isinstance(one, jax.core.Tracer) for one in jax.tree.leaves(given))

    def as_arrays(values: Any) -> Any:
        return jax.tree.map(jax.numpy.asarray, values)

    # JAX keeps every callback function for ever, so callbacks are used only in compiled code. `jax.vmap` calls one
    # once for all values, which have further axes in front.
    callback = partial(jax.pure_callback, vmap_method="broadcast_all")

    @jax.custom_vjp
    def simulate(*given: Any) -> Any:
        shapes = tuple(one.shape for one in given)
        if compiles(given):
            return callback(lambda *values: take_frames(shapes, values)[1], (shape, shape), *given)
        run, found = take_frames(shapes, given)
        kept[:] = [run]
        return as_arrays(found)

    def forward(*given: Any) -> Any:
        return simulate(*given), given

    def backward(given: Any, by_frames: Any) -> Any:
        shapes = tuple(one.shape for one in given)
        if compiles((given, by_frames)):
            like = tuple(jax.ShapeDtypeStruct(one.shape, one.dtype) for one in given)
            return callback(partial(propagate, shapes), like, given, by_frames)
        return as_arrays(propagate(shapes, given, by_frames))

    simulate.defvjp(forward, backward)
    each = (np if isinstance(one, np.ndarray) else jax.numpy for one in arrays)  # JAX may round to float32
    return simulate(*(kind.asarray(one, float) for kind, one in zip(each, arrays, strict=True)))
