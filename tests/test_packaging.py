"""The wheel holds the kernels and the scenes, where the package looks for them."""

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_every_package_is_in_the_list_of_those_installed():
    """An editable installation finds the others too, so that only a wheel would lack them."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    roots = [ROOT / "msdwarp", ROOT / "kernels", ROOT / "scenes"]
    there = {path.parent for root in roots for path in root.rglob("__init__.py")}  # does not follow links
    names = {".".join(path.relative_to(ROOT).parts) for path in there}
    assert set(listed) == {name if name.startswith("msdwarp") else f"msdwarp.{name}" for name in names}


@pytest.mark.slow
def test_the_wheel_can_be_imported_without_the_sources(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, ROOT],
        check=True,
        capture_output=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path / "site")
    assert not [name for name in names if name.startswith(("kernels", "scenes", "tests"))]
    assert "msdwarp/py.typed" in names
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import msdwarp.kernels.forces, msdwarp.scenes.cube\n"
        "print(msdwarp.kernels.forces.__file__, msdwarp.scenes.cube.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "site"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout.count(str(tmp_path / "site")) == 2
