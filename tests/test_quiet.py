"""What a user's script hears of Warp: nothing, unless it asks, and all that is a warning or an error."""

import subprocess
import sys

import pytest

STEP = "msd.Simulation(msd.box((2, 2, 2)), device='cpu').step()\n"
START = "from msdwarp.runtime import start_warp\nstart_warp()\n"  # the part that Warp speaks in
GREETING = "Warp 1."


def said(code, **options):
    """Return what a script writes to standard output and standard error."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120, **options)
    return done.stdout, done.stderr


@pytest.mark.slow
def test_a_script_hears_nothing():
    mesh = "import pyvista as pv\nmsd.from_mesh(pv.Cube(), 0.5)\n"  # which starts Warp before a simulation does
    assert said("import msdwarp as msd\n" + STEP) == ("", "")
    assert said("import msdwarp as msd\n" + mesh + STEP) == ("", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "msd.verbose()"),
        ("wp.config.log_level = wp.LOG_DEBUG", "msd.verbose()\nassert wp.config.log_level == wp.LOG_DEBUG"),
    ],
)
def test_who_asks_hears_warp(before, after):
    out, _ = said(f"import warp as wp\n{before}\nimport msdwarp as msd\n{after}\n{STEP}")
    assert GREETING in out
    assert "load on device 'cpu'" in out


@pytest.mark.slow
def test_warp_may_be_imported_later():
    # Importing msdwarp leaves Warp alone until it is needed; who imports Warp in between finds it turned down.
    code = "import msdwarp as msd\nimport warp as wp\nassert wp.config.log_level == wp.LOG_WARNING\n"
    assert said(code + STEP) == ("", "")
    assert GREETING in said(code + "wp.config.log_level = wp.LOG_INFO\n" + STEP)[0]
    looked_for = "import importlib.util, msdwarp as msd\nassert importlib.util.find_spec('warp')\n"
    assert said(looked_for + START) == ("", "")


@pytest.mark.slow
def test_what_was_asked_for_can_be_taken_back_and_less_is_respected():
    assert said("import msdwarp as msd\nmsd.verbose()\nmsd.verbose(False)\n" + STEP) == ("", "")
    code = "import warp as wp\nwp.config.log_level = wp.LOG_ERROR\nimport msdwarp as msd\n"
    assert said(code + "msd.verbose(False)\nprint(wp.config.log_level == wp.LOG_ERROR)\n" + STEP) == ("True\n", "")


def test_importing_does_not_start_warp():
    assert said("import msdwarp\nimport warp._src.context as c\nprint(c.runtime)") == ("None\n", "")


# What else is said while Warp starts, by C++ or other threads, comes through.
OTHERS = """
import os, sys, threading, warp as wp
import msdwarp as msd
init = wp.init
def loud():
    os.write(2, b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver. GPU\\n")
    os.write(2, b"Warp CUDA error: real\\n")
    thread = threading.Thread(target=lambda: print("from a thread", file=sys.stderr))
    thread.start()
    thread.join()
    init()
    wp._src.logger.log_warning("of Warp's own")
wp.init = loud
"""


@pytest.mark.slow
def test_errors_and_what_other_threads_say_are_passed_on():
    out, err = said(OTHERS + START)
    assert out == ""
    assert err == "Warp CUDA error: real\nfrom a thread\nWarp UserWarning: of Warp's own\n"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell's redirection")
@pytest.mark.parametrize("state", ["", "os.close(2)", "sys.stderr = None", "sys.stderr.close()"])
def test_it_is_safe_where_standard_error_is_closed_or_replaced(state, tmp_path):
    code = f"import io, os, sys, msdwarp as msd\n{state}\n{START if state else STEP}print('done')\n"
    assert said(code)[0] == "done\n"
    closed = ["sh", "-c", 'exec "$0" "$@" 2>&-', sys.executable, "-c", code]
    if not state:
        done = subprocess.run(closed, stdout=subprocess.PIPE, text=True, check=True, timeout=120)
        assert done.stdout == "done\n"


@pytest.mark.slow
def test_threads_that_start_it_together_leave_standard_error_as_it_was():
    code = """
import os, sys, threading
from msdwarp.runtime import find_device
before, seen = os.fstat(2), []
threads = [threading.Thread(target=lambda: seen.append(find_device("cpu"))) for _ in range(8)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert len(seen) == 8 and os.fstat(2).st_ino == before.st_ino
print("still heard", file=sys.stderr)
"""
    assert said(code) == ("", "still heard\n")
