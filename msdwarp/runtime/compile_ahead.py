"""The kernels that a scene is about to launch: on a GPU, those that were never compiled compile side by side."""

import os
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, NamedTuple

from .kernel_cache import Compiling
from .machine import cores
from .turns import deferring_signals

MOST_WORKERS = 16
"""Maximal number of threads that compile; only one of them generates code at a time."""
BESIDE = "msdwarp compiles"
"""Name of the thread that compiles beside a run."""
THREADS = "MSDWARP_THREADS"
"""Environment variable with the maximal number of CPU threads."""


class Job(NamedTuple):
    """A module to be compiled."""

    module: Any
    block_dim: int
    """Number of threads of a block."""
    device: Any
    """A Warp device; None for a GPU that need not be there."""
    arch: int | None = None
    """The architecture of that GPU, such as 90."""

    def is_missing(self) -> bool:
        """Return whether the module is not loaded, nor in the folder of compiled kernels, nor has failed."""
        import warp as wp

        module, block, device, arch = self
        if device is not None:
            known = device.context, block
            if known in module.execs or known in module.failed_builds:
                return False
        folder = os.path.join(wp.config.kernel_cache_dir or "", module.get_module_identifier(block))
        name = module._get_compile_output_name(device, arch, block_dim=block)
        return wp.config.cache_kernels and not os.path.exists(os.path.join(folder, name))

    def run(self) -> Exception | None:
        """Compile the module; return the error if that fails. Warp raises it again when the module is loaded."""
        module, block, device, arch = self
        try:
            module._compile(device, output_arch=arch, options=module.resolved_options[block])
        except Exception as error:
            return error


class Kernels:
    """The kernels that a scene is about to launch on a device."""

    begun: ClassVar = set[tuple[Any, int]]()
    """What any scene has begun to compile beside its run."""

    def __init__(self, device: Any) -> None:
        self._device, self.noted = device, dict[tuple[Any, int], bool]()
        """Whether a run can begin without them, by module and number of threads of a block, since `compile`."""

    def note(self, *kernels: Any, block: int = 256, first: bool = False, beside: bool = False) -> Any:
        """Have `compile` compile kernels, on a GPU for blocks of so many threads; return the first kernel.

        It begins with those noted as `first`: what takes longest must not wait for the rest. For those that only
        make frames faster, `beside`, it does not wait; see `is_compiled`.
        """
        noted = {(one.module, block if self._device.is_cuda else 1): beside for one in kernels}
        self.noted = noted | self.noted if first else self.noted | noted
        return kernels[0]

    def is_compiled(self, kernel: Any, block: int) -> bool:
        """Return whether a kernel can be launched without waiting for the compiler."""
        return not Job(kernel.module, block, self._device).is_missing()

    def compile(self) -> None:
        """On a GPU, compile the noted kernels that are missing; what fails is raised where it is launched."""
        missing = [
            (job, beside)
            for one, beside in self.noted.items()
            if self._device.is_cuda and (job := Job(*one, self._device)).is_missing()
        ]
        self.noted.clear()
        jobs = [job for job, beside in missing if not beside]
        if jobs:
            Compiling.report()
            begun = time.perf_counter()
            Compiling.modules += compile_all(jobs).count(None)
            Compiling.seconds += time.perf_counter() - begun
        beside = [job for job, beside in missing if beside and job[:2] not in self.begun]
        if beside:
            self.begun.update(job[:2] for job in beside)
            # Not a daemon: the compiler must not be running when the process ends.
            threading.Thread(target=compile_all, args=[beside], name=BESIDE).start()


def compile_all(jobs: Sequence[Job]) -> list[Exception | None]:
    """Compile modules, for one device, on several threads; return the error of each, None if there is none.

    No thread outlives this. For the CPU one thread compiles: each would compile Warp's header first, which takes
    longer than most modules.
    """
    most = os.environ.get(THREADS, "")
    workers = min(cores(), int(most) if most.isdecimal() else MOST_WORKERS, MOST_WORKERS, len(jobs))
    if workers < 2 or (jobs[0].device is not None and jobs[0].device.is_cpu):
        return [job.run() for job in jobs]
    with ThreadPoolExecutor(workers) as pool:
        try:
            with deferring_signals():  # while threads start
                running = pool.map(Job.run, jobs)
            return list(running)
        finally:  # of an interrupt
            pool.shutdown(cancel_futures=True)
