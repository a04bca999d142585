"""Rerunning: simulate again what is in a trajectory, and compare."""

import contextlib
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

from .. import checks
from ..disk import alone_in
from ..files import Trajectory
from ..live import FIRST_FRAME, Handling, Repeat, read_deeds, within_reach
from ..studies import compare
from ..world import Scene
from .options import Options, Pictures
from .provenance import about, built_again
from .results import TRAJECTORY, result_folder
from .run import Run, simulation_by, used
from .script_signatures import UNTOLD, Script


def rerun(path: Path, *, device: str | None, out: Path | None, quiet: bool, script: Script = UNTOLD) -> str | None:
    """Simulate again what a trajectory holds; return in what it differs, None if in nothing.

    Parameters
    ----------
    path
        The trajectory.
    device
        Where to simulate; by default where it was.
    out
        A folder to keep the result in, with the pictures that the run asked for; by default it is not kept.
    quiet
        Show no progress.
    script
        Which script may be run.

    Raises
    ------
    ValueError
        If the file does not say what made it, or that cannot be built or simulated here.
    """
    with Trajectory(path) as trajectory, contextlib.ExitStack() as stack:
        attributes = trajectory.attributes
        origin, scene = built_again(attributes, script)
        changes = {
            "log": None,
            "restart": 0.0,
            "quiet": True,
            "device": device or checks.member("the file", attributes, "device"),
        }
        options = Options.stored(checks.member("the file", attributes, "options"), **changes)
        if options.trajectory == "none":
            options = replace(options, trajectory="plain")
        if out is None:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            options = replace(options, pictures=Pictures(frames="none", video="none"))
        else:
            folder = result_folder(origin.name, out, False)
        if not len(trajectory):
            raise ValueError(f"{path} has no frames to repeat")
        if FIRST_FRAME in attributes:
            if out is not None:
                raise ValueError("out is given; what was recorded live is compared as it is made, and not kept")
            return _by_hand(trajectory, scene, options, read_deeds(path.parent) or [])
        simulation = simulation_by(scene, options)
        new = about(origin, scene) | used(simulation, options)
        last = (len(trajectory) - 1) * checks.count("every", options.every, 1)
        talk = Console(stderr=True, quiet=quiet)
        with alone_in(folder):
            Run(scene, options, simulation, folder, origin.name, new, None, talk).to(last)
        with Trajectory(folder / TRAJECTORY) as again:
            if again.positions.shape != trajectory.positions.shape:
                return f"it has {again.positions.shape[1]} particles now, not {trajectory.positions.shape[1]}"
            found = compare(trajectory, again)
            if found.first is None:
                return None
            said = f"it differs from frame {found.first} ({trajectory.times[found.first]:.4g} s) on"
            size = float(np.ptp(trajectory.positions[0], axis=0).max()) or 1.0
            said += f", by at most {found.largest:.2g} m, {found.largest / size:.1g} of the body's size, in frame "
            return f"{said}{found.frame}{_why(attributes, new)}"


def _by_hand(trajectory: Trajectory, scene: Scene, options: Options, deeds: list[dict[str, Any]]) -> str | None:
    """Simulate again what was recorded live, with all that was done by hand; return in what it differs."""
    handled = within_reach(scene)
    simulation = simulation_by(handled, options)
    handling = Handling(handled, simulation)
    repeat = Repeat(handling, deeds)
    first = checks.count("first_frame of the file", trajectory.attributes[FIRST_FRAME], 0)
    for k in range(first + len(trajectory)):
        if k:
            repeat.before_frame()
            simulation.step()
        if k >= first:
            was, found = trajectory.frame(k - first), simulation.frame()
            same = np.array_equal(was.position, found.position) and np.array_equal(was.velocity, found.velocity)
            if not same:
                return f"it differs from frame {k - first} ({was.time:.4g} s) on"
    return None


def _why(before: dict, now: dict) -> str:
    """Return what was other than now and may be why."""
    other = [
        f"{name} was {checks.repr_short(before.get(name))}, and is {now[name]!r}"
        for name in ("digest", "versions", "commit", "device_name", "force_algorithm", "precision", "substeps")
        if before.get(name) != now[name]
    ]
    if now["force_algorithm"] == "scatter" and now["device"] != "cpu":
        other.append("sums scattered on a GPU are not repeatable to the last bit")
    return "".join(f"\n  {line}" for line in other)
