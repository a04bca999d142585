"""Rehearsals: a scene is assembled, and launches nothing on its device. For processes that do nothing else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch


class _Idle:
    """Stands for streams, events and recordings: it has every attribute, and every call does nothing."""

    def __getattr__(self, name: str) -> "_Idle":
        return self

    def __call__(self, *args: Any, **named: Any) -> "_Idle":
        return self

    __enter__ = __call__

    def __exit__(self, *raised: object) -> None: ...


_IDLE = _Idle()
_IDLING = "ScopedStream", "Stream", "Event", "get_stream", "synchronize_event", "capture_if", "capture_while"
"""What does nothing in a rehearsal."""


class ImaginedGpu(str):
    """A GPU that need not be there: kernels are composed for it, but Warp takes it for the CPU."""

    __slots__ = ("arch",)
    is_cuda, is_cpu, alias, sm_count, stream = True, False, "cuda", 132, _IDLE

    def __new__(cls, arch: int) -> "ImaginedGpu":
        """Return a GPU of compute capability `arch`, such as 90 for 9.0."""
        one = super().__new__(cls, "cpu")
        one.arch = arch
        return one


@contextmanager
def rehearsing() -> Iterator[None]:
    """Launch only what the CPU launches whatever the device of the scene.

    Arrays are made, in the CPU's memory and filled with 0, and copied. Functions of Warp are replaced in the whole
    process: what it has made meanwhile must not be used afterwards.
    """
    import warp as wp

    really = wp.launch

    def launch(*args: Any, device: Any = None, **named: Any) -> None:
        if type(device) is str and device == "cpu":
            really(*args, device=device, **named)

    def make(name: str) -> Callable:
        filled = getattr(wp, name.replace("empty", "zeros"))
        return lambda *args, pinned=False, **named: filled(*args, **named)

    instead: dict[str, Any] = {name: make(name) for name in ("zeros", "zeros_like", "empty", "empty_like")}
    with patch.multiple(wp, **instead, launch=launch, **dict.fromkeys(_IDLING, _IDLE)):
        yield
