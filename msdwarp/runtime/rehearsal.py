"""Rehearsals: which kernels a scene launches, found without launching any. For processes that do nothing else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

Kernels = dict[tuple[Any, int | None, bool], None]
"""Module, threads of a block, and whether only the CPU ever launches it, in the order of their first launch."""


class _Idle:
    """Stands for streams, events and recordings: it has every attribute, and every call does nothing."""

    def __getattr__(self, name: str) -> "_Idle":
        return self

    def __call__(self, *args: Any, **named: Any) -> "_Idle":
        return self

    __enter__ = __call__

    def __exit__(self, *raised: object) -> None: ...


_IDLE = _Idle()
_IDLING = ("ScopedCapture", "ScopedStream", "Stream", "Event", "get_stream", "capture_launch")
_IDLING += ("synchronize_stream", "synchronize_event", "synchronize_device")
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
def rehearsing() -> Iterator[Kernels]:
    """Collect the kernels that would be launched, or loaded, instead of launching them.

    Arrays are made, in the CPU's memory and filled with 0, and copied. Recorded graphs are not replayed; both
    branches of a conditional launch are collected. Functions of Warp are replaced in the whole process: what it
    has made meanwhile must not be used afterwards.
    """
    import warp as wp

    kernels = Kernels()

    def load(module: Any, device: Any = None, *, block_dim: int | None = None, **_: Any) -> None:
        kernels[module, block_dim, type(device) is str and device == "cpu"] = None

    def launch(kernel: Any, *_: Any, device: Any = None, block_dim: int | None = None, **named: Any) -> None:
        load(kernel.module, device, block_dim=block_dim)

    def branch(condition: Any, *branches: Callable[[], None] | None) -> None:
        for each in branches:
            if each is not None:
                each()

    def make(name: str) -> Callable:
        filled = getattr(wp, name.replace("empty", "zeros"))
        return lambda *args, pinned=False, **named: filled(*args, **named)

    instead: dict[str, Any] = {name: make(name) for name in ("zeros", "zeros_like", "empty", "empty_like")}
    instead |= {"launch": launch, "load_module": load, "capture_if": branch, "capture_while": branch}
    instead |= dict.fromkeys(_IDLING, _IDLE)
    with patch.multiple(wp, **instead):
        yield kernels
