"""The benchmarks: every script can be imported, stands in their README, and is called by its name everywhere.

Four of the textbook experiments of docs/validation.md are repeated, smaller.
"""

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


@pytest.fixture
def textbook(monkeypatch):
    pytest.importorskip("scipy")
    monkeypatch.syspath_prepend(Path(__file__).parents[1])
    return importlib.import_module("benchmarks.accuracy.validation").EXPERIMENTS


def test_the_lower_end_of_a_slinky_waits_for_the_wave(textbook):
    top, arrives = textbook["slinky drop"]("cpu", count=60).quantities
    # The front of a wave in N springs is as wide as N^(1/3) springs; straight lines are fitted clear of it.
    assert top.deviation == pytest.approx(0, abs=1e-4)
    assert arrives.deviation == pytest.approx(0, abs=5e-3)


def test_a_rope_hangs_as_an_elastic_catenary(textbook):
    for one in textbook["catenary"]("cpu", count=40).quantities:
        assert one.deviation == pytest.approx(0, abs=1 / 40**2)  # second order in the spacing


def test_an_elastic_pendulum_swings_as_its_equations_say(textbook):
    (place,) = textbook["elastic pendulum"]("cpu").quantities
    assert place.measured == pytest.approx(place.exact, abs=1e-9)  # RK4 with (h ω)⁴ of 4e-7 a second at most


def test_a_stiff_body_flips_about_its_middle_axis(textbook):
    (flip,) = textbook["Dzhanibekov"]("cpu").quantities
    # Its arms stretch by m ω² l/k, 4e-5 of their length; flips are interpolated between frames of 5 ms.
    assert flip.deviation == pytest.approx(0, abs=1e-4)
