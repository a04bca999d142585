"""A view with a page, for all tests that open one, and a clock for those that wait for what is simulated."""

import sys

import pytest


@pytest.fixture
def view():
    """A view that runs in a thread of its own, and whose page clients may open."""
    pytest.importorskip("viser")
    from pages import served

    made = served()
    yield made
    made.close()


class Clock:
    """Time that passes while views sleep, and where a test says so, however long the machine takes."""

    now = 0.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    """Have views go by a clock of their own."""
    import msdwarp.live  # noqa: F401

    clock = Clock()
    for module in ("view", "state"):
        monkeypatch.setattr(sys.modules[f"msdwarp.live.{module}"], "time", clock)
    return clock
