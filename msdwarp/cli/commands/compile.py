"""`msdwarp compile`: compiles kernels of scenes and keeps them for later runs; nothing is simulated."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any
from unittest.mock import patch

from ...integrators import choose_forced
from ...runtime import ImaginedGpu, Job, Kernels, compile_all, find_device, rehearsing
from ...simulation import Simulation, SubstepChooser
from ..options import Options, SimulationOptions
from ..scene_files import find_scene
from .run import method_of


def compile_scenes(names: Sequence[str], arch: str | None, options: SimulationOptions) -> None:
    """Compile the kernels of scenes for GPUs of architectures, such as "80,90", or for the options' device."""
    targets = _architectures(arch, options.device) if arch else [find_device(options.device).alias]
    given = method_of(Options(**asdict(options)))
    for name in names:
        scene = replace(find_scene(name).scene(), settled=False)

        def make(device: Any, scene: Any = scene) -> Simulation:
            return Simulation.from_scene(scene, **given | {"device": device})

        for target in targets:
            jobs = jobs_of(make, target)
            missing = [job for job in jobs if job.is_missing()]
            for error in compile_all(missing):
                if error is not None:
                    raise error
            where = f"sm_{target}" if isinstance(target, int) else target
            print(f"{name} for {where}: {len(jobs)} kernels, {len(missing)} compiled now", flush=True)


def jobs_of(make: Callable[[Any], Simulation], target: str | int) -> list[Job]:
    """Return the modules of a simulation on a device, or on a GPU of an architecture, in the order of need."""
    import warp as wp

    arch = target if isinstance(target, int) else wp.get_device(target).arch
    with rehearsing(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            patch.object(
                SubstepChooser, "choose", lambda self, rates, *_: choose_forced(rates, self.method, self.fps, 1)
            ),
            patch.object(Kernels, "compile"),
        ):
            noted = make(ImaginedGpu(arch) if arch else "cpu").model.kernels.noted
    there: Any = (None, target) if isinstance(target, int) else (wp.get_device(target),)
    return [Job(*one, *there) for one in noted]


def _architectures(arch: str, device: str | None) -> list[int]:
    """Return the architectures of GPUs; raise ValueError for unknown ones, or if a device is given too."""
    from warp._src.context import runtime

    if device is not None:
        raise ValueError(f"arch is {arch}, and device is {device!r}; only one of them can be given")
    known = sorted(runtime.nvrtc_supported_archs)
    if not {one.strip() for one in arch.split(",")} <= {str(one) for one in known}:
        can = f"of {', '.join(map(str, known))}" if known else "none, as this Warp compiles for no GPU"
        raise ValueError(f"arch is {arch!r}; it must be one or several, such as 80,90, {can}")
    return list(map(int, arch.split(",")))
