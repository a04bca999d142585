"""The machine that this process runs on: its devices, and its cores."""

import os
from typing import Any

from .messages import start_warp
from .rehearsal import ImaginedGpu


def find_device(name: str | None) -> Any:
    """Return the Warp device called `name`; by default the first CUDA device, else the CPU.

    Raises ValueError that lists the existing devices if there is none of this name.
    """
    start_warp()
    import warp as wp

    if isinstance(name, ImaginedGpu):
        return name
    if name is None:
        return wp.get_preferred_device()
    try:
        return wp.get_device(name)
    except Exception as error:  # its type depends on the mistake in the name
        known = ", ".join(device.alias for device in wp.get_devices())
        raise ValueError(f"device is {name!r}; it must be one of {known}") from error


def cores() -> int:
    """Return the number of cores that this process may use."""
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(found, _quota())


def _quota() -> int:
    """Return the CPU quota of this container in cores, from Linux's control groups."""
    try:
        with open("/sys/fs/cgroup/cpu.max", encoding="ascii") as file:
            share, period = file.read().split()
        return max(1, int(share) // int(period))
    except (OSError, ValueError):  # no such file, or "max": no limit
        return os.cpu_count() or 1
