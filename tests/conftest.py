"""Fixtures that every test may use."""

import contextlib
import gc
import os
import signal
import sys
import warnings
from collections.abc import Generator, Iterable, Iterator
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

if sys.dont_write_bytecode:
    # As many containers want it. Each of some hundred processes that tests start would compile the package again,
    # which takes longer than most of them run: compiled modules are kept, but not among the sources.
    sys.dont_write_bytecode, sys.pycache_prefix = False, str(Path(__file__).parents[1] / ".pytest_cache/bytecode")
    del os.environ["PYTHONDONTWRITEBYTECODE"]
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix

# Tests run side by side already: several threads for each core would wait for each other, those of NumPy too.
os.environ.setdefault("MSDWARP_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# JAX would take three quarters of a GPU's memory for itself, and leave none to tests beside it.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

import pytest
import warp as wp
from routes import preferring

from msdwarp.engine.model.algorithm_choice import FORCE_ALGORITHMS
from msdwarp.runtime import start_warp

# Signals act as in a terminal, whatever was inherited: SIGINT is ignored in a script's background.
USUAL = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL, "SIGHUP": signal.SIG_DFL}
for name, usual in USUAL.items():
    if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) == signal.SIG_IGN:
        signal.signal(getattr(signal, name), usual)
wp.config.log_level = wp.LOG_ERROR
start_warp()
GPU_ROUTES = FORCE_ALGORITHMS if wp.is_cuda_available() else ()
"""By which a GPU is tested; where there is none, thousands of tests need not even be collected."""
# What these assert is told as what tests assert is.
pytest.register_assert_rewrite(
    "collisions", "courses", "pages", "problems", "runs", "stencils", "surfaces", "tangles", "trajectories"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that has every test done in full."""
    told = "by each algorithm, with all combinations of what a test is given"
    parser.addoption("--every-route", action="store_true", help=told)


def pytest_report_header() -> str | None:
    """Say what is left out."""
    start_warp()
    return None if wp.is_cuda_available() else "there is no CUDA device here: tests marked gpu are left out"


@pytest.hookimpl(wrapper=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Have one process more than there are cores: a tenth of the time tests wait for disks, browsers, commands."""
    return (yield) + 1


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Leave collected tests out of all later searches for garbage: there are thousands, and they stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)  # before anything shuffles them
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what needs a GPU where there is none, and what is done by algorithms that are not chosen there.

    That algorithms agree is tested by `test_routes_agree.py` and `test_forces_by_route.py`. Of a product of three
    or more parameters, tests that have all pairs of values are left; of one marked `each_value`, a few that have
    all values. Of what is left of any product, a few that have all values are quick.
    """
    start_warp()
    gpu, full = wp.is_cuda_available(), config.getoption("--every-route")
    without = {name for name, there in (("gpu", gpu), ("other_route", full)) if not there}
    kept = [item for item in items if not without & {mark.name for mark in item.iter_markers()}]
    if not full:
        left_out = set()
        for tests in _products(kept):
            left_out |= set(tests) - _covering(tests, 1 if tests[0].get_closest_marker("each_value") else 2)
        kept = [item for item in kept if item not in left_out]
    there = set(kept)
    left = [item for item in items if item not in there]
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = kept
    for tests in _products(item for item in items if not item.get_closest_marker("slow")):
        if len(_values(tests[0])) > 1:
            quick = _covering(tests)
            for test in tests:
                if test not in quick:
                    test.add_marker(pytest.mark.slow)


def _products(items: Iterable[pytest.Item]) -> list[list[pytest.Item]]:
    """Return lists of tests that differ only in what `parametrize` gives them: their device is the same."""
    found: dict[tuple, list[pytest.Item]] = {}
    for item in items:
        if hasattr(item, "callspec"):
            given = {name for mark in item.iter_markers("parametrize") for name in _names(mark)}
            params = item.callspec.params  # type: ignore[attr-defined]
            rest = ((name, str(value)) for name, value in params.items() if name not in given)
            found.setdefault((item.function, *rest), []).append(item)  # type: ignore[attr-defined]
    return list(found.values())


def _covering(tests: list[pytest.Item], size: int = 1) -> set[pytest.Item]:
    """Return a few of the tests of a product that have each value of each parameter, or each pair of values.

    Those of fewer parameters than `size` are all returned.
    """
    of_each = {test: set(combinations(sorted(_values(test).items()), size)) for test in tests}
    if not all(of_each.values()):
        return set(tests)
    left, chosen = set().union(*of_each.values()), set()
    while left:  # the test that has most of the values that none has yet
        best = max(tests, key=lambda test: len(left & of_each[test]))
        chosen.add(best)
        left -= of_each[best]
    return chosen


def _values(test: pytest.Item) -> dict[str, tuple[int, ...]]:
    """Return the value of each parameter by name, as numbers that tell values apart.

    Names that are given values together, as in parametrize(("a", "b"), ...), count as one, by its first name.
    """
    together = [_names(mark) for mark in test.iter_markers("parametrize")]
    given = test.callspec.params  # type: ignore[attr-defined]
    return {names[0]: tuple(id(given[name]) for name in names) for names in together}


def _names(mark: pytest.Mark) -> list[str]:
    """Return the names that a mark `parametrize` gives values."""
    names = mark.args[0]
    return [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)


@pytest.fixture(params=["cpu", *(pytest.param("cuda:0", marks=pytest.mark.gpu) for _ in GPU_ROUTES[:1])])
def plain_device(request: pytest.FixtureRequest) -> str:
    """Each device in turn, for tests that choose algorithms themselves."""
    return request.param


@pytest.fixture(autouse=True)
def not_in_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is printed goes to no terminal, though FORCE_COLOR, set on many servers, has Rich draw as in one."""
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(autouse=True)
def own_key(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The key that seals scripts is one of the tests, not the user's."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state"))


@pytest.fixture(
    params=[
        "cpu",  # by the algorithm that is chosen there, which scatters; on a GPU it depends on the body
        *(pytest.param(f"cpu {name}", marks=pytest.mark.other_route) for name in ("gather", "stencil")),
        *(pytest.param("cuda:0", marks=pytest.mark.gpu) for _ in GPU_ROUTES[:1]),
        *(pytest.param(f"cuda:0 {name}", marks=[pytest.mark.gpu, pytest.mark.other_route]) for name in GPU_ROUTES),
    ]
)
def device(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each device in turn, by the algorithm that is chosen there; with `--every-route` by each."""
    name, *force_algorithm = request.param.split()
    with preferring(*force_algorithm) if force_algorithm else contextlib.nullcontext():
        yield name


@pytest.fixture
def in_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Advance lattices that have layers in columns, as on a GPU, however small they are."""
    from msdwarp.engine.model.model import Model
    from msdwarp.engine.stepping import per_stage

    def choose(model: Model, columns=per_stage.columns) -> int:
        gpu = SimpleNamespace(is_cuda=True)
        return columns(SimpleNamespace(lattice=model.lattice, particle_count=model.particle_count, device=gpu))

    monkeypatch.setattr(per_stage, "LEAST_IN_COLUMNS", 0)
    monkeypatch.setattr(per_stage, "columns", choose)


@pytest.fixture
def vtk_output():
    """What VTK says, which is nothing if all is well."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    yield window
    vtkOutputWindow.SetInstance(before)


@pytest.fixture
def msdwarp(tmp_path, monkeypatch, capsys):
    """Run the command in an empty folder; return (exit code, standard output, standard error).

    That kernels are compiled and how far it has come is left out: it depends on what ran before, and on the load.
    """
    from msdwarp.cli import process
    from msdwarp.cli.app import app
    from msdwarp.cli.entry_points import finish
    from msdwarp.cli.process import COMPILING

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(process, "TELL_EVERY", 1e6)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["msdwarp", *arguments])
        with pytest.raises(SystemExit) as stop:
            finish(lambda: app(sys.argv[1:]))
        out, err = capsys.readouterr()
        return stop.value.code, out, err.replace(f"{COMPILING}\n", "")

    # The command has handlers of its own to the end of its process, which here goes on with other tests.
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    yield run
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def heard():
    """Signals act as in a terminal, and so they do after a test that changes their handlers."""
    default = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in default.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def own(tmp_path):
    """The script of a scene."""
    from runs import SCENE

    path = tmp_path / "own.py"
    path.write_text(SCENE)
    return path
