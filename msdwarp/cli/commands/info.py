"""The text of `msdwarp info`: contents of a trajectory, method of the simulation, and provenance."""

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bodies import counted
from ...files import Trajectory
from ..error_messages import printable
from ..options import Options, flattened
from ..results import RESTART

Lines = Iterator[tuple[str, str]]


def description(trajectory: Trajectory) -> str:
    """Return the description of a trajectory, in groups of lines with units."""
    path, about = trajectory.path, trajectory.attributes
    times, count = trajectory.times, len(trajectory)
    frames = f"{counted(count, 'frame')} from {times[0]:.4g} to {times[-1]:.4g} s" if count else "no frames"
    text = f"{path}: {frames}, {path.stat().st_size / 1e6:.1f} MB\n"
    groups = {
        "What it is": _what(trajectory),
        "How it was simulated": _how(about, trajectory.substeps),
        "Made by": _by(about),
        "Beside that": ((name, _words(about[name])) for name in about if name not in _KNOWN),
    }
    for title, lines in groups.items():
        try:
            shown = "".join(f"  {printable(name)}: {printable(value)}\n" for name, value in lines)
        except (ArithmeticError, AttributeError, TypeError, ValueError) as error:
            raise ValueError(f"{path} has attributes that no run writes: {error}") from error
        text += f"\n{title}\n{shown}" if shown else ""
    if path.with_name(RESTART).exists():
        command = f"msdwarp resume {shlex.quote(str(path.parent))}"
        text += f"\n{path.with_name(RESTART)}: `{command}` goes on from it\n"
    return text


def _what(trajectory: Trajectory) -> Lines:
    system, about = trajectory.system, trajectory.attributes
    if "scene" in about:
        yield "scene", str(about["scene"])
    if about.get("parameters"):
        yield "parameters", _words(about["parameters"])
    particles = f"{counted(system.particle_count, 'particle')} with {counted(system.dim, 'coordinate')}"
    yield "system", f"{particles}, {counted(system.connection_count, 'connection')}"
    pinned = int(system.pinned.sum())
    if pinned:
        yield "pinned", counted(pinned, "particle")
    if system.tears:
        broken_at, at_start = trajectory.broken_at, int(system.broken.sum())
        broken = np.isfinite(broken_at) & ~system.broken
        when = f", from {broken_at[broken].min():.4g} to {broken_at[broken].max():.4g} s" if broken.any() else ""
        before = f", beside {at_start} that were from the start" if at_start else ""
        yield "broken", f"{counted(int(broken.sum()), 'connection')}{when}{before}"
    for name, (every, columns) in (trajectory.probes or {}).items():
        count = len(trajectory.readings[name].times)
        yield f"probe {name}", f"{', '.join(columns)}, {counted(count, 'reading')} by {every}"
    interval = f", {1e3 / trajectory.fps:.4g} ms apart" if trajectory.fps else ""
    yield "frames", f"{trajectory.fps:.4g} a second of simulated time{interval}"


def _how(about: Mapping[str, Any], counts: NDArray[np.int32] | None) -> Lines:
    options = about.get("options", {})
    for name in ("integrator", "precision"):
        if name in about:
            yield name, str(about[name])
    if "substeps" in about:
        steps, fps = about["substeps"], options.get("fps")
        each = f", {1e3 / fps / steps:.4g} ms each" if fps and steps else ""
        if counts is not None and len(np.unique(counts)) > 1:
            steps, each = f"{counts.min()} to {counts.max()}, {counts.mean():.3g} on average,", ""
        yield "substeps", f"{steps} for each {f'1/{fps:g} s' if fps else 'frame'}{each}"
    if "force_algorithm" in about:
        yield "forces", f"summed by {about['force_algorithm']}"
    if "device" in about:
        name = about.get("device_name")
        yield "device", about["device"] + (f", {name}" if name and name.lower() != about["device"] else "")
    if "gravity_of_time" in about:
        yield "gravity", str(about["gravity_of_time"])
    elif isinstance(along := about.get("gravity"), list):
        yield "gravity", f"({', '.join(f'{one:.4g}' for one in along)}) m/s²"
    elif along is not None:
        yield "gravity", f"{along:.4g} m/s²"
    if about.get("loads"):
        yield "loads", ", ".join(map(str, about["loads"]))
    if "schedule" in about:
        changes = about["schedule"]
        yield "schedule", f"{counted(changes, 'change')} of parameters on the way" if changes else "no changes"
    usual, given = flattened(Options().as_stored()), flattened(options)
    other = [name for name in given if name not in _KNOWN and given[name] != usual.get(name)]
    if other:
        yield "flags", " ".join(_flag(name, given[name]) for name in other)


def _by(about: Mapping[str, Any]) -> Lines:
    if "command" in about:
        yield "command", shlex.join(about["command"])
    if "versions" in about:
        yield "versions", _words(about["versions"])
    if about.get("commit"):
        changed = about["commit"].endswith("+")
        yield "commit", about["commit"].rstrip("+") + (", changed since" if changed else "")
    if "script" in about:
        yield "script", _words(about["script"].get("sha256"))
    if "digest" in about:
        yield "digest", f"{about['digest']}, equal for scenes with the same bodies and forces"


_KNOWN = (
    *("scene", "parameters", "integrator", "precision", "substeps", "force_algorithm", "device", "device_name"),
    *("gravity", "gravity_of_time", "loads", "schedule", "options", "command", "versions", "commit", "digest"),
    "script",
)
"""Attributes of a run that the groups of lines above show."""


def _flag(name: str, value: Any) -> str:
    flag = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{flag}" if value else f"--no-{flag}"
    return " ".join(
        f"--{flag} {shlex.quote(_words(one))}" for one in (value if isinstance(value, list) else [value])
    )


def _words(value: Any) -> str:
    """Return a JSON value in readable form."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words(one)}" for name, one in value.items() if one is not None)
    return " ".join(map(_words, value)) if isinstance(value, list) else str(value)
