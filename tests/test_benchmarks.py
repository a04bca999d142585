"""The benchmarks: every script can be imported, stands in their README, and is called by its name everywhere."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [path for path in sorted((ROOT / "benchmarks").rglob("*.py")) if path.name != "__init__.py"]
MODULES = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in FILES]
PAGES = [ROOT / "README.md", ROOT / "benchmarks" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("name", MODULES)
def test_it_can_be_imported(name, monkeypatch):
    pytest.importorskip("scipy")
    monkeypatch.syspath_prepend(ROOT)
    assert importlib.import_module(name).__doc__


def test_the_readme_names_every_file():
    readme = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    commands = set(re.findall(r"`python -m ([\w.]+)`", readme))
    for path, name in zip(FILES, MODULES, strict=True):
        runs = '__name__ == "__main__"' in path.read_text(encoding="utf-8")
        assert name in commands if runs else f"`{path.name}`" in readme, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_in_the_documentation_name_scripts(page):
    named = re.findall(r"python3? -m (benchmarks[\w.]*)", page.read_text(encoding="utf-8"))
    assert set(named) <= set(MODULES)
    assert not re.search(r"python3? benchmarks/", page.read_text(encoding="utf-8"))
