"""What is installed holds kernels and scenes where the package looks for them; versions and checks agree."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

import msdwarp

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PACKAGES = ("msdwarp", "kernels", "scenes")
LINKS = ("kernels", "scenes")
"""In msdwarp/, to the folders at the top."""
OURS = {"dev", "docs", "peers"}
"""Extras for those who work on msdwarp itself."""
DEPENDENCIES = Path(np.__file__).parents[1]


def test_one_extra_has_all_that_users_may_want_and_messages_name_extras_that_exist():
    extras = PROJECT["optional-dependencies"]
    (whole,) = extras["all"]
    assert set(whole.removeprefix("msdwarp[").removesuffix("]").split(",")) == extras.keys() - OURS - {"all"}
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "msdwarp").rglob("*.py")]
    text = "".join(path.read_text(encoding="utf-8") for path in pages)
    assert set(re.findall(r"pip install (?:-e )?'(?:msdwarp|\.)\[(\w+)\]", text)) <= extras.keys()
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in extras.keys() - OURS if f"[{name}]" not in readme] == []
    assert "[fit]" in (ROOT / "docs" / "fitting.md").read_text(encoding="utf-8")


@pytest.fixture
def clone(tmp_path):
    """Return a copy of the sources in a folder that is called as the package is, as clones are."""
    folder = tmp_path / "msdwarp"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def built(folder, *kinds):
    """Return what is built of the sources in a folder, without a network: files of these kinds."""
    program = "import sys, build\nfor kind in sys.argv[2:]:\n build.ProjectBuilder('.').build(kind, sys.argv[1])"
    out = folder.parent / "built"
    subprocess.run([sys.executable, "-c", program, out, *kinds], cwd=folder, check=True, capture_output=True)
    return list(out.iterdir())


def imported(site, folder):
    """Return from where a process that starts in a folder imports kernels and scenes, where `site` is installed.

    Nothing else that is installed by a path file or a finder is heard: the package under test is itself.
    """
    program = (
        "import site, sys; sys.path.append(sys.argv[2]); site.addsitedir(sys.argv[1])\n"
        "import msdwarp.kernels.springs, msdwarp.scenes.cube\n"
        "from msdwarp.cli.scene_files import scene_names\n"
        "assert 'cube' in scene_names(), scene_names()\n"
        "print(msdwarp.__file__, msdwarp.kernels.springs.__file__, msdwarp.scenes.cube.__file__, sep='\\n')"
    )
    words = [sys.executable, "-S", "-c", program, site, DEPENDENCIES]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": ""})
    assert done.returncode == 0, done.stderr
    return [Path(line) for line in done.stdout.splitlines()]


def unpacked(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
        return archive.namelist()


@pytest.mark.slow
def test_the_wheel_holds_every_module_once_and_can_be_imported_without_the_sources(clone, tmp_path):
    (wheel,) = built(clone, "wheel")
    names = unpacked(wheel, tmp_path / "site")
    files = [path.relative_to(ROOT).as_posix() for name in PACKAGES for path in (ROOT / name).rglob("*.py")]
    there = {one if one.startswith("msdwarp") else f"msdwarp/{one}" for one in files}  # links are not followed
    inside = [name for name in names if ".dist-info/" not in name]
    assert sorted(inside) == sorted(there | {"msdwarp/py.typed"})
    assert all(path.is_relative_to(tmp_path / "site") for path in imported(tmp_path / "site", tmp_path))


# Git on Windows writes links as text files, where it is not allowed to make any.
@pytest.mark.slow
@pytest.mark.parametrize("links", ["links", "text files"])
def test_an_editable_clone_is_imported_from_the_folder_that_contains_it(clone, tmp_path, links):
    for name in LINKS if links != "links" else ():
        (clone / "msdwarp" / name).unlink()
        (clone / "msdwarp" / name).write_text(f"../{name}")
    (wheel,) = built(clone, "editable")
    unpacked(wheel, tmp_path / "site")
    # However the links are missing, from within the clone it is imported alike.
    for folder in (tmp_path, clone, clone / "scenes") if links == "links" else (tmp_path,):
        paths = [path.resolve() for path in imported(tmp_path / "site", folder)]
        wanted = ["msdwarp/__init__.py", "kernels/springs/__init__.py", "scenes/cube.py"]
        assert paths == [clone / one for one in wanted]


@pytest.mark.slow
def test_a_wheel_can_be_built_from_the_source_archive_and_from_text_files_in_place_of_links(clone, tmp_path):
    (first,) = built(clone, "wheel")
    wanted = sorted(zipfile.ZipFile(first).namelist())
    for name in LINKS:
        (clone / "msdwarp" / name).unlink()
        (clone / "msdwarp" / name).write_text(f"../{name}")
    first.unlink()
    (archive,) = built(clone, "sdist")
    shutil.unpack_archive(archive, tmp_path / "unpacked", filter="data")
    for folder in (clone, *(tmp_path / "unpacked").iterdir()):
        wheel = next(path for path in built(folder, "wheel") if path.suffix == ".whl")
        assert sorted(zipfile.ZipFile(wheel).namelist()) == wanted


def loaded(name):
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_version_is_the_same_everywhere():
    citation = re.search(
        r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert msdwarp.__version__ == PROJECT["version"] == citation[1]


def test_ruff_before_a_commit_is_the_one_of_the_checks():
    (wanted,) = [one for one in PROJECT["optional-dependencies"]["dev"] if one.startswith("ruff")]
    hooks = [hook for repo in loaded(".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]]
    assert [hook["id"] for hook in hooks] == ["ruff-check", "ruff-format"]
    assert all(hook["additional_dependencies"] == [wanted] for hook in hooks)


def test_the_workflow_runs_the_checks():
    jobs = loaded(".github/workflows/ci.yml")["jobs"]
    runs = {name: [step.get("run", "") for step in job["steps"]] for name, job in jobs.items()}
    assert runs.keys() == {"all", "quick", "lowest"}
    assert ".ci/run" in runs["all"]
    for name in ("quick", "lowest"):
        assert any("pytest" in run and "not slow" in run for run in runs[name])
    assert any("--resolution lowest-direct" in run for run in runs["lowest"])
    assert any("--cov-fail-under" in run for run in runs["lowest"])
    lowest = PROJECT["requires-python"].removeprefix(">=")
    assert lowest in jobs["all"]["strategy"]["matrix"]["python"]
