"""Accuracy: the error of a method on a scene, and the fastest method with an error under a tolerance."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..integrators import METHODS, RK4, UnstableStep
from ..simulation import Simulation, SimulationDiverged, frame_count
from ..world import Scene

MOST_REFINEMENT = 64
"""Maximal number of substeps that are tried, as a multiple of the stable number."""


class Measurement(NamedTuple):
    """Error and cost of a method on a scene."""

    method: str
    precision: str
    substeps: int
    error: float
    """Largest error of a frame: root mean square of particles' position errors divided by the system's size."""
    seconds: float
    """Computing time per simulated second [s]; NaN if not measured because the error is too large."""
    seconds_between: tuple[float, float] = (math.nan, math.nan)
    """Quartiles of the rounds in which `seconds`, their median, was measured [s]."""

    @property
    def evaluations(self) -> int:
        """Force evaluations per frame."""
        return self.substeps * METHODS[self.method].evaluations


class Reference(NamedTuple):
    """The reference solution, with which other solutions are compared."""

    position: NDArray[np.float64]
    """Positions [m], shape [frame_count, particle_count, d]."""
    error: NDArray[np.float64]
    """Estimated error of the reference itself in each frame, defined as `Measurement.error`."""
    size: float
    """Largest extent of the system at the start [m]."""


def simulate(scene: Scene, duration: float, **options: Any) -> tuple[Simulation, NDArray[np.float64]]:
    """Return a simulation at its end, and positions of all frames, shape [frame_count, particle_count, d]."""
    simulation = Simulation.from_scene(scene, **options)
    return simulation, np.array([frame.position for frame in simulation.frames(duration)], dtype=np.float64)


def frame_errors(position: NDArray, reference: NDArray, size: float) -> NDArray[np.float64]:
    """Return the error of each frame: root mean square distance of the particles divided by `size`."""
    return np.sqrt(((position - reference) ** 2).sum(axis=2).mean(axis=1)) / size


def make_reference(
    scene: Scene, duration: float, device: str | None, report: Callable[[str], None] = lambda line: None
) -> Reference:
    """Return the scene's solution by RK4 in float64, with 8 times the stable number of substeps.

    The error of the solution is estimated from a run with half as many substeps that starts from positions rounded
    to float32. So the estimate includes changes of the motion that rounding alone causes, as in buckling.
    """
    stable = Simulation.from_scene(scene, integrator=RK4(), device=device).substeps
    system, runs = scene.system, []
    for n, position in ((4, system.position.astype(np.float32)), (8, system.position)):
        start = replace(scene, system=system.replace(position=position))
        options = {"integrator": RK4(), "device": device, "precision": "float64", "substeps": n * stable}
        report(f"reference {len(runs) + 1} of 2, {n * stable} substeps a frame")
        runs.append(simulate(start, duration, **options)[1])
    size = float(np.ptp(system.position, axis=0).max())
    return Reference(runs[1], frame_errors(runs[0], runs[1], size), size)


def tune(
    scene: Scene,
    tolerance: float,
    *,
    device: str | None = None,
    horizon: float = 1.0,
    report: Callable[[str], None] = lambda line: None,
) -> tuple[list[Measurement], float]:
    """Measure every method on a scene, with substeps that bring its error below a tolerance.

    Errors are measured until the horizon [s], which is at most the scene's duration, and at most the time in which
    the reference's error is below a tenth of the tolerance. Returns all measurements, the default method with its
    automatic substeps first unless it diverged, and the horizon used. Before each run `report` is called with a
    line about it. Raises ValueError for a scene with a schedule, if the reference is accurate for less than a
    frame, or if all runs diverge.
    """
    checks.positive("tolerance", tolerance)
    if scene.schedule:
        raise ValueError("the scene has a schedule: substeps that are right before a change may be wrong after it")
    horizon = min(checks.positive("horizon", horizon), scene.duration)
    frame_count(horizon, 60.0)
    position, error, size = make_reference(scene, horizon, device, report=report)
    frames = int((np.maximum.accumulate(error) <= tolerance / 10).sum())  # frames with an accurate reference
    if frames < 2:
        raise ValueError(
            f"tolerance is {tolerance:g}; a tenth of it must be more than the error of the reference, which is "
            f"{error[1]:.1g} after one frame"
        )
    reference = Reference(position[:frames], error[:frames], size)
    found: list[Measurement] = []
    for k, name in enumerate(METHODS, 1):
        label = f"method {k} of {len(METHODS)}, {name}"
        found += _measure_method(
            scene, name, tolerance, reference, device, lambda line, label=label: report(f"{label}, {line}")
        )
    if not found:
        raise ValueError(f"every run of every method diverged before {horizon:g} s; the horizon must be shorter")
    enough = [one for one in found if one.error <= tolerance or one is found[0]]
    least = min(one.evaluations for one in enough)
    chosen = [one for one in enough if one.evaluations <= 16 * least]
    report(f"computing times of {len(chosen)} that are cheap")
    for one, (low, median, high) in zip(chosen, _seconds(scene, chosen, device).tolist(), strict=True):
        found[found.index(one)] = one._replace(seconds=median, seconds_between=(low, high))
    return found, (frames - 1) / 60.0


def _measure_method(
    scene: Scene,
    name: str,
    tolerance: float,
    reference: Reference,
    device: str | None,
    report: Callable[[str], None],
) -> Iterator[Measurement]:
    """Yield a method's measurements, with automatic substeps first, until the error is under the tolerance."""
    method, horizon = METHODS[name], (len(reference.position) - 1) / 60.0
    if name == "leapfrog-extrapolated" and not scene.system.damping.any():
        return  # same as leapfrog
    substeps: int | str = "auto"
    precisions = iter(("float32", "float32-compensated", "float64"))
    precision, before, least = next(precisions), math.inf, 0
    for _ in range(6):
        options = {"integrator": method, "substeps": substeps, "precision": precision, "device": device}
        report(f"{precision}, {'stable' if substeps == 'auto' else substeps} substeps a frame")
        try:
            simulation, position = simulate(scene, horizon, **options)
        except UnstableStep:  # the method needs a damper at every spring
            return
        except SimulationDiverged as trouble:
            substeps = 2 * max(trouble.substeps_needed, 1 if substeps == "auto" else int(substeps))
            continue
        error = float(frame_errors(position, reference.position, reference.size).max())
        taken = max(count for _, count in simulation.substep_history)  # automatic substeps may be refined
        yield Measurement(name, precision, taken, error, math.nan)
        least = least or taken
        if error <= tolerance:
            return
        if error > 0.7 * before:  # smaller steps do not help, as the error is rounding
            precision, before = next(precisions, "float64"), math.inf
            continue
        before = error
        order = 1 if scene.colliders else method.order  # the order across contacts
        substeps = math.ceil(taken * max(1.3, 1.1 * (error / (0.8 * tolerance)) ** (1 / order)))
        if substeps > MOST_REFINEMENT * least:
            return


