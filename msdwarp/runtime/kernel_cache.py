"""The folder of compiled kernels: errors that name it, damaged files in it, and what compiling took."""

import contextlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from typing import Any

_DAMAGED = re.compile("Failed to load C|lacks kernel")
"""What is said of files that are no programs, or not whole; of the list of kernels JSON's ValueError is raised."""
_OF_A_KERNEL = 1 << 20
"""Bytes of a large kernel."""


class Compiling:
    """What this process has compiled."""

    modules = 0
    """Number of modules that were not in the folder of compiled kernels."""
    seconds = 0.0
    """Time that they took [s]; side by side they take less than one after the other."""

    @staticmethod
    def report() -> None:
        """Do something before a module is compiled; replace this function to be told."""


@contextlib.contextmanager
def cache_named() -> Iterator[None]:
    """Replace errors by an OSError that names the folder of compiled kernels, if it cannot be written to.

    The compiler's own message about a full disk depends on the file that did not fit. A read-only folder is no
    problem as long as it has all kernels.
    """
    try:
        yield
    except Exception as error:
        import warp as wp

        folder = wp.config.kernel_cache_dir
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(_OF_A_KERNEL))
        except OSError as reason:
            raise OSError(
                f"compiled kernels cannot be written to {folder}: {reason.strerror}; the environment variable "
                "WARP_CACHE_PATH must name a folder with room for them"
            ) from error
        raise


def watch_loading(module_kind: Any) -> None:
    """Have Warp's modules compile damaged files again, and tell `Compiling` what they compile."""
    load = module_kind.load

    def load_or_compile(module: Any, device: Any, block_dim: int | None = None, **named: Any) -> Any:
        first = not module.execs  # otherwise this may be called at each launch
        is_new = first and not os.path.isdir(_folder_of(module, block_dim))
        if is_new:
            Compiling.report()
        begun = time.perf_counter()
        with cache_named():
            try:
                loaded = load(module, device, block_dim, **named)
                if first:
                    _look_up_kernels(module, loaded)
            except Exception as error:
                damaged = isinstance(error, ValueError | FileNotFoundError) or _DAMAGED.search(str(error))
                if is_new or not first or not damaged:
                    raise
                # A full disk or a killed process may have left parts of files.
                shutil.rmtree(_folder_of(module, block_dim), ignore_errors=True)
                module.unload()
                is_new, loaded = True, load(module, device, block_dim, **named)
        if is_new:
            Compiling.modules += 1
            Compiling.seconds += time.perf_counter() - begun
        return loaded

    module_kind.load = load_or_compile


def _look_up_kernels(module: Any, loaded: Any) -> None:
    """Raise RuntimeError if a module's file, which was loaded for the CPU, lacks a kernel."""
    for kernel in module.kernels.values():
        if loaded.device.is_cpu and not kernel.is_generic and not loaded.get_kernel_hooks(kernel).forward:
            raise RuntimeError(f"{loaded.binary_path} lacks kernel {kernel.key}")


def _folder_of(module: Any, block_dim: int | None) -> str:
    """Return the folder of a module's compiled kernels."""
    import warp as wp

    name = module.get_module_identifier(block_dim if block_dim is not None else module.options["block_dim"])
    return os.path.join(wp.config.kernel_cache_dir or "", name)
