"""Points of a sweep as worlds of ensembles: those that differ only in what worlds may differ in, many at once."""

import hashlib
import pickle
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..engine import BodyContact
from ..integrators import UnstableStep
from ..quiet import in_turn
from ..simulation import Ensemble, Simulation, frame_count
from ..world import Scene
from .workers import gpus_for

ENSEMBLE = "ensemble"
"""The word for jobs by which all that can be worlds of ensembles are."""
OF_CONNECTIONS = ("stiffness", "damping", "rest_length")
OF_SYSTEM = (*OF_CONNECTIONS, "mass", "position", "velocity")
"""Fields of a system that may differ between worlds."""
ONLY_OF_YIELDING = ("original_length",)
"""Fields that count for nothing where no connection yields, as in every ensemble."""
MOST_WORLDS, MOST_ON_CPU = 4096, 64
"""Worlds of an ensemble at most: enough to fill a GPU. What is under way is lost when a sweep is ended."""
MOST_NUMBERS = 1 << 23
"""Particles and connections of all its worlds at most: some hundred megabytes of what differs."""


class Asked(NamedTuple):
    """What is to be simulated at a point."""

    scene: Scene
    duration: float
    """[s]"""
    options: dict[str, Any]
    """Arguments that `Ensemble` and `Simulation` share."""


class World(NamedTuple):
    """A point that was simulated as a world of an ensemble."""

    number: int
    asked: Asked
    alone: Callable[[], Simulation]
    """Returns the simulation of this world alone, at its end."""
    seconds: float
    """Its share of the time that the ensemble took."""


def as_worlds(
    tasks: Mapping[int, Any],
    ask: Callable[[Any], Asked],
    refused: dict[int, str],
    *,
    looks_back: bool = False,
    fixed_only: bool = False,
) -> Iterator[World]:
    """Simulate points in ensembles, and yield them as they are done; say why the others were not.

    A world is that of a simulation of its own with as many substeps: to the last bit wherever those of `Ensemble`
    are. "auto" takes those of the world that needs most, and no more on the way.

    Parameters
    ----------
    tasks
        The points, by number.
    ask
        Returns what is to be simulated for a task; what it raises is a reason not to.
    refused
        Takes, by number, why a point is none of a world: there is no other that differs from it only in what
        worlds may differ in; an ensemble cannot have it; or its world diverges, which a simulation tells more of.
    looks_back
        Whether more is asked of a simulation's readings than the last of each.
    fixed_only
        Leave out points whose number of substeps is not given.
    """
    alike: dict[bytes, list[tuple[int, Asked]]] = {}
    hopeless: dict[bytes, str] = {}
    for number, task in tasks.items():
        try:
            asked = ask(task)
            if why := _why_not(asked, looks_back, fixed_only):
                raise ValueError(why)
            key = _all_else(asked)
        except Exception as error:  # of a scene of any kind; a run of its own tells it in full
            refused[number] = str(error)
            continue
        if key in hopeless:
            refused[number] = hopeless[key]
            continue
        several = alike.setdefault(key, [])
        several.append((number, asked))
        if len(several) == _most(asked):
            try:
                yield from _together(alike.pop(key), refused)
            except _Hopeless as error:
                hopeless[key] = str(error)
    for several in alike.values():
        if len(several) == 1:
            refused[several[0][0]] = "no other point is alike"
            continue
        with suppress(_Hopeless):
            yield from _together(several, refused)


def in_words(done: int, refused: Mapping[int, str]) -> str:
    """Return how many points were worlds of ensembles, and why the others were not."""
    said = f"{done} of {done + len(refused)} points were worlds of ensembles"
    if not refused:
        return said
    reasons = Counter(refused.values()).most_common()
    more = f"; {len(reasons) - 1} more reasons" if len(reasons) > 1 else ""
    return f"{said}, the others runs of their own: {reasons[0][0]}{more}"


class _Hopeless(ValueError):
    """No world can have the scene, whatever its numbers."""


def _why_not(asked: Asked, looks_back: bool, fixed_only: bool) -> str:
    """Return why a point cannot be a world though an ensemble could have it; empty where it can."""
    if fixed_only and asked.options.get("substeps", "auto") == "auto":
        return "its number of substeps is automatic, and changes while it runs"
    if asked.scene.probes and looks_back:
        return "what is observed may ask for all readings of its probes"
    return ""


