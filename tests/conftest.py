"""Fixtures that every test may use."""

import contextlib
import signal
import sys
from collections.abc import Iterator

import pytest
import warp as wp

from msdwarp.engine import routes

wp.config.log_level = wp.LOG_ERROR
# What these assert is told as what tests assert is.
pytest.register_assert_rewrite("collisions", "courses", "runs", "stencils", "surfaces", "tangles", "trajectories")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a GPU where there is none."""
    if item.get_closest_marker("gpu") and not wp.is_cuda_available():
        pytest.skip("there is no CUDA device here")


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def plain_device(request: pytest.FixtureRequest) -> str:
    """Each device in turn, for tests that choose routes themselves."""
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
        "cpu",  # by the route that is chosen there, which scatters
        *(pytest.param(f"cpu {route}", marks=pytest.mark.slow) for route in ("gather", "stencil")),
        *(pytest.param(f"cuda:0 {route}", marks=pytest.mark.gpu) for route in routes.ROUTES),
    ]
)
def device(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each device in turn, by each route to the forces."""
    name, *route = request.param.split()
    with routes.preferring(*route) if route else contextlib.nullcontext():
        yield name


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
    """Run the command in an empty folder; return (exit code, standard output, standard error)."""
    from msdwarp.cli import app as cli

    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["msdwarp", *arguments])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return stop.value.code, *capsys.readouterr()

    # The command has handlers of its own to the end of its process, which here goes on with other tests.
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    yield run
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def heard():
    """Signals act as in a terminal, whatever the tests inherited: SIGINT is ignored in a script's background."""
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
