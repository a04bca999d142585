"""Scenes of sweeps: at the top of a module, where worker processes find them."""

import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from msdwarp import Contact, Plane, Probe, Scene, Simulation, Wind, box, chain


def build(*, stiffness: float = 100.0, damping: float = 0.1, count: int = 3, mark: str = "") -> Scene:
    """Hang a chain up by an end; below `mark` a file says which stiffness kills its process, the first time."""
    victim = Path(mark, f"kill-{stiffness:g}") if mark else None
    if victim is not None and victim.exists():
        victim.unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    if mark:
        Path(mark, f"begun-{stiffness:g}-{os.getpid()}").touch()
    body = chain(count, 0.1, mass=0.01, stiffness=stiffness, damping=damping).pin([0])
    probes = {"tip": Probe([count - 1], "position")}
    return Scene(system=body, colliders=[Plane(offset=-5.0)], probes=probes, duration=0.1)


def tip(position, velocity):
    """Return how high the last particle of each world is [m]."""
    return position[:, -1, 2]


def observed(*, stiffness: float = 100.0) -> Scene:
    """Return the same scene, of which the tip is observed."""
    return replace(build(stiffness=stiffness), observe={"height": tip})


def exiting(*, stiffness: float = 100.0) -> Scene:
    """Return the same scene, unless it is too stiff."""
    return build(stiffness=stiffness) if stiffness < 200.0 else sys.exit("too stiff")


def tip_height(simulation: Simulation) -> float:
    """Return how high the last particle is [m]."""
    return float(simulation.frame().position[-1, 2])


def thrown(
    *,
    stiffness: float = 400.0,
    damping: float = 0.3,
    friction: float = 0.3,
    gravity: float = 9.82,
    size: int = 2,
    seed: int = 0,
    probes: bool = False,
    wind: bool = False,
) -> Scene:
    """Throw a block onto a floor, each seed in its own way."""
    random = np.random.default_rng(seed)
    body = box((size, size, 2), 0.1, mass=0.02, stiffness=stiffness, damping=damping)
    body = body.rotate(random.uniform(0, 3), random.normal(size=3)).translate((0, 0, 0.15))
    sensors = {"block": Probe(slice(None), "position"), "floor": Probe([0, 1], "contact force")}
    return Scene(
        system=body.with_velocity((random.uniform(0, 2), 0, -1)),
        colliders=[Plane(restitution=0.4, friction=friction)],
        gravity=gravity,
        loads=[Wind((1, 0, 0))] if wind else [],
        probes=sensors if probes else {},
        duration=0.15,
    )


def stacked(*, stiffness: float = 1400.0, tilt: float = 0.1, probes: bool = False) -> Scene:
    """Lay a block on another, on a slope: they stick to each other, and to the ground."""
    one = box((3, 3, 2), 0.1, mass=0.02, stiffness=stiffness, damping=0.5).translate((0, 0, 0.06))
    return Scene(
        system=one + one.translate((0.03, 0.02, 0.13)),
        colliders=[Plane(friction=0.8)],
        contact=Contact(friction=0.7),
        gravity=(9.82 * np.sin(tilt), 0, -9.82 * np.cos(tilt)),
        probes={"upper": Probe(range(18, 36), "touch force")} if probes else {},
        duration=0.4,
    )


class Here:
    """An executor that calls at once, in this process."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        """Return what a call has come to."""
        future: Future = Future()
        future.set_result(function(*arguments))
        return future

    def __enter__(self) -> "Here":
        return self

    def __exit__(self, *_: object) -> None:
        pass


def assert_alike(one, other):
    """Assert that two sweeps found the same to the last bit, whatever time they took."""
    import xarray

    xarray.testing.assert_identical(one.drop_vars("seconds"), other.drop_vars("seconds"))
