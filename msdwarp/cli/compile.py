"""`msdwarp compile`: fills the folder of compiled kernels, where nothing is simulated."""

import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from ..engine import BodyContact, Pace
from ..integrators import choose_forced
from ..runtime import ImaginedGpu, cores, find_device, rehearsing
from ..simulation import Simulation
from .options import Options, SimulationOptions
from .run import method_of
from .scene_files import find_scene

SUBSTEPS = 8
"""Substeps of a rehearsed frame: from 7 on, a recorded frame may repeat two of them."""
MOST_WORKERS = 16
"""Maximal number of threads that compile; only one of them generates code at a time."""


class Job(NamedTuple):
    """A module to be compiled."""

    module: Any
    block_dim: int
    """Number of threads of a block."""
    target: str | int
    """The name of a device, or the architecture of a GPU, such as 90."""

    def run(self) -> bool:
        """Compile the module, and return True, unless its file is in the folder of compiled kernels."""
        import warp as wp

        device, arch = (None, self.target) if isinstance(self.target, int) else (wp.get_device(self.target), None)
        folder = os.path.join(wp.config.kernel_cache_dir or "", self.module.get_module_identifier(self.block_dim))
        name = self.module._get_compile_output_name(device, arch, block_dim=self.block_dim)
        missing = not os.path.exists(os.path.join(folder, name))
        if missing:
            options = self.module.resolved_options[self.block_dim]
            self.module._compile(device, output_arch=arch, options=options)
        return missing


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
            # For the CPU each thread would compile Warp's header first.
            with ThreadPoolExecutor(1 if target == "cpu" else min(cores(), MOST_WORKERS)) as pool:
                compiled = sum(pool.map(Job.run, jobs))
            where = f"sm_{target}" if isinstance(target, int) else target
            print(f"{name} for {where}: {len(jobs)} kernels, {compiled} compiled now", flush=True)


def jobs_of(make: Callable[[Any], Simulation], target: str | int) -> list[Job]:
    """Return the modules of a simulation on a device, or on a GPU of an architecture, in the order of launches."""
    import warp as wp

    arch = target if isinstance(target, int) else wp.get_device(target).arch
    with rehearsing() as kernels, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for limits in (False, True):  # what decides on it is not launched
            with (
                patch.object(BodyContact, "_worth_limiting", lambda _, limits=limits: np.full(1, limits)),
                patch.object(Simulation, "_choose", lambda self, rates, *_: _few_substeps(self, rates)),
            ):
                _launch_frames(make(ImaginedGpu(arch) if arch else "cpu"))
    where = {module: "cpu" if only_on_cpu else target for module, _, only_on_cpu in kernels}
    return [Job(one, 1 if where[one] == "cpu" else block or 256, where[one]) for one, block, _ in kernels]


def _few_substeps(simulation: Any, rates: Any) -> Any:
    return choose_forced(rates, simulation._method, simulation.fps, SUBSTEPS)


def _launch_frames(simulation: Simulation) -> None:
    """Launch frames of each kind: a later one may need other kernels than the first."""
    stepping = simulation.stepping
    for threads in dict.fromkeys((stepping.dynamics.threads, 1)):
        stepping.dynamics.pace = Pace(stepping.assembly, threads, threads)
        for stepping.sum_balance in (True, False):
            stepping.advance(0.0)
    if stepping.stepper.contact is not None:  # of frames that are one launch
        stepping.stepper.contact = None
        stepping.advance(0.0)
    simulation.assembly.inverted_cells.find(simulation.state.x)


def _architectures(arch: str, device: str | None) -> list[int]:
    """Return the architectures of GPUs; raise ValueError if there are none such, or a device is given, too."""
    from warp._src.context import runtime

    if device is not None:
        raise ValueError(f"arch is {arch}, and device is {device!r}; only one of them can be given")
    known = sorted(runtime.nvrtc_supported_archs)
    if not {one.strip() for one in arch.split(",")} <= {str(one) for one in known}:
        can = f"of {', '.join(map(str, known))}" if known else "none, as this Warp compiles for no GPU"
        raise ValueError(f"arch is {arch!r}; it must be one or several, such as 80,90, {can}")
    return list(map(int, arch.split(",")))
