"""The command tells what it knows without a simulation before it imports what only a simulation needs."""

import subprocess
import sys

import pytest

CODE = """
import sys
from msdwarp.cli import main

sys.argv[0] = "msdwarp"
try:
    main()
finally:
    large = ("warp", "numpy", "pyvista", "h5py", "scipy", "matplotlib", "PIL")
    print("imported:", *(name for name in large if name in sys.modules))
"""


@pytest.mark.parametrize(
    ("words", "needed"),
    [
        ("--help", []),
        ("list", []),
        ("runn cube", []),
        pytest.param("run no-scene", [], marks=pytest.mark.slow),
        pytest.param("export a.vtkhdf --to jpg", [], marks=pytest.mark.slow),
        ("run cube --help", ["numpy"]),  # which the scene's own annotations ask for
        pytest.param("view cube --help", ["numpy"], marks=pytest.mark.slow),
        pytest.param("tune cube --help", ["numpy"], marks=pytest.mark.slow),
        pytest.param("run cube --fps many", ["numpy"], marks=pytest.mark.slow),
    ],
)
def test_help_and_errors_need_nothing_large(words, needed):
    done = subprocess.run(
        [sys.executable, "-c", CODE, *words.split()], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout.splitlines()[-1].split()[1:] == needed
    assert done.returncode == (0 if "help" in words or words in ("list", "--version") else 1)
