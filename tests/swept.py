"""Scenes of sweeps: at the top of a module, where worker processes find them."""

import os
import signal
from dataclasses import replace
from pathlib import Path

from msdwarp import Plane, Probe, Scene, Simulation, chain


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


def tip_height(simulation: Simulation) -> float:
    """Return how high the last particle is [m]."""
    return float(simulation.frame().position[-1, 2])