def _all_else(asked: Asked) -> bytes:
    """Return a digest of all that the worlds of an ensemble share; raise if it has what cannot be compared.

    Equal bytes are equal scenes. Different ones of equal scenes cost time, and nothing else.
    """
    scene, system = asked.scene, asked.scene.system
    own = (*OF_SYSTEM, *(() if system.yields else ONLY_OF_YIELDING))
    shared = {one.name: getattr(system, one.name) for one in fields(System) if one.name not in own}
    obstacles: Sequence[Any] = scene.colliders
    rough = [replace(one, friction=0.0) for one in obstacles]
    falls = scene.gravity if callable(scene.gravity) else None
    parts = (shared, rough, scene.loads, scene.schedule, dict(scene.probes), falls, asked.duration, asked.options)
    try:
        return hashlib.sha256(pickle.dumps(parts)).digest()
    except Exception as error:  # of functions that have no name
        raise ValueError(f"it cannot be compared with others: {error}") from error


def _most(asked: Asked) -> int:
    """Return how many worlds an ensemble may have."""
    system = asked.scene.system
    most = MOST_WORLDS if gpus_for(asked.options.get("device")) else MOST_ON_CPU
    return min(most, 1 + MOST_NUMBERS // (system.particle_count + system.connection_count))


def _together(several: list[tuple[int, Asked]], refused: dict[int, str]) -> Iterator[World]:
    """Simulate points in an ensemble; where it refuses some of them, in smaller ones without these."""
    try:
        ensemble = _ensemble([asked for _, asked in several])
    except ValueError as error:
        try:
            _ensemble([several[0][1]])
        except UnstableStep:
            pass  # a world's own fault, as its numbers are
        except ValueError:
            refused.update({number: str(error) for number, _ in several})
            raise _Hopeless(str(error)) from error
        if len(several) == 1:
            refused[several[0][0]] = str(error)
            return
        middle = len(several) // 2
        for half in (several[:middle], several[middle:]):
            yield from _together(half, refused)
        return
    yield from _simulated(ensemble, several, refused)


def _ensemble(several: list[Asked]) -> Ensemble:
    scenes = [asked.scene for asked in several]
    return Ensemble(scenes[0], len(scenes), **_rows(scenes), **several[0].options)


def _rows(scenes: list[Scene]) -> dict[str, NDArray[np.float64]]:
    """Return what differs between scenes, as `Ensemble` takes it."""
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
    for name in (*OF_CONNECTIONS, "mass", "friction"):  # a number for all of a world is stored once
        if name in differing and (differing[name] == differing[name][:, :1]).all():
            differing[name] = differing[name][:, 0]
    return differing


def _arrays_of(now: Any, compensated: bool) -> list[Any]:
    """Return the arrays on the device that a state is."""
    return [now.x, now.v, *now.method_state, *((now.compensation.x, now.compensation.v) if compensated else ())]


@in_turn
def _reached(ensemble: Ensemble) -> tuple[list[NDArray], list[Any]]:
    """Return what moves as it is now, shape [worlds, ...] each, and of each world what sticks to what."""
    model = ensemble.model
    moving = [model.by_world(array) for array in _arrays_of(ensemble.state.state_in, model.compensated)]
    return moving, model.touching.checkpoints() if model.touching is not None else []


def _simulated(ensemble: Ensemble, several: list[tuple[int, Asked]], refused: dict[int, str]) -> Iterator[World]:
    """Advance an ensemble to the end, and yield its worlds, but for those that diverge.

    Where there are probes, each world takes the last frame alone: all of them are read then.
    """
    began, first = time.perf_counter(), several[0][1]
    left = 1 if first.scene.probes else 0
    if (frames := frame_count(first.duration, ensemble.fps) - left) > 0:
        ensemble.step(frames)
    moving, sticking = _reached(ensemble)
    running = ensemble.status == "running"
    seconds = (time.perf_counter() - began) / len(several)
    how = {
        "integrator": ensemble.integrator,
        "substeps": ensemble.substeps,
        "force_algorithm": ensemble.model.force_algorithm,
    }

    @in_turn
    def alone(world: int, asked: Asked) -> Simulation:
        simulation = Simulation.from_scene(asked.scene, **(asked.options | how))
        now = simulation.state.state_in
        for array, values in zip(_arrays_of(now, ensemble.model.compensated), moving, strict=True):
            array.assign(values[world])
        for effect in simulation.model.effects:
            if isinstance(effect, BodyContact):
                effect.restore(sticking[world])
        simulation.frame_index = frames
        if left:
            simulation.step(left)
        return simulation

    for world, (number, asked) in enumerate(several):
        if running[world]:
            yield World(number, asked, lambda world=world, asked=asked: alone(world, asked), seconds)
        else:
            refused[number] = "its world diverges"
