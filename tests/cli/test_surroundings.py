"""What surrounds the command: terminals, streams, encodings, warnings, other runs, and what it imports."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from msdwarp.cli.process import COMPILING
from msdwarp.cli.results import own_folder
from msdwarp.disk import alone_in

ROOT = Path(__file__).parents[2]
UNDRAWN = ["--frames", "none", "--video", "none", "--device", "cpu", "--duration", "0.05", "--size", "3"]
posix = pytest.mark.skipif(os.name != "posix", reason="needs a POSIX system")


def command(folder, *arguments, env=(), **options):
    """Run the command in a process of its own."""
    words = [sys.executable, "-P", "-m", "msdwarp", *arguments]
    env = {**os.environ, "PYTHONPATH": str(ROOT), **dict(env)}
    return subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, timeout=600, **options)


@pytest.mark.slow
def test_the_narrowest_terminal_shows_help(tmp_path):
    done = command(tmp_path, "run", "cube", "--help", env={"COLUMNS": "1"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "--size" in done.stdout


@pytest.mark.slow
def test_an_encoding_without_a_unit_fails_nothing(tmp_path):
    done = command(tmp_path, "plot", "--help", env={"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "m/s\\xb2" in done.stdout


@pytest.mark.slow
@posix
def test_no_file_takes_the_number_of_a_closed_stream(tmp_path):
    (tmp_path / "own.py").write_text(
        "import os\nfrom msdwarp import Scene, box\n"
        "def build(*, size: int = 2):\n"
        "    null = os.stat(os.devnull)\n"
        "    assert os.path.samestat(os.fstat(2), null)\n"
        "    return Scene(system=box((size, 2, 2), 0.1))\n"
    )
    done = command(tmp_path, "run", "own.py", *UNDRAWN, preexec_fn=lambda: os.close(2))
    assert done.returncode == 0
    assert "wrote out/own/trajectory.vtkhdf" in done.stdout
    done = command(tmp_path, "run", "own.py", "--size", "0", preexec_fn=lambda: os.close(2))
    assert done.returncode == 1
    assert done.stdout.startswith("error: ")  # said where somebody listens


@pytest.mark.slow
@posix
def test_runs_that_begin_at_once_each_take_a_folder(msdwarp, tmp_path):
    (tmp_path / "out" / "cube").mkdir(parents=True)
    with alone_in(tmp_path / "out" / "cube"):  # another run has taken it, and has nothing in it yet
        code, out, _ = msdwarp("run", "cube", *UNDRAWN)
        assert (code, "wrote out/cube-2/trajectory.vtkhdf" in out) == (0, True)
        with own_folder("cube", None, False) as one, own_folder("cube", None, False) as other:
            assert (one.name, other.name) == ("cube-3", "cube-4")
        assert "another run is writing in out/cube" in msdwarp("run", "cube", "--out", "out/cube", *UNDRAWN)[2]


LIMIT = "import resource; resource.setrlimit(resource.RLIMIT_AS, ({} << 28, resource.RLIM_INFINITY))"


@pytest.mark.slow
@posix
@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("import os; os.mkdir('a'); os.chdir('a'); os.rmdir('../a')", "the working directory no longer exists"),
        (
            LIMIT.format(4) + "; import numpy; " + LIMIT.format(1),
            r"the address space is limited to 0.268 GB \(ulimit -v\), perhaps too little: .",
        ),
    ],
)
def test_a_process_without_room_or_place_says_so_in_a_line(tmp_path, before, said):
    command = f"{before}; from msdwarp.cli import main; main()"
    words = ["run", "chain", "--duration", "0.1", "--frames", "none", "--video", "none", "--device", "cpu"]
    done = subprocess.run([sys.executable, "-c", command, *words], capture_output=True, text=True, cwd=tmp_path)
    (only,) = (line for line in done.stderr.splitlines() if line != COMPILING)
    assert (done.returncode, bool(re.match(f"error: {said}", only))) == (1, True), done.stderr


INSIDE = """
from msdwarp import Plane, Scene, box
from msdwarp.cli import scene_main

def build(*, size: int = 3) -> Scene:
    body = box((size, size, size), 0.1, mass=0.02, stiffness=200.0, damping=1.0).translate((0, 0, -0.1))
    return Scene(system=body, colliders=[Plane()], duration=0.02)

if __name__ == "__main__":
    scene_main(build)
"""


@pytest.mark.slow
def test_a_warning_is_a_line_without_a_path(tmp_path):
    (tmp_path / "inside.py").write_text(INSIDE)
    flags = ["--frames", "none", "--video", "none", "--trajectory", "none", "--device", "cpu", "--quiet"]
    done = subprocess.run(
        [sys.executable, "inside.py", *flags], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    (warned,) = done.stderr.splitlines()
    assert warned.startswith("warning: particle ")
    assert "starts 0.2 m inside" in warned
    assert ".py:" not in warned


CRUSH = """
from msdwarp import Contact, Material, Scene, box

def build() -> Scene:
    soft = {"youngs_modulus": 2e5, "damping_ratio": 0.1}
    brick = box((3, 3, 3), 0.05, material=Material(density=400.0, **soft))
    heavy = box((4, 4, 4), 0.05, material=Material(density=3000.0, **soft)).rotate(0.5, (1, 0.3, 0.2))
    system = heavy.translate((-0.2, 0, 0)).with_velocity((SPEED, 0, 0)) + brick
    for k in range(1, 4):
        system = system + brick.rotate(0.3 * k, (1, 0, 0)).translate((0.101 * k, 0, 0))
    return Scene(system=system, contact=Contact(), gravity=0.0, duration=0.05)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "told"), [(32.0, True), (2.0, False)])  # their speed of sound is 22 m/s
def test_a_run_says_that_contact_held_particles_back(msdwarp, tmp_path, speed, told):
    (tmp_path / "crush.py").write_text(CRUSH.replace("SPEED", str(speed)))
    flags = ["--frames", "none", "--video", "none", "--trajectory", "none", "--device", "cpu"]
    code, out, _ = msdwarp("run", "crush.py", *flags)
    assert code == 0
    assert ("contact held particles back, at about 0.0" in out) == told


LARGE = """
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
        [sys.executable, "-c", LARGE, *words.split()], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout.splitlines()[-1].split()[1:] == needed
    assert done.returncode == (0 if "help" in words or words in ("list", "--version") else 1)
