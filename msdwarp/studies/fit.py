"""Parameters of a scene, fitted to a measured motion by `fit`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..files import Trajectory
from ..integrators import Integrator, Leapfrog
from ..simulation import frame_count
from ..world import Scene
from .fit_predictions import Worlds
from .fit_result import FitResult
from .fit_warnings import noise_warnings, time_warnings, value_warnings
from .least_squares import ABOVE_FLOOR, DIFFERENCE, LOSSES, Linear, Problem
from .measured import Channel, TrackedPoints, channels_of, frame_rate
from .parameters import parameters_of

GROWING, WHOLE = "growing", "whole"
SHORTEST = 1 / 32
"""The first horizon, as a fraction of the measured time; each later horizon is twice as long."""
LEAST_TIMES = 4
"""Minimal number of measured times in a horizon."""
STEPS = 6
"""Maximal number of steps on each horizon but the last."""
ROUNDS, WORTH = 4, 0.7
"""Maximal number of rounds of clouds; a round that leaves more than this fraction of the cost is the last."""
UNCERTAIN = 1.0
"""Standard deviation of ln(value) above which a parameter counts as undetermined (`unseen`)."""
LARGE_COMPONENT = 0.3
"""A parameter is undetermined if an undetermined direction of θ, of length 1, has a larger component of it."""
OF_DEVIATION, OF_VALUE, OF_JUMPS = 0.25, 1e-4, 3.0
"""A step is short enough if its error is below this fraction of the standard deviation, or of the value, or below
this multiple of the jumps that contact causes, which also depend on the step."""
WIDE = 2
"""Bounds that ask for more than so many times the substeps of the start are reported."""
MOST_REFINEMENT = 16
"""Maximal number of substeps, as a multiple of the stable number."""


def fit(
    scene: Scene,
    measured: str | Path | TrackedPoints | Trajectory | Mapping[str, Any],
    parameters: Sequence[str] | Mapping[str, float | None],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    noise: float | Mapping[str, float] | None = None,
    loss: str = "linear",
    horizon: str | Sequence[float] = GROWING,
    starts: int = 1,
    seed: int = 0,
    tolerance: float = 1e-9,
    fps: float | None = None,
    substeps: int | str = "auto",
    integrator: Integrator | None = None,
    precision: str = "float64",
    device: str | None = None,
    report: Callable[[str], None] = lambda line: None,
) -> FitResult:
    """Fit parameters of a scene to a measured motion.

    Gauss-Newton steps of `scipy.optimize.least_squares` minimise the sum of squared residuals. The unknowns are
    the logarithms of the parameters. Derivatives are finite differences: with p parameters each step is one
    `Ensemble` run of p + 1 worlds.

    Over a long time this sum has many minima: after one period a stiffness that is too high can fit again. So a
    short time is fitted first, then twice that time, and so on.

    Parameters
    ----------
    scene
        The measured scene. The search starts from its parameters.
    measured
        The measurements, with times counted from the scene's start:

        - a `TrackedPoints`, or the path of a CSV file with columns time, id, x, y, z: tracked points [s], [m];
        - a `Trajectory`, or its path: all particles;
        - a mapping from names of the scene's probes, or "energy", "kinetic energy", "elastic energy",
          "gravitational energy" [J], to (times, values) of shapes [rows] and [rows, width]; or the path of a CSV
          file that begins with time_s and has columns as in a run's probes.csv, or such as energy_J.

        Missing values are NaN, or empty cells of a file. Measurements at time 0 are ignored, because the scene
        sets the start.
    parameters
        Names from stiffness, damping, rest_length, mass, friction, gravity; or a mapping from names to starting
        values, where None is the scene's value. If all springs (or free particles, or obstacles) have the same
        value, the parameter is this value; otherwise it is a factor for all values. Stiffness and damping also
        scale those of `Cells`, by the same factor.
    bounds
        (lower, upper) by parameter name. By default 1/10 to 10 times the starting value.
    noise
        Standard deviation of the measurement noise, in the unit of the data; by name if there are several kinds
        ("points" are tracked points). It sets the relative weights of the kinds. By default each kind is divided
        by the variation of its values.
    loss
        "linear": squares. "soft_l1", "huber" or "cauchy" give large residuals less weight, for data with outliers;
        they need `noise` as the scale.
    horizon
        "growing", "whole" for all times at once, or increasing times [s]: the fit uses the data until each of
        these times in turn, then all data.
    starts
        Number of starting points, all in one run: the scene's values, and other points spread over the bounds.
    seed
        Seed of the other starting points.
    tolerance
        The search ends when steps are below this fraction of the values.
    fps
        Frames per second. By default the rate of the data, or 60 if measured times match no frame rate. Between
        frames the simulation is interpolated by a cubic spline.
    substeps
        Substeps of a frame, the same for all values. "auto" takes a number that is stable everywhere within the
        bounds, and increases it in the last steps of the search, until shorter steps would change no value by more
        than a quarter of its standard deviation, or 1e-4 of the value. The values then do not depend on the step.
        A given number is kept: the values then also compensate for errors of the time step.
    integrator
        Time-stepping method. By default `Leapfrog(damper_extrapolation=0.5)`, of second order with damping.
    precision
        "float64" or "float32-compensated". In "float32" rounding makes derivatives over a long time useless.
    device
        Device to simulate on. By default the first CUDA device, or the CPU if there is none.
    report
        A function that is called with lines of text about the progress.

    Returns
    -------
    FitResult
        Values, covariance, residuals.

    Raises
    ------
    ValueError
        If an argument is out of range, the measurements do not match the scene, or SciPy is missing.
    UnstableStep
        If `substeps` is too small for stability somewhere within the bounds.

    Warns
    -----
    FitWarning
        If the measurements do not determine a parameter, a value ends at its bound, the search does not converge,
        or steps cannot be made short enough. If residuals differ from the given noise: 1.5 times as large or as
        small, or correlated at neighbouring times (above 0.3). Noise that is independent in time causes such a
        warning in one fit of a hundred at most.

    Notes
    -----
    The covariance is s² (JᵀJ)⁻¹, where s² is the sum of squared residuals divided by rows − p, and J is the
    Jacobian of residuals. With substeps="auto" the square of the time step's error is added. This is correct if
    residuals are independent and the scene is exact except for noise (Nocedal & Wright, Numerical Optimization,
    2006, chapter 10). With another loss J is weighted by the derivative of the loss.

    With contact the simulated motion jumps slightly as parameters change, because a contact lasts a substep more
    or less. Then J is the slope of a linear model fitted to the residuals of many worlds around the values, and
    the covariance includes the scatter of residuals about this model.
    """
    checks.instance("scene", scene, Scene, "Scene(system=chain(5))")
    checks.imported("scipy.optimize", "fitting needs SciPy: pip install 'msdwarp[fit]'")
    checks.one_of("loss", loss, LOSSES)
    checks.one_of("precision", precision, DIFFERENCE)
    checks.between("tolerance", tolerance, 1e-15, 1.0)
    checks.count("starts", starts, 1)
    if not callable(report):
        raise ValueError(f"report is {checks.repr_short(report)}; it must be a function of a line of text")
    if loss != "linear" and noise is None:
        raise ValueError(f"loss is {loss!r}; noise must be given then, which says what is a large difference")
    sought = parameters_of(scene, parameters, bounds)
    channels = channels_of(measured, scene, noise)
    rate = frame_rate(channels) if fps is None else checks.positive("fps", fps)
    end = max(float(one.time[np.isfinite(one.values).any(axis=1)].max()) for one in channels)
    frame_count(end, rate)
    horizons = _horizons(horizon, channels, end)
    method = Leapfrog(damper_extrapolation=0.5) if integrator is None else integrator
    options = {"integrator": method, "precision": precision, "device": device}
    worlds = Worlds(scene, sought, channels, rate, substeps, options)
    problem = Problem(worlds, precision, loss)
    theta = _starts(problem, starts, seed)
    for message in time_warnings(worlds.start):
        checks.warn(message, checks.FitWarning)
    if worlds.substeps > WIDE * worlds.start.substeps:
        report(
            f"{worlds.substeps} substeps a frame, as the stiffest and most damped world within the bounds needs; "
            f"the start needs {worlds.start.substeps}: narrower bounds make the fit faster"
        )
    for one in horizons:
        report(f"up to {one:.4g} s from {len(theta)} start{'s' if len(theta) > 1 else ''}")
        theta = problem.approach(theta, one, STEPS)
    report(f"up to {end:.4g} s, the last steps")
    best, order = theta[0], 1 if scene.colliders or scene.contact is not None else method.order
    stable = worlds.substeps
    while True:
        best, linear, jumps, converged = _finish(problem, best, end, tolerance, seed, report)
        of_step = None
        if substeps != "auto":
            break
        moved, deviation, change = problem.of_step(best, end, linear, order)
        enough = np.maximum(OF_DEVIATION * deviation, OF_JUMPS * np.sqrt(np.diag(jumps))).clip(OF_VALUE)
        of_step = moved, enough, change
        times = min((np.abs(moved) / enough).max() ** (1 / order), MOST_REFINEMENT * stable / worlds.substeps)
        if times <= 1:
            break
        worlds.refine(times)
        report(f"again, with {worlds.substeps} substeps a frame")
    found, messages = _result(problem, best, linear, jumps, of_step, end, converged)
    for message in messages:
        checks.warn(message, checks.FitWarning)
    return found


def _horizons(requested: Any, channels: list[Channel], end: float) -> list[float]:
    """Return the ends [s] of the successive horizons; the last one is the end of the measurements."""
    times = np.unique(np.concatenate([one.time[one.time > 0] for one in channels]))
    if isinstance(requested, str):
        checks.one_of("horizon", requested, (GROWING, WHOLE))
        horizons = [end]
        shortest = max(SHORTEST * end, times[min(LEAST_TIMES, len(times)) - 1])
        while requested == GROWING and horizons[0] / 2 >= shortest:
            horizons.insert(0, horizons[0] / 2)
        return horizons
    given = checks.finite("horizon", requested)
    if given.ndim != 1 or not len(given) or (np.diff(given) <= 0).any() or given[0] < times[0]:
        raise ValueError(
            f"horizon is {checks.repr_short(requested)}; it must be 'growing', 'whole', or increasing times from "
            f"{times[0]:.4g} s on, where the first is measured"
        )
    return [*(float(one) for one in given if one < end), end]


def _starts(problem: Problem, count: int, seed: int) -> NDArray[np.float64]:
    """Return starting points, shape [count, parameters]: the scene's values, and points of a Latin hypercube."""
    first = np.zeros((1, problem.count))
    if count == 1:
        return first
    random, others = np.random.default_rng(checks.count("seed", seed, 0)), count - 1
    # Each of `others` equal parts of a parameter's range has one start.
    drawn = [random.permutation(others) + random.random(others) for _ in range(problem.count)]
    return np.concatenate([first, problem.low + np.column_stack(drawn) / others * (problem.high - problem.low)])


