"""Sweep a scene from the command line: lists and ranges in flags define a grid, and each grid point is a run."""

import os
import re
import shlex
import signal
from collections import Counter
from collections.abc import Sequence
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from ... import studies
from ...simulation import frame_count
from ..error_messages import user_message
from ..options import SweepOptions, flattened
from ..process import progress_on, start_warp
from ..provenance import as_json, parameters_of
from ..scene_files import Origin, find_scene
from ..scene_flags import flags_app
from ..signals import Interrupted, Terminated, number_of, word
from .run import method_of, run_scene

_LONG = 86400.0
"""Time over which the displayed speed is averaged [s]: a point may take minutes."""
_ONCE = ("jobs", "keep", "out", "force", "quiet", "verbose")
"""Flags that do not affect the simulation."""


class CommandTask(NamedTuple):
    """What a worker simulates at a point of a sweep, as a command line."""

    place: str
    script: str | None
    words: tuple[str, ...]

    def chosen(self) -> tuple[Origin, SweepOptions]:
        """Return the scene and options; raise ValueError if the script has changed."""
        found = find_scene(self.place)
        if found.script != self.script:
            raise ValueError(f"{self.place} has changed since the sweep began")
        return flags_app(found, "msdwarp sweep", SweepOptions)(self.words)

    def setup(self) -> studies.Setup:
        """Return the setup of a world; raise ValueError if the point cannot be a world of an ensemble."""
        origin, options = self.chosen()
        scene = origin.scene()
        duration = scene.duration if options.duration is None else options.duration
        options.check(frame_count(duration, options.fps))
        if options.tolerance is not None:
            raise ValueError("its method and substeps are chosen by a tolerance")
        return studies.Setup(scene, duration, method_of(options))

    def simulate(self, folder: Path, keeps_files: bool) -> dict[str, float]:
        """Run the scene in a folder, and return the final values."""
        try:
            origin, options = self.chosen()
            start_warp(options.verbose)
            scene = origin.scene()
            run = run_scene(origin, scene, options.run_options(folder, keeps_files))
            return studies.final_numbers(run.simulation, scene)
        except Interrupted as error:
            if parent_process() is not None:  # a terminated worker, which the sweep handles
                os._exit(error.code)
            if error.number == signal.SIGINT:
                raise KeyboardInterrupt from None
            raise Terminated(error.number) from None
        except Exception as error:
            if (message := user_message(error)) is None:
                raise
            raise ValueError(message) from error


def sweep_scene(origin: Origin, command: str, flags: Sequence[str]) -> None:
    """Simulate a scene at all points of the grid that lists and ranges in flags define; print a summary.

    Raise ValueError for an invalid flag before any file is touched, OSError if the folder cannot be used, and
    Interrupted if a signal ends the sweep; the same command continues it.
    """
    fixed, grid = _read(flags)
    app = flags_app(origin, command, SweepOptions)
    chosen = app(fixed)
    if chosen is None:  # help was shown
        return
    options = chosen[1]
    if options.log is not None and not options.logs_in_folder:
        raise ValueError(
            f"log is {options.log}; in a sweep it must be a bare name, which goes into each run's folder"
        )
    values: dict[str, list[Any]] = {}
    for name, texts in grid.items():  # checked one by one, so that errors name the flag
        several = [_value(name, *app([*fixed, f"--{name}={text}"])) for text in texts]
        if len(set(several)) < len(several):
            raise ValueError(f"{name} has a value twice; its values must differ")
        values[name.replace("-", "_")] = several
    studies.check_size(values)
    # All parameters identify a point, and options unlike their defaults: later versions may add options.
    parameters = {name: _whole(value) for name, value in parameters_of(chosen[0]).items()}
    own, usual, planned = _flat(options), _flat(SweepOptions()), []
    for given, texts in zip(studies.points(values), studies.points(grid), strict=True):
        changed = own | {name: value for name, value in given.items() if name in usual}
        identity = {
            "scene": origin.name,
            "script": origin.script,
            "parameters": parameters | {name: value for name, value in given.items() if name not in usual},
            "options": {name: value for name, value in changed.items() if value != usual[name]},
        }
        words = (*fixed, *(f"--{name}={text}" for name, text in texts.items()))
        planned.append(studies.Point(identity, CommandTask(origin.place, origin.script, words)))
    folder = options.out or Path("out") / f"{origin.name}_sweep"
    start_warp(options.verbose)
    talk = Console(stderr=True, quiet=options.quiet)
    try:
        with progress_on(talk, over=_LONG) as progress:
            task = progress.add_task("sweeping", total=None)
            results, worlds, refused = studies.complete(
                values,
                planned,
                folder,
                options.keep == "run",
                jobs=options.jobs,
                device=options.device,
                report=lambda done, all_: progress.update(task, completed=done, total=all_),
                units=studies.units_of(origin.build, values),
            )
    except (KeyboardInterrupt, Terminated) as stop:
        number = number_of(stop)
        raise Interrupted(f"{word(number)}: done points are kept; the same command continues", number) from None
    if not options.quiet:
        count = Counter(results["status"].values.ravel().tolist())
        print(f"{results['status'].size} points: {', '.join(f'{n} {status}' for status, n in count.items())}")
        if worlds or options.jobs == studies.ENSEMBLE:
            print(studies.ensemble_summary(worlds, refused))
        wrong = {one for one in results["message"].where(results["status"] != "done", "").values.ravel() if one}
        for message in sorted(wrong)[:3]:
            print(f"  {message}")
        print(f"wrote {folder / studies.RESULTS}; `msdwarp plot {shlex.quote(str(folder))}` draws it")


def _read(flags: Sequence[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Split flags into those with a single value, and the values of the others by name."""
    fixed, grid, k = list[str](), dict[str, list[str]](), 0
    while k < len(flags):
        match = re.fullmatch(r"--([A-Za-z][\w-]*)(?:=(.*))?", flags[k], re.DOTALL)
        taken, text = 1, match and match.group(2)
        if match and text is None and k + 1 < len(flags):
            taken, text = 2, flags[k + 1]
        name = match.group(1).replace("_", "-") if match else ""
        several = studies.values_of(name, text) if match and text is not None else None
        if several is None:
            fixed.append(flags[k])
            k += 1
            continue
        if name in _ONCE:
            raise ValueError(f"{name} is {text!r}; it is the same for the whole sweep, and must be a single value")
        if name in grid:
            raise ValueError(f"{name} is swept twice; it must be given once")
        grid[name] = several
        k += taken
    return fixed, grid


def _flat(options: SweepOptions) -> dict[str, Any]:
    """Return a run's options by name, with the options of pictures at the same level."""
    return {name: _whole(value) for name, value in flattened(options.as_stored()).items() if name not in _ONCE}


def _value(name: str, chosen: Origin, options: SweepOptions) -> Any:
    """Return the value that a flag sets, as JSON data."""
    name = name.replace("-", "_")
    held = {**_flat(options), **chosen.parameters}
    if name not in held:
        raise ValueError(f"{name} is not a parameter that can be swept")
    return studies.as_scalar(name, as_json(held[name]))


def _whole(value: Any) -> Any:
    """Return a number without a fraction as an integer, since 2 and 2.0 are the same point."""
    return int(value) if isinstance(value, float) and value.is_integer() else value
