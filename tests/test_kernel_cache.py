"""Compiled kernels are kept; where they cannot be, one line says so, and names the variable that helps."""

import os
import re
import subprocess
import sys

import pytest

from msdwarp.cli.process import COMPILING

STEP = "import msdwarp as msd; msd.Simulation(msd.chain(3), device='cpu').step()"
LIMITED = (  # as a full disk: nothing larger than 16 KB can be written
    "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    "resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 14, 1 << 14)); "
    "import warp; warp.config.use_precompiled_headers = False; "  # which pay from the second kernel on
)
RUN = "from msdwarp.cli import main; main()"
SAID = r"compiled kernels cannot be written to .*: .*; .*WARP_CACHE_PATH must name a folder with room"
pytestmark = pytest.mark.slow


def run(program, *words, code=1, **environment):
    environment = os.environ | {name: str(value) for name, value in environment.items()}
    command = [sys.executable, "-c", program, *words]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == code
    return done.stderr.splitlines()


def test_a_second_run_compiles_nothing_but_what_was_damaged(tmp_path):
    # Bodies whose kernels share functions: once a kernel was compiled, others of the same process had other names.
    program = (
        "import msdwarp as msd\n"
        "for algorithm in ('gather', 'stencil'):\n"
        "    msd.Simulation(msd.box((3, 3, 3)), device='cpu', force_algorithm=algorithm).step(2)\n"
    )
    run(program, code=0, WARP_CACHE_PATH=tmp_path)
    whole = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*.o"))}
    times = {path: path.stat().st_mtime_ns for path in whole}
    # As of a full disk; of a lost one, where a file has its length but ends in zeros; and without kernels' names.
    (first, a), (second, b), (third, _), *_ = whole.items()
    first.write_bytes(a[: len(a) // 2])
    second.write_bytes(b[: 2 * len(b) // 3].ljust(len(b), b"\0"))
    for path in third.parent.glob("*.meta"):
        path.write_bytes(b"")
    run(program, code=0, WARP_CACHE_PATH=tmp_path)
    assert all(path.stat().st_size for path in tmp_path.rglob("*.meta"))
    now = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")}
    assert {path for path in now if now[path] != times[path]} == {first, second, third}
    run(program, code=0, WARP_CACHE_PATH=tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")} == now


def test_what_is_compiled_is_told_once_and_in_the_summary(tmp_path):
    words = [
        "run",
        "chain",
        "--frames",
        "none",
        "--video",
        "none",
        "--duration",
        "0.1",
        "--out",
        str(tmp_path / "o"),
    ]
    program = [sys.executable, "-c", RUN, *words]
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    for again in (False, True):
        command = [*program, "--force"] if again else program
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
        assert done.stderr.splitlines().count(COMPILING) == (not again)
        summed_up = re.search(r"^simulated .*; compiled \d+ kernels in [\d.]+ s$", done.stdout, re.MULTILINE)
        assert bool(summed_up) != again


@pytest.fixture
def nowhere(tmp_path):
    """Return what stands for a home that cannot be written to, for root either."""
    (tmp_path / "file").touch()
    home = tmp_path / "file" / "home"
    return {"HOME": home, "XDG_CACHE_HOME": home, "LOCALAPPDATA": home, "WARP_CACHE_PATH": home}


def test_a_home_that_cannot_be_written_is_told(nowhere):
    assert re.match(rf"OSError: {SAID}", run(STEP, **nowhere)[-1])
    (only,) = run(RUN, "run", "cube", "--frames", "none", "--video", "none", **nowhere)
    assert re.match(rf"error: {SAID}", only)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such limits")
def test_a_cache_on_a_full_disk_is_told(tmp_path):
    assert re.match(rf"OSError: {SAID}", run(LIMITED + STEP, WARP_CACHE_PATH=tmp_path)[-1])
    words = ["run", "chain", "--frames", "none", "--video", "none", "--out", str(tmp_path / "out")]
    said = run(LIMITED + RUN, *words, WARP_CACHE_PATH=tmp_path)
    assert re.match(rf"error: {SAID}", said[-1])
    assert not any("Traceback" in line for line in said)