def _finish(
    problem: Problem,
    theta: NDArray[np.float64],
    end: float,
    tolerance: float,
    seed: int,
    report: Callable[[str], None],
) -> tuple[NDArray, Linear, NDArray, bool]:
    """Return (best θ until `end` [s], linearisation there, covariance by jumps, whether the search converged)."""
    best, converged = problem.finish(theta, end, tolerance)
    step, p = DIFFERENCE[problem.precision], problem.count
    linear, jumps = problem.linear(best[None], end, step)[0], np.zeros((p, p))
    for k in range(ROUNDS):
        cost, exact = problem.cost(linear.residuals), problem.floor(end) ** 2 * len(linear.residuals)
        if cost <= exact or (k == 0 and not problem.is_jagged(best, end, linear)):
            break
        report("clouds of worlds, as contact makes jumps")
        near, trend, spread = problem.smooth(best, end, seed + k)
        near, done = problem.finish(near, end, tolerance)
        better = problem.cost(problem.residuals(near[None], end)[0])
        if better <= cost:
            best, converged = near, done
            linear = problem.linear(best[None], end, step)[0]
        if better > exact:
            linear, jumps = Linear(linear.residuals, trend), spread
        else:
            jumps[:] = 0.0
        if better > WORTH * cost:
            converged = True  # with jumps steps stay large, so the search ends when clouds find nothing better
            break
    return best, linear, jumps, converged


