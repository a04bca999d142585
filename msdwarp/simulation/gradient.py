"""Gradients: how a loss changes with the start and the parameters of a run."""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..engine import without_adjoint
from ..integrators import Leapfrog, SymplecticEuler
from ..runtime import calling
from ..world import Actuator
from .gradient_run import Differentiated, Frames
from .run import Run

ARRAYS = ("position", "velocity", "stiffness", "damping", "rest_length", "mass", "gravity")
"""Names of arguments with respect to which derivatives may be requested; there are also "force" and "strain"."""
EXPLODES = 1000.0
"""Growth of a gradient for each frame, above which `GradientWarning` says that it explodes."""


Loss = Callable[[Frames], Any]
"""Function of frames -> (value, ∂/∂position, ∂/∂velocity), one of which may be None for 0; or -> value."""


@dataclass(frozen=True)
class Gradient:
    """A loss, and its derivatives by name: `gradient["stiffness"]`.

    For an ensemble all arrays have the axis of worlds first. They are NaN for worlds that diverged.

    Attributes
    ----------
    value
        The loss; in an ensemble that of each world, shape [worlds].
    derivatives
        Derivatives by name, each of the shape of its parameter in `System`; for gravity of shape [d].

        "force" is a constant force on each particle, shape [particle_count, d], in addition to all others.

        For a function of time there is a derivative by each value that the run has used: at each stage of each
        substep, and at the end, shape [frames · substeps · stages + 1, ...]; `times` has the times. For "strain"
        these derivatives have a column for each delay of each actuator.
    growth
        Norm of the derivative by the state at each frame, over the largest that the loss adds there or later.

        Shape [frames + 1]. Norms include derivatives by velocities, multiplied by the frames per second.
    frames
        The run: its times, positions and velocities.
    times
        Times at which each requested function of time was evaluated, by name [s], shape [evaluations].
    """

    value: Any
    derivatives: dict[str, NDArray[np.float64]]
    growth: NDArray[np.float64]
    frames: Frames
    times: dict[str, NDArray[np.float64]]

    def __repr__(self) -> str:
        by = ", ".join(f"{name} {values.shape}" for name, values in self.derivatives.items())
        return f"Gradient of {self.value} by {by}"

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the derivative by a parameter."""
        if name not in self.derivatives:
            raise KeyError(f"{name!r} was not asked for; there are {', '.join(map(repr, self.derivatives))}")
        return self.derivatives[name]


def gradient(owner: Any, of: Run, loss: Loss, frames: int, by: Sequence[str]) -> Gradient:
    """Return the gradient of a run; see `Simulation.gradient`. `owner` may not advance within the loss."""
    if not callable(loss):
        raise ValueError(f"loss is {checks.repr_short(loss)}; it must be a function of the frames")
    by = checks.sequence("by", by, str, "'stiffness'")
    run, found = differentiated(of, frames, by)
    told, both, stopped = calling(owner, "gradient", told_by, loss, found), [], run.stopped
    if not isinstance(told, tuple) or len(told) != 3:
        raise ValueError(
            f"loss returned {checks.repr_short(told)}; it must return a tuple of its value, and its "
            "derivatives by positions and by velocities (or None), or an array of JAX or a tensor of PyTorch"
        )
    value = checks.array("the value of loss", told[0])
    if value.shape != stopped.shape:
        allowed = f"of shape {stopped.shape}, a number for each world" if stopped.shape else "a number"
        raise ValueError(f"loss returned a value of shape {value.shape}; it must be {allowed}")
    checks.every("the value of loss", value, np.isfinite(value) | stopped, "finite")
    value[stopped] = np.nan
    if told[1] is None and told[2] is None:
        raise ValueError("loss returned None for both of its derivatives; one of them must be an array")
    for name, each in zip(("∂/∂position", "∂/∂velocity"), told[1:], strict=True):
        if each is not None:
            given, shape = checks.array(f"{name} of the loss", each), found.position.shape
            if given.shape != shape:
                raise ValueError(f"{name} of the loss has shape {given.shape}; it must be {shape}, or None")
            ended = stopped.reshape(stopped.shape + (1,) * (given.ndim - stopped.ndim))
            checks.every(f"{name} of the loss", given, np.isfinite(given) | ended, "finite")
            each = run.by_frame(given)
        both.append(each or [None] * len(found.time))
    growth = run.backward(*both)
    growth[stopped] = 0.0
    most = float(growth.max())
    if not math.isfinite(most) or most > EXPLODES * frames:
        where = f" of world {int(growth.max(axis=-1).argmax())}" if stopped.shape else ""
        checks.warn(
            f"the gradient{where} is {most:.2g} times as large at the start as what the loss adds: the motion "
            "is chaotic over so many frames, and the gradient tells nothing of finite changes",
            checks.GradientWarning,
        )
    growth[stopped] = np.nan
    return Gradient(value if stopped.shape else float(value), run.found(by), growth, found, run.times)


def differentiated(of: Run, frames: int, by: Sequence[str]) -> tuple[Differentiated, Frames]:
    """Simulate frames beside a run, and return them with the differentiable run; see `Simulation.gradient`."""
    count, names = check_differentiable(of, frames, by)
    assembly, state = of.begins_again()
    now, start = of.stepping, (of.time, names, of.energy_limit)
    run = Differentiated(assembly, state, now.state.v, now.integrator, now.choices, *start, now.dynamics.threads)
    if now.frozen is not None:
        run.stop(now.frozen.found().status)
    return run, run.forward(count)


def check_differentiable(of: Run, frames: int, by: Sequence[str]) -> tuple[int, Sequence[str]]:
    """Return the arguments of `gradient`; raise ValueError as it does, before anything is simulated."""
    count = checks.count("frames", frames, 1)
    names = checks.sequence("by", by, str, "'stiffness'")
    of_loads = [name for one in of.stepping.assembly.all for name in one.parameters() if name != "strain"]
    for k, name in enumerate(names):
        checks.one_of(f"by[{k}]", name, [*ARRAYS, "force", "strain", *of_loads])
    method, model = of.stepping.integrator, of.stepping.model
    differentiated = method.tableau is not None or isinstance(method, SymplecticEuler | Leapfrog)
    if not differentiated or method.method_state:
        raise ValueError(
            f"integrator is {method!r}; gradients need an explicit method without extrapolation, such as RK4()"
        )
    if model.compensated:
        raise ValueError(f"precision is {model.precision!r}; gradients need 'float32' or 'float64'")
    if missing := without_adjoint(of.stepping.assembly):
        raise ValueError(f"the scene has {' and '.join(missing)}; gradients through these are not possible")
    if "strain" in names and not any(isinstance(one, Actuator) for one in of.problem.loads):
        raise ValueError("by has 'strain', that of actuators; there must be an Actuator among the loads")
    if "damping" in names and model.laws.damper is None:
        raise ValueError("by has 'damping', and no connection has a damper; some damping must be above 0")
    for name in ("gravity", "mass"):
        if name in names and callable(of.problem.gravity):
            raise ValueError(f"by has {name!r}, and gravity is a function of time here; it must be constant")
    if of.is_due(of.frame_index + count - 1):
        raise ValueError(
            f"schedule has a change at {of.due[0].time:g} s; gradients through it are not possible, so the "
            f"{count} frames from {of.time:g} s must end before it, or begin after it"
        )
    return count, names


def told_by(loss: Loss, frames: Frames) -> Any:
    """Return what a loss returns; if that is a value of JAX or PyTorch, with its derivatives by that library."""
    told = loss(frames)
    library = type(told).__module__.partition(".")[0]
    if library == "torch":
        torch = sys.modules["torch"]
        both = [torch.tensor(one, dtype=torch.float64, requires_grad=True) for one in frames[1:]]
        value = loss(Frames(frames.time, *both))
        by = torch.autograd.grad(value.sum(), both, allow_unused=True) if value.requires_grad else (None, None)
        return value.detach().numpy(), *(None if one is None else one.numpy() for one in by)
    if library in ("jax", "jaxlib"):
        jax = sys.modules["jax"]
        value, back = jax.vjp(lambda *both: loss(Frames(frames.time, *both)), *frames[1:])
        return value, *back(jax.numpy.ones_like(value))
    return told
