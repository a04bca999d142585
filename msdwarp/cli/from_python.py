"""`run`: what `msdwarp run` does, called from Python.

Nothing large is imported before it is called, as `cli` is imported by the command first.
"""

import signal
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

if TYPE_CHECKING:
    from ..files import Trajectory
    from ..integrators import Integrator
    from ..world import Plane, Scene
    from .options import Options


def run(
    scene: "Scene | str | Path",
    out: str | Path | None = None,
    *,
    duration: float | None = None,
    fps: float = 60.0,
    frames: str | None = "png",
    film: str | None = "webp",
    resolution: tuple[int, int] = (1280, 720),
    integrator: "Integrator | str | None" = None,
    substeps: int | str = "auto",
    precision: str = "float32",
    device: str | None = None,
    force: bool = False,
    quiet: bool = False,
    **flags: Any,
) -> "Trajectory":
    """Simulate a scene, store and draw its frames, and print a summary, as `msdwarp run` does.

    The first Ctrl-C ends the run after the current frame. Frames until then are stored.

    Parameters
    ----------
    scene
        A scene; or the name of one of `msdwarp list`, or the path of a scene's script. Only a run of a script or a
        name can be continued by `msdwarp resume`, which builds its scene again.
    out
        Folder of the results; by default out/NAME after the script, or out/NAME-2 ... if that exists.
    duration
        Simulated time [s]; by default that of the scene.
    fps
        Frames per second of simulated time.
    frames
        "png" writes a picture of each frame; None writes none.
    film
        Format of the film: "webp", "mp4" or "gif"; None writes none.
    resolution
        Width and height of pictures in pixels, both even.
    integrator
        Time-stepping method; by default `SymplecticEuler()`.
    substeps, precision, device
        As for `Simulation`.
    force
        Overwrite earlier results in `out`.
    quiet
        Print errors only.
    flags
        Any other flag of `msdwarp run`, with underscores: color="strain", azimuth=30.0 [degrees], every=2,
        settle=True, contact_forces=True, log="energy.csv", body="ball",
        cut=Plane((0, -1, 0)) ...

    Returns
    -------
    Trajectory
        The stored frames, open: `trajectory.positions`, and its path.

    Raises
    ------
    ValueError
        If an argument is out of range, before anything is written.
    FileExistsError
        If `out` is not empty, without `force`.
    TypeError
        If there is no such flag.
    SimulationDiverged
        If the run diverges; earlier frames are kept and drawn.
    """
    from .. import checks
    from ..disk import TRAJECTORY
    from ..files import Trajectory
    from ..world import Scene
    from .commands.run import run_scene
    from .process import start_warp
    from .scene_files import Origin, find_scene
    from .signals import Interrupted, Terminated

    given = {"duration": duration, "fps": fps, "integrator": integrator, "substeps": substeps, "device": device}
    given |= {"precision": precision, "force": force, "quiet": quiet}
    options = _options({**given, "frames": frames, "film": film, "resolution": resolution, **flags})
    options = replace(options, out=None if out is None else Path(out))
    if isinstance(scene, str | Path):
        origin = find_scene(str(scene))
    else:
        checks.instance("scene", scene, Scene, "Scene(system=chain(5)), or the name of one")
        name = (options.out or Path(sys.argv[0] or "scene")).stem or "scene"
        origin = Origin(name, f"(made in Python)/{name}", lambda: scene, {})
        options = replace(options, restart=0.0)  # as nobody could build the scene again
    start_warp(options.verbose)
    try:
        done = run_scene(origin, origin.scene(), options)
    except (Interrupted, Terminated) as stop:
        signal.raise_signal(stop.number if isinstance(stop, Interrupted) else stop.args[0])
        raise
    except FileExistsError as error:
        raise FileExistsError(str(error).replace("add --force", "give force=True")) from None
    assert done.folder is not None
    return Trajectory(done.folder / TRAJECTORY)


def _options(given: Mapping[str, Any]) -> "Options":
    """Return the options of a run for arguments of `run`; raise TypeError or ValueError for a wrong one."""
    from .. import checks
    from ..integrators import METHODS, Integrator
    from ..runtime import parameter_meant
    from ..world import Plane
    from .error_messages import allowed
    from .options import Options
    from .picture_options import Pictures
    from .provenance import fits

    own, drawn = get_type_hints(Options), get_type_hints(Pictures)
    own.pop("pictures")
    drawn["film"] = drawn.pop("video")
    known, values = own | drawn, dict(given)
    for name in given.keys() - known.keys():
        raise TypeError(f"run() got an unexpected keyword argument {name!r}{parameter_meant(name, known)}")
    for name in ("frames", "film"):
        values[name] = values[name] or "none"
    if isinstance(values["resolution"], tuple):
        values["resolution"] = "x".join(map(str, values["resolution"]))
    if isinstance(values.get("cut"), Plane):
        values["cut"] = _as_flag(values["cut"])
    for name in ("target", "cut"):
        if isinstance(values.get(name), tuple):
            values[name] = ",".join(map(str, values[name]))
    for name in {"body", "passes"} & values.keys():
        values[name] = (values[name],) if isinstance(values[name], str) else tuple(values[name])
    if isinstance(method := values["integrator"], Integrator):
        values["integrator"] = next((name for name, one in METHODS.items() if one == method), method)
    for name, value in values.items():
        if not fits(value, known[name]):
            raise ValueError(f"{name} is {checks.repr_short(given[name])}; it must be {allowed(known[name])}")
    if values.get("trajectory") == "none":
        raise ValueError("trajectory is 'none'; it must be 'plain' or 'compressed', as it is what run returns")
    values["video"] = values.pop("film")
    pictures = Pictures(**{name: values.pop(name) for name in {*drawn, "video"} & values.keys()})
    return Options(**values, pictures=pictures)


def _as_flag(cut: "Plane") -> str:
    """Return a plane as the flag `cut`; raise ValueError if it cannot cut bodies in space."""
    from ..world import Look

    Look(cut=cut)  # checks it
    if wrong := cut.fits(3):
        raise ValueError(f"cut: {wrong}; in other spaces the scene's Look(cut=...) takes it")
    return ",".join(map(repr, (*cut.unit_normal(3).tolist(), cut.offset)))
