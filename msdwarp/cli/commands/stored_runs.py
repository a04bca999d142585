"""Continue or repeat runs, given their files."""

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

from ... import checks
from ...bodies import Frame
from ...disk import TRAJECTORY, alone_in
from ...files import Trajectory, probe, read_restart
from ...live import FIRST_FRAME, Handling, read_deeds, within_reach
from ...simulation import Simulation, frame_count
from ...studies import EnergyLog
from ...world import Scene
from ..options import Options
from ..picture_options import Pictures, PicturesAgain
from ..provenance import digest, rebuild_scene, restored_options
from ..results import RESTART, own_folder, pictures_in
from ..script_signatures import UNTRUSTED, Script
from .run import Case, about, check_drawable, simulation_by

AS_BEFORE = PicturesAgain()


def resume_run(
    folder: Path,
    *,
    duration: float | None = None,
    device: str | None = None,
    force: bool = False,
    quiet: bool = False,
    pictures: PicturesAgain = AS_BEFORE,
    script: Script = UNTRUSTED,
) -> None:
    """Continue a run from its restart file to the end, or to another duration [s], and draw the run.

    `pictures` has flags that change what was to be drawn.
    Raise ValueError if a file is invalid or the scene has changed, FileExistsError if pictures would be replaced
    without `force`, and the errors of `run_scene`.
    """
    if not (folder / RESTART).exists():
        raise FileNotFoundError(f"{folder} has no {RESTART}: its run wrote none, or ended before its first frame")
    with alone_in(folder):
        for name in (RESTART, TRAJECTORY):
            probe(folder / name)
        arrays, attributes = read_restart(folder / RESTART)
        made_by, checkpoint = _parts(folder / RESTART, attributes)
        origin, scene = rebuild_scene(made_by, script)
        if digest(scene) != made_by["digest"]:
            raise ValueError(f"scene {origin.place!r} has changed since the run began")
        if duration is not None:
            made_by["options"] = {**checks.mapping("the run's options", made_by["options"]), "duration": duration}
        device = device or made_by["device"]
        before = restored_options(made_by["options"], device=device, quiet=quiet, force=force)
        options = replace(before, pictures=pictures.over(before.pictures))
        made_by["options"] = {**made_by["options"], "pictures": options.as_stored()["pictures"]}
        if options.sums_contact and not before.sums_contact:
            raise ValueError("color or arrows show contact forces, which only a run with --contact-forces stores")
        last = frame_count(options.duration or 0.0, options.fps)
        options.check(last)
        check_drawable(scene, options)
        behind = checks.count("frame_index", checkpoint["frame_index"], 0) + 1
        simulation = simulation_by(scene, options)
        simulation.restore(arrays, checkpoint)
        _check_kept(folder / TRAJECTORY, simulation, made_by, options.every)
        there = pictures_in(folder, origin.name) if options.pictures.any else []
        again = bool(pictures.given) or behind <= last
        if not again and options.pictures.are_in(folder, origin.name, (behind - 1) // options.every + 1):
            if not quiet:
                frames = f"{behind} frames, {simulation.time:.4g} s"
                print(f"the run is complete ({frames}); a longer --duration extends it")
            return
        if again and there and not force:
            raise FileExistsError(f"{there[0]} exists, and would be replaced; move it or add --force")
        path = options.log_path(folder)
        # A restart file may come from anyone, and must not choose where a file is created.
        if path is not None and not (options.logs_in_folder or script.trust or path.exists()):
            raise ValueError(f"log is {path}, outside of {folder} and no longer there; allow it with --trust")
        log = None if path is None or behind > last else EnergyLog(path, behind=behind)
        talk = Console(stderr=True, quiet=quiet)
        Case(scene, options, simulation, folder, origin.name, made_by, log, talk).to(last, behind=behind)


def _parts(path: Path, attributes: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return (a run's attributes, its checkpoint's values); raise ValueError if either is missing."""
    made_by, checkpoint = (checks.member(str(path), attributes, part) for part in ("run", "checkpoint"))
    for name in ("scene", "parameters", "digest", "device", "options"):
        checks.member(f"{path}: run", made_by, name)
    checks.member(f"{path}: checkpoint", checkpoint, "frame_index")
    return made_by, checkpoint


def _check_kept(path: Path, simulation: Simulation, made_by: dict[str, Any], every: int) -> None:
    """Raise ValueError unless a trajectory belongs to the run of the restored simulation."""
    with Trajectory(path) as kept:
        same = all(kept.attributes.get(name) == made_by[name] for name in ("scene", "parameters", "digest"))
        k, between = divmod(simulation.frame_index, every)
        if same and not between and k < len(kept):
            same = all(map(np.array_equal, kept.frame(k)[1:], simulation.frame()[1:]))
        if not same:
            raise ValueError(f"{path} is of another run than {path.with_name(RESTART)}")


def rerun(
    trajectory: Trajectory, *, device: str | None, out: Path | None, quiet: bool, script: Script = UNTRUSTED
) -> str | None:
    """Repeat the run of a trajectory; return how the result differs, or None if it is equal.

    The result, with pictures as in the run's options, is kept in the folder `out`, if given. Raise ValueError
    if the file does not name its scene, or the scene cannot be built or simulated here.
    """
    with contextlib.ExitStack() as stack:
        attributes = trajectory.attributes
        origin, scene = rebuild_scene(attributes, script)
        device = device or checks.member("the file", attributes, "device")
        stored = checks.member("the file", attributes, "options")
        options = restored_options(stored, log=None, restart=0.0, quiet=True, device=device)
        if options.trajectory == "none":
            options = replace(options, trajectory="plain")
        if not len(trajectory):
            raise ValueError(f"{trajectory.path} has no frames to repeat")
        if FIRST_FRAME in attributes:
            if out is not None:
                raise ValueError("out is given; what was recorded live is compared as it is made, and not kept")
            start = checks.count("first_frame of the file", attributes[FIRST_FRAME], 0)
            deeds, last = read_deeds(trajectory.path.parent), start + len(trajectory) - 1
            return _difference(trajectory, _live_frames(scene, options, deeds, start, last))
        if out is None:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            options = replace(options, pictures=Pictures(frames="none", video="none"))
        else:
            folder = stack.enter_context(own_folder(origin.name, out, False))
        simulation = simulation_by(scene, options)
        new = about(origin, scene, simulation, options)
        last = (len(trajectory) - 1) * checks.count("every", options.every, 1)
        talk = Console(stderr=True, quiet=quiet)
        Case(scene, options, simulation, folder, origin.name, new, None, talk).to(last)
        with Trajectory(folder / TRAJECTORY) as again:
            difference = _difference(trajectory, again)
        return None if difference is None else difference + _causes(attributes, new)


def _live_frames(
    scene: Scene, options: Options, deeds: list[dict[str, Any]], first: int, last: int
) -> Iterator[Frame]:
    """Repeat a live recording with the user's recorded actions; yield the frames."""
    handled = within_reach(scene)
    simulation = simulation_by(handled, options)
    handling = Handling(handled, simulation)
    for k in range(last + 1):
        if k:
            handling.do_due(deeds)
            simulation.step()
        if k >= first:
            yield simulation.frame()


def _difference(before: Trajectory, again: Iterable[Frame]) -> str | None:
    """Return how a trajectory's frames differ from repeated frames; None if they are equal bit for bit."""
    first, largest, at = None, 0.0, 0
    for k, (was, now) in enumerate(zip(before, again, strict=False)):
        if was.position.shape != now.position.shape:
            return f"it has {len(now.position)} particles now, not {len(was.position)}"
        if not all(map(np.array_equal, was[1:], now[1:])):
            first = k if first is None else first
            apart = float(np.linalg.norm(was.position.astype(float) - now.position, axis=1).max())
            largest, at = max((largest, at), (apart, k))
    if first is None:
        return None
    size = float(np.ptp(before.positions[0], axis=0).max()) or 1.0
    return (
        f"it differs from frame {first} ({before.times[first]:.4g} s) on, by at most {largest:.2g} m, "
        f"{largest / size:.1g} of the body's size, in frame {at}"
    )


def _causes(before: dict, now: dict) -> str:
    other = [
        f"{name} was {checks.repr_short(before.get(name))}, and is {now[name]!r}"
        for name in ("digest", "versions", "commit", "device_name", "force_algorithm", "precision", "substeps")
        if before.get(name) != now[name]
    ]
    if now["force_algorithm"] == "scatter" and now["device"] != "cpu":
        other.append("sums scattered on a GPU are not repeatable to the last bit")
    return "".join(f"\n  {line}" for line in other)
