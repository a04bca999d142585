"""Going on with a run that was ended."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from .. import checks
from ..disk import alone_in
from ..files import Trajectory, probe, read_restart
from ..simulation import Simulation
from ..studies import EnergyLog
from .options import Options
from .provenance import built_again, digest
from .results import RESTART, TRAJECTORY, pictures_in
from .run import Run, last_frame, simulation_by
from .script_signatures import UNTOLD, Script


def resume_run(
    folder: Path,
    *,
    duration: float | None = None,
    device: str | None = None,
    force: bool = False,
    quiet: bool = False,
    script: Script = UNTOLD,
) -> None:
    """Go on with a run from its restart file, to its end or another duration [s], and draw it as it asked for.

    It ends with what it would have ended with if nothing had happened, to the last bit where its algorithm sums in
    a fixed order and the device is the one where it was.

    Raises
    ------
    ValueError
        If the restart file or the trajectory is none, or the scene is no longer what it was.
    FileExistsError
        If pictures are there that would be replaced, and `force` is False.
    SimulationDiverged, Interrupted, OSError
        As by `run_scene`.
    """
    if not (folder / RESTART).exists():
        raise FileNotFoundError(f"{folder} has no {RESTART}: its run wrote none, or ended before its first frame")
    with alone_in(folder):
        for name in (RESTART, TRAJECTORY):
            probe(folder / name)
        arrays, attributes = read_restart(folder / RESTART)
        made_by, checkpoint = _parts(folder / RESTART, attributes)
        origin, scene = built_again(made_by, script)
        if digest(scene) != made_by["digest"]:
            raise ValueError(f"scene {origin.place!r} is no longer what it was when the run began")
        if duration is not None:
            made_by["options"] = {**checks.mapping("the run's options", made_by["options"]), "duration": duration}
        device = device or made_by["device"]
        options = Options.stored(made_by["options"], device=device, quiet=quiet, force=force)
        last, behind = last_frame(options), checks.count("frame_index", checkpoint["frame_index"], 0) + 1
        simulation = simulation_by(scene, options)
        simulation.restore(arrays, checkpoint)
        _check_kept(folder / TRAJECTORY, simulation, made_by, options.every)
        pictures = pictures_in(folder, origin.name) if options.pictures.any else []
        if behind > last and options.pictures.are_in(folder, origin.name, (behind - 1) // options.every + 1):
            if not quiet:
                told = f"{behind} frames, {simulation.time:.4g} s"
                print(f"the run is complete ({told}); a longer --duration extends it")
            return
        if behind <= last and pictures and not force:
            raise FileExistsError(f"{pictures[0]} exists, and would be replaced; move it or add --force")
        path = options.log_path(folder)
        # A restart file may come from anyone, and is not to say where a file appears.
        if path is not None and not (options.logs_in_folder or script.trust or path.exists()):
            raise ValueError(f"log is {path}, outside of {folder} and no longer there; allow it with --trust")
        log = None if path is None or behind > last else EnergyLog(path, behind=behind)
        talk = Console(stderr=True, quiet=quiet)
        Run(scene, options, simulation, folder, origin.name, made_by, log, talk).to(last, behind=behind)


def _parts(path: Path, attributes: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what made a run, and the numbers it goes on from; raise ValueError if a part of them is missing."""
    parts = []
    wanted = {"run": ("scene", "parameters", "digest", "device", "options"), "checkpoint": ("frame_index",)}
    for part, names in wanted.items():
        found = checks.member(str(path), attributes, part)
        for name in names:
            checks.member(f"{path}: {part}", found, name)
        parts.append(found)
    return parts[0], parts[1]


def _check_kept(path: Path, simulation: Simulation, made_by: dict[str, Any], every: int) -> None:
    """Raise ValueError unless a trajectory is of the run that a simulation was restored from."""
    with Trajectory(path) as kept:
        same = all(kept.attributes.get(name) == made_by[name] for name in ("scene", "parameters", "digest"))
        k, between = divmod(simulation.frame_index, every)
        if same and not between and k < len(kept):
            pairs = zip(kept.frame(k)[1:], simulation.frame()[1:], strict=True)
            same = all(np.array_equal(one, other) for one, other in pairs)
        if not same:
            raise ValueError(f"{path} is of another run than {path.with_name(RESTART)}")