def _result(
    problem: Problem,
    theta: NDArray,
    linear: Linear,
    jumps: NDArray,
    of_step: tuple[NDArray, NDArray, NDArray] | None,
    end: float,
    converged: bool,
) -> tuple[FitResult, list[str]]:
    """Return (result, texts of warnings); `of_step` has effects of the step: on θ, tolerated, on residuals."""
    worlds, values, names = problem.worlds, problem.values(theta), [one.name for one in problem.parameters]
    rows, p = linear.jacobian.shape
    s = np.sqrt(problem.cost(linear.residuals) / max(rows - p, 1))
    sizes, directions = problem.singular(linear)
    least = ABOVE_FLOOR * problem.hold(end)
    hidden = (sizes < least) | (s > UNCERTAIN * sizes) if rows >= p else np.ones(len(sizes), dtype=bool)
    parts = np.abs(directions[hidden])
    unseen = [name for k, name in enumerate(names) if (parts[:, k] > LARGE_COMPONENT).any() or rows < p]
    of_theta = (directions[~hidden].T * (s / sizes[~hidden]) ** 2) @ directions[~hidden]
    messages = value_warnings(problem, theta, unseen, converged)
    step = np.zeros(rows)
    if of_step is not None:
        moved, enough, step = of_step
        jumps = jumps + np.outer(moved, moved)
        several = zip(names, moved, enough, strict=True)
        off = [(name, by) for name, by, most in several if abs(by) > most and name not in unseen]
        if off:
            which = " and ".join(f"{name} by {100 * by:.2g} %" for name, by in off)
            most = f"{worlds.substeps} a frame are the most that are tried"
            messages.append(f"shorter steps would change {which}: {most}")
    covariance = (of_theta + jumps) * np.outer(values, values)
    for name in unseen:
        covariance[names.index(name), names.index(name)] = np.inf
    residuals, done = {}, 0
    for one, simulated in zip(problem.channels, worlds.predict(values[None], end), strict=True):
        later, counted = one.time > 0, int(one.until(end).sum())
        left = np.where(later[:, None], simulated[0] - one.values, np.nan)
        residuals[one.name] = one.time[later], left[later]
        own = one.noise * max(np.sqrt(np.mean(step[done : done + counted] ** 2)), problem.floor(end))
        messages += noise_warnings(one, left, p, own, robust=problem.loss != "linear")
        done += counted
    found = FitResult(
        values=dict(zip(names, map(float, values), strict=True)),
        units={one.name: one.unit for one in problem.parameters},
        covariance=covariance,
        residuals=residuals,
        residual_units={one.name: one.unit for one in problem.channels},
        scene=worlds.scene(values),
        fps=worlds.fps,
        substeps=worlds.substeps,
        runs=worlds.runs,
        batches=worlds.batches,
        alone=worlds.alone,
        unseen=tuple(unseen),
        converged=converged,
    )
    return found, messages