def _seconds(scene: Scene, found: list[Measurement], device: str | None, rounds: int = 9) -> NDArray[np.float64]:
    """Return quartiles of computing time per simulated second [s], shape [len(found), 3].

    They are those of rounds in which the methods alternate, as other programs may use the machine for a while.
    """
    simulations = []
    for one in found:
        how: dict[str, Any] = {"substeps": one.substeps, "precision": one.precision, "device": device}
        simulations.append(Simulation.from_scene(scene, integrator=METHODS[one.method], **how))
        simulations[-1].step()  # compiles kernels and records graphs
    times = np.empty((rounds, len(found)))
    for k in range(rounds):
        for n, simulation in enumerate(simulations):
            began = time.perf_counter()
            simulation.step(6)
            times[k, n] = (time.perf_counter() - began) * simulation.fps / 6
    return np.percentile(times, (25, 50, 75), axis=0).T


def cheapest(found: list[Measurement], tolerance: float) -> Measurement:
    """Return the fastest measurement with an error under the tolerance; raise ValueError if there is none."""
    good = [one for one in found if one.error <= tolerance]
    if not good:
        best = min(one.error for one in found)
        raise ValueError(f"tolerance is {tolerance:g}; the least error that was reached is {best:.2g}")
    return min(good, key=lambda one: one.seconds)


def as_fast(found: list[Measurement], tolerance: float) -> list[Measurement]:
    """Return the measurements under the tolerance whose quartiles overlap with those of the cheapest."""
    best = cheapest(found, tolerance)
    good = [one for one in found if one.error <= tolerance and one is not best]
    return [one for one in good if one.seconds_between[0] <= best.seconds_between[1]]
