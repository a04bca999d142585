"""Run points of a sweep as worlds of an ensemble, if they differ only in parameters in which worlds may differ."""

import hashlib
import pickle
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..integrators import UnstableStep
from ..simulation import Ensemble, Simulation, frame_count
from .sweep_points import Setup, Simulate, Task, final_numbers
from .workers import gpus_for

ENSEMBLE = "ensemble"
"""The value of `jobs` for which every point runs in an ensemble, if possible."""
OF_CONNECTIONS = ("stiffness", "damping", "rest_length")
OF_SYSTEM = (*OF_CONNECTIONS, "mass", "position", "velocity")
"""Fields of a system that may differ between worlds."""
ONLY_OF_YIELDING = ("original_length",)
"""Fields that matter only if springs yield; otherwise they may differ between worlds."""
MOST_WORLDS, MOST_ON_CPU = 4096, 64
"""Maximal number of worlds of an ensemble, on a GPU and on the CPU; interrupting a sweep loses all of one."""
MOST_NUMBERS = 1 << 23
"""Maximal number of particles plus springs in all worlds: some hundred megabytes of parameters."""

Numbered = tuple[int, Setup]
"""Index of a point, and the point's setup."""
World = tuple[int, Simulate, float]
"""Index of a point, a function that returns its world's results, and its part of the run time [s]."""


def run_in_ensembles(tasks: Mapping[int, Task], refused: dict[int, str], *, fixed_only: bool) -> Iterator[World]:
    """Simulate points in ensembles; yield their worlds; store in `refused` why other points are excluded.

    A world equals a separate simulation with as many substeps, bit for bit under the conditions of `Ensemble`.
    "auto" uses the substeps of the world that needs most, and keeps them; `fixed_only` excludes "auto".
    """
    alike: dict[bytes, list[Numbered]] = {}
    for number, task in tasks.items():
        try:
            setup = task.setup()
            if fixed_only and setup.options.get("substeps", "auto") == "auto":
                raise ValueError("its number of substeps is automatic, and changes while it runs")
            if setup.scene.probes and setup.observe:
                raise ValueError("what is observed may ask for all readings of its probes")
            key = _digest_of_shared(setup)
        except (Exception, SystemExit) as error:  # a scene may raise any; the separate run reports it in full
            refused[number] = str(error)
            continue
        several = alike.setdefault(key, [])
        several.append((number, setup))
        if len(several) == _most_worlds(setup):
            yield from _run_together(alike.pop(key), refused)
    for several in alike.values():
        if len(several) == 1:
            refused[several[0][0]] = "no other point is alike"
        else:
            yield from _run_together(several, refused)


def ensemble_summary(done: int, refused: Mapping[int, str]) -> str:
    """Return a message: how many points ran in ensembles, and why the others did not."""
    message = f"{done} of {done + len(refused)} points were worlds of ensembles"
    if not refused:
        return message
    reasons = Counter(refused.values()).most_common()
    more = f"; {len(reasons) - 1} more reasons" if len(reasons) > 1 else ""
    return f"{message}, the others runs of their own: {reasons[0][0]}{more}"


def _digest_of_shared(setup: Setup) -> bytes:
    """Return a digest of everything that an ensemble's worlds share; raise ValueError if it cannot be pickled."""
    scene, system = setup.scene, setup.scene.system
    own = (*OF_SYSTEM, *(() if system.yields else ONLY_OF_YIELDING))
    shared = {one.name: getattr(system, one.name) for one in fields(System) if one.name not in own}
    obstacles: Sequence[Any] = scene.colliders
    rough = [replace(one, friction=0.0) for one in obstacles]
    gravity = scene.gravity if callable(scene.gravity) else None
    around = scene.loads, scene.schedule, dict(scene.probes), gravity
    parts = (shared, rough, around, setup.duration, setup.options)
    try:
        return hashlib.sha256(pickle.dumps(parts)).digest()
    except Exception as error:  # such as functions without names
        raise ValueError(f"it cannot be compared with others: {error}") from error


def _most_worlds(setup: Setup) -> int:
    system = setup.scene.system
    most = MOST_WORLDS if gpus_for(setup.options.get("device")) else MOST_ON_CPU
    return min(most, 1 + MOST_NUMBERS // (system.particle_count + system.connection_count))


def _run_together(several: list[Numbered], refused: dict[int, str]) -> Iterator[World]:
    """Simulate points in one ensemble; if it refuses some of the points, in smaller ensembles without them."""
    try:
        ensemble = _ensemble([setup for _, setup in several])
    except ValueError as error:
        if len(several) == 1 or _is_refused_alone(several[0][1]):
            refused.update({number: str(error) for number, _ in several})
            return
        middle = len(several) // 2
        for half in (several[:middle], several[middle:]):
            yield from _run_together(half, refused)
        return
    yield from _run_ensemble(ensemble, several, refused)


def _is_refused_alone(setup: Setup) -> bool:
    """Return whether an ensemble refuses the scene, whatever the parameters of the worlds."""
    try:
        _ensemble([setup])
    except UnstableStep:
        return False
    except ValueError:
        return True
    return False


def _ensemble(several: list[Setup]) -> Ensemble:
    """Return an ensemble of scenes; fields that differ between scenes are its parameters."""
    scenes = [setup.scene for setup in several]
    rows: dict[str, NDArray] = {
        name: np.array([getattr(scene.system, name) for scene in scenes]) for name in OF_SYSTEM
    }
    if scenes[0].colliders:
        every: list[Sequence[Any]] = [scene.colliders for scene in scenes]
        rows["friction"] = np.array([[one.friction for one in obstacles] for obstacles in every])
    if not callable(scenes[0].gravity):
        dim = scenes[0].system.dim
        rows["gravity"] = np.array([checks.gravity("gravity", scene.gravity, dim) for scene in scenes])
    differing = {name: values for name, values in rows.items() if (values != values[:1]).any()}
    for name in (*OF_CONNECTIONS, "mass", "friction"):  # a value that is uniform within a world is stored once
        if name in differing and (differing[name] == differing[name][:, :1]).all():
            differing[name] = differing[name][:, 0]
    return Ensemble(scenes[0], len(scenes), **differing, **several[0].options)


def _run_ensemble(ensemble: Ensemble, several: list[Numbered], refused: dict[int, str]) -> Iterator[World]:
    """Advance an ensemble to the end, and yield the worlds that have not diverged."""
    began, first = time.perf_counter(), several[0][1]
    left = 1 if first.scene.probes else 0  # a `Simulation` per world runs the last frame, to read probes
    if (frames := frame_count(first.duration, ensemble.fps) - left) > 0:
        ensemble.step(frames)
    reached = ensemble.checkpoints()
    how = {
        "integrator": ensemble.integrator,
        "substeps": ensemble.substeps,
        "force_algorithm": ensemble.model.force_algorithm,
    }
    running = ensemble.status == "running"
    seconds = (time.perf_counter() - began) / len(several)

    def numbers_of(world: int, setup: Setup, *_: Any) -> dict[str, float]:
        simulation = Simulation.from_scene(setup.scene, **(setup.options | how))
        simulation.restore(*reached[world])
        if left:
            simulation.step(left)
        return final_numbers(simulation, setup.scene, setup.observe)

    for world, (number, setup) in enumerate(several):
        if running[world]:
            yield number, partial(numbers_of, world, setup), seconds
        else:
            refused[number] = "its world diverges"
