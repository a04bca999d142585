"""The README and the pages in docs: their Python runs, their commands, flags, names and paths exist."""

import csv
import inspect
import math
import re
import runpy
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import msdwarp
from msdwarp.cli.app import app
from msdwarp.cli.options import FitOptions, ModesOptions, Options, SweepOptions, TuneOptions, ViewOptions
from msdwarp.cli.scene_files import find_scene, scene_names

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
OF_EVERY_SCENE = {
    "run": Options,
    "sweep": SweepOptions,
    "view": ViewOptions,
    "tune": TuneOptions,
    "modes": ModesOptions,
    "fit": FitOptions,
}


def snippets(page: str) -> list[str]:
    """Return the pieces of Python on a page."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)


def run(page: str, pieces: list[str] | None = None) -> dict:
    """Run the Python on a page, piece after piece, and return its names."""
    names: dict = {"__name__": "page"}
    for piece in snippets(page) if pieces is None else pieces:
        exec(compile(piece, page, "exec"), names)
    return names


def test_the_example_runs_and_is_short(tmp_path, monkeypatch, capsys):
    (example,) = snippets("README.md")
    lines = [line for line in example.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 20
    monkeypatch.chdir(tmp_path)
    run("README.md")
    assert "substeps a frame" in capsys.readouterr().out
    assert np.asarray(Image.open(tmp_path / "block.png")).std() > 5  # not blank


@pytest.mark.slow
def test_the_first_ten_minutes_come_out_as_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run("docs/start.md")
    for picture in ("block.png", "energy.png"):
        assert np.asarray(Image.open(picture)).std() > 5, picture  # not blank
    before, after = names["energies"][0], names["energies"][-1]
    assert after < 0.5 * before  # it has come to rest lower than it began
    said = re.findall(r"bounces to ([\d.]+) m", capsys.readouterr().out)
    assert sorted(said, reverse=True) == said  # the more damping, the lower
    assert len(said) == 3


@pytest.mark.slow
def test_the_recipes_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pieces = "\0".join(snippets("docs/howto.md"))  # of several cases only those of which more is said below
    for cases, last in {"(0.005, 0.015, 0.025)": "(0.025,)", "(1.0, 8.0)": "(8.0,)"}.items():
        assert pieces.count(cases) == 1, cases
        pieces = pieces.replace(cases, last)
    names = run("docs/howto.md", pieces.split("\0"))
    printed = capsys.readouterr().out
    assert "largest contact force" in printed
    dented = names["dented"]
    assert 0.25 < dented.position[:, 2].max() < 0.38  # the press came down to 0.3 m
    assert (dented.rest_length != dented.original_length).mean() > 0.05
    assert names["fallen"].shape == (31,)
    assert names["broken"] > 5
    assert names["height"] < -0.5  # the second ball has torn the net, and is below it
    # Finite elements give 1.17 times Hertz's law at this depth, and 8 cells across are right to 6 % there.
    assert -names["force"][2] / names["hertz"] == pytest.approx(1.173, rel=0.06)
    # Coulomb's law needs a friction of 0.0117 for this grip: of 0.8, 0.0125 and 0.011 the last is too little.
    lifts = [float(one) for one in re.findall(r"lifted by (-?[\d.]+) of 80 mm", printed)]
    assert len(lifts) == 3
    assert min(lifts[:2]) > 79
    assert abs(lifts[2]) < 1
    # The strip of voxels crawls steadily, 14 cm a second after the first; nothing in it is chaotic.
    [moved] = re.findall(r"moved by \[m\]: ([\d.]+)", printed)
    assert float(moved) == pytest.approx(0.71, abs=0.03)
    assert names["comb"].particle_count == names["robot"].particle_count + 9  # each cell of the lower row apart
    # Links of 5000 N/m bear the block, and half of the rope's weight on average; settling stops near equilibrium.
    weight, own = 9.82 * names["load"].mass.sum(), 9.82 * names["rope"].mass[1:].sum()
    [longer] = re.findall(r"the rope is longer by \[m\]: ([\d.]+)", printed)
    assert float(longer) == pytest.approx(20 * (weight + own / 2) / 5000, rel=0.02)
    # Stones of 60 mm lie on each other, and have left the tube, in which they were 0.2 m high.
    high, wide = map(float, re.findall(r"half width of the heap \[m\]: ([\d.]+) ([\d.]+)", printed)[0])
    assert 0.06 < high < 0.12
    assert 0.15 < wide < 0.4
    assert names["thick"] > 0.2  # the pillow is blown up
    assert names["wide"] > 0.101  # and the cavity
    assert names["place"][1] > 0.4  # the door is open: its handle is 0.5 m from the hinge
    assert names["place"][2] == pytest.approx(0, abs=1e-3)  # its hinge alone bears it, and there is no gravity
    first, second, third = (names["heights"][k] for k in (18, 48, 60))
    assert first == pytest.approx(second, abs=0.01)  # pinned, while its lower half still swings
    assert third < second - 0.1  # released


@pytest.mark.slow
def test_the_scene_among_the_recipes_is_one(tmp_path, msdwarp):
    (tmp_path / "drop.py").write_text(snippets("docs/howto.md")[0], encoding="utf-8")
    code, _, error = msdwarp(
        "run", "drop.py", "--stiffness", "900", "--duration", "0.1", "--frames", "none", "--video", "none"
    )
    assert code == 0, error


def test_the_example_of_the_live_view_runs(capsys):
    pytest.importorskip("viser")
    run("docs/live.md")
    assert "http://127.0.0.1:" in capsys.readouterr().out


@pytest.mark.slow
def test_the_examples_of_pictures_run(capsys):
    names = run("docs/pictures.md")
    assert capsys.readouterr().out == "(180, 320, 3)\n"
    assert names["image"].std() > 5  # not blank


@pytest.mark.slow
def test_the_examples_of_materials_run(capsys):
    # Functions for Warp are left out, since it reads them from files.
    names = run("docs/materials.md", [piece for piece in snippets("docs/materials.md") if "wp.func" not in piece])
    assert {"1", "2"} == names["arch"].groups.keys()
    assert np.isclose(
        names["filled"].mass.sum(), (12 * 6 * 6 - 12 * 2 * 2) * 0.02**3 * 925 + 12 * 4 * 0.02**3 * 54
    )
    assert names["drum"].pinned.sum() == 48
    capsys.readouterr()


def test_the_speeds_that_the_readme_tells_were_measured():
    page = " ".join(README.split())
    rows = (
        measured("endurance.csv")[::-1] + measured("touching.csv")[::-1]
    )  # of a scene the last counts: as stiff as it is
    speeds = {one["scene"]: float(one["times_real_time"]) for one in rows}
    said = re.findall(r"`(\w+)` \((\d+)(?: particles\) runs|\)) at ([\d.]+)", page)
    assert len(said) == 4
    for scene, particles, times in said:
        assert find_scene(scene).build().system.particle_count == int(particles), scene
        assert f"{speeds[scene]:.2g}" == times, scene
    waits = [one for one in measured("first_frame.csv") if one["version"] == "this"]
    compiled, nothing = ([float(one[name]) for one in waits] for name in ("all_compiled_s", "nothing_compiled_s"))
    assert [round(f(nothing)) for f in (min, max)] == [4, 16]
    assert "after 1 to 2 s" in page
    assert "after 4 to 16 s" in page
    assert min(compiled) > 1
    assert max(compiled) < 2


@pytest.mark.slow
def test_the_example_of_loads_runs(capsys):
    names = run("docs/loads.md")
    assert "work of the loads" in capsys.readouterr().out
    assert names["positions"].shape == (120, 3)


@pytest.mark.slow
def test_the_examples_of_ensembles_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    monkeypatch.chdir(tmp_path)
    script = tmp_path / "worlds.py"  # Warp reads the source of functions from their file
    script.write_text("\n".join(snippets("docs/ensembles.md")), encoding="utf-8")
    names = runpy.run_path(str(script))
    assert "world 2" in capsys.readouterr().out
    assert names["position"].shape == (200, 27, 3)
    assert names["results"].sizes["frame"] == 4
    assert (tmp_path / "worlds.nc").exists()
    assert names["moved"].max() > 0.25  # 0.33 m here; another number of substeps changes that by 1 mm


@pytest.mark.slow
def test_throws_learn_by_gradients(capsys):
    throw, throws = (one for one in snippets("docs/gradients.md") if "def miss" in one and "jax" not in one)
    names = run("docs/gradients.md", ["import numpy as np\nimport msdwarp as msd\n", throw, throws])
    assert names["throw"].fun < 1e-9
    first, *_, last = re.findall(r"\[([^\[\]]*)\]", capsys.readouterr().out)[1:]
    assert (np.array(last.split(), dtype=float) < np.array(first.split(), dtype=float)).all()


@pytest.mark.slow
def test_a_gust_blows_as_far_as_the_page_of_gradients_says(capsys):
    (gust,) = (one for one in snippets("docs/gradients.md") if "def blown" in one)
    run("docs/gradients.md", ["import numpy as np\nimport msdwarp as msd\n", gust])
    told = re.findall(r"[−\d.]+(?= m)", gust.split("#")[-1])
    found = capsys.readouterr().out.split()
    assert [float(one.replace("−", "-")) for one in told] == [float(f"{float(one):.3g}") for one in found]


@pytest.mark.slow
def test_the_example_of_fitting_finds_what_made_the_motion(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found = run("docs/fitting.md")["found"]
    assert "left over" in capsys.readouterr().out
    for name, true in (("stiffness", 200.0), ("damping", 0.2)):
        assert abs(found.values[name] - true) < 3 * found.standard_deviations[name]
    assert found.standard_deviations["stiffness"] < 0.3  # what 0.1 mm of noise leaves
    assert (tmp_path / "residuals.png").exists()


@pytest.mark.slow
def test_the_examples_of_sweeps_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    monkeypatch.chdir(tmp_path)
    first, second = snippets("docs/sweeps.md")[:2]
    script = tmp_path / "throws.py"
    script.write_text(first + second, encoding="utf-8")
    names = runpy.run_path(str(script), run_name="__main__")
    assert (names["results"]["status"] == "done").all()
    assert "strain" in capsys.readouterr().out


def measured(name: str) -> list[dict[str, str]]:
    """Return the rows of a file that a benchmark has written on the CPU."""
    lines = (ROOT / "benchmarks" / "results" / "cpu" / name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def test_numbers_of_contact_are_those_measured():
    page = " ".join((DOCS / "contact.md").read_text(encoding="utf-8").split())
    slopes = measured("contact_friction.csv")
    assert max(float(one["creep"]) for one in slopes if one["slope"] == "hold") < 1.15e-8  # [m/s]
    share = [float(one["acceleration"]) / float(one["coulomb"]) for one in slopes if one["slope"] == "slide"]
    assert f"at most {100 * (1 - min(share)):.2f} % less" in page
    errors = [abs(float(one["error"])) for one in measured("contact_sliding.csv") if one["error"] != "nan"]
    assert f"differs from the given one by at most {math.ceil(1e4 * max(errors)) / 1e4:.4f}" in page
    rolls = {
        (one["ground"], one["restitution"]): f"{float(one['ratio']):.3f}"
        for one in measured("contact_rolling.csv")
    }
    plane = {rolls["plane, surface", e] for e in ("0.05", "0.3")}
    assert f"{plane.pop()} of g sin α/(1 + I/(m r²)), and {rolls['plane, surface', '1']} at e = 1" in page
    assert not plane
    slab = [rolls["pinned slab", e] for e in ("1", "0.3", "0.05")]
    assert "slab it is {} at e = 1, {} at e = 0.3 and {} at e = 0.05".format(*slab) in page
    for name in ("folding", "shots"):
        rows = measured(f"contact_{name}.csv")
        assert all(one["crossing"] == "0" for one in rows)
        assert f"in none of the {sum(int(one['frames']) for one in rows)} frames" in page
    assert all(float(one["height"]) > -1.0 for one in measured("contact_shots.csv"))  # the cloth holds the block


@pytest.mark.slow
def test_the_example_of_contact_rests(capsys):
    names = run("docs/contact.md")
    height = float(capsys.readouterr().out.rsplit(maxsplit=1)[-1])
    assert abs(height - 0.2) < 0.005  # m: within 5 % of the spacing of where both are drawn to touch
    weight = names["scene"].system.mass.sum() * 9.82
    # N: floor and dice exchange what cancels between the dice; at rest the floor bears all of them. They still
    # swing a little, as 5 % of the weight.
    assert names["force"].sum(axis=0)[2] == pytest.approx(weight, rel=0.05)


@pytest.mark.slow
def test_the_examples_of_files_run(tmp_path, monkeypatch, msdwarp):
    monkeypatch.chdir(tmp_path)
    assert msdwarp("run", "cube", "--duration", "0.2", "--frames", "none", "--video", "none")[0] == 0
    pieces = [piece for piece in snippets("docs/files.md") if "paraview" not in piece]  # which is not installed
    names = run("docs/files.md", pieces)
    assert names["path"].shape == (13, 3)  # 0.2 s at 60 frames a second, the start among them
    assert names["position"].shape == (1000, 3)
    assert (tmp_path / "own.vtkhdf").exists()


def test_the_modes_page_finds_a_beam_and_a_drum():
    names = run("docs/modes.md")
    # (1.8751)² √(E I/(ρ A))/(2π L²) with I/A = t²/12. Thin bars of lattices are too stiff (docs/limits.md), this
    # one by 11/(10 n²) at most, with n = 3 cells.
    rubber, thickness, length = names["msd"].RUBBER, 0.06, 0.4
    speed = (rubber.youngs_modulus / rubber.density) ** 0.5
    theory = 1.8751**2 * speed * thickness / 12**0.5 / (2 * np.pi * length**2)
    assert theory < names["found"].frequencies[0] < theory * (1 + 11 / (10 * 3**2)) ** 0.5
    # Zeros of Bessel's functions; 40 cells across, whose rim is a staircase.
    assert names["tones"] / names["tones"][0] == pytest.approx(
        [1, 1.5933, 1.5933, 2.1355, 2.1355, 2.2954], rel=5e-3
    )


@pytest.mark.parametrize("page", sorted({*PAGES, *ROOT.glob("*.md")}), ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    links = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8"))
    assert not [link for link in links if not (page.parent / link).exists()]


def test_the_paper_cites_what_its_bibliography_has():
    paper, entries = ((DOCS / f"paper.{kind}").read_text(encoding="utf-8") for kind in ("md", "bib"))
    assert set(re.findall(r"\[@(\w+)\]", paper)) == set(re.findall(r"^@\w+\{(\w+),", entries, flags=re.MULTILINE))


def test_every_path_of_the_layout_exists():
    (layout,) = re.findall(r"## Layout\n\n```\n(.*?)```", README, flags=re.DOTALL)
    paths = []
    folder = ""
    for line in layout.splitlines():
        for word in re.findall(r"[\w/]+(?:\.py|/)(?=\s|$)", line):
            if not line.startswith(" ") and word.endswith("/"):
                folder = word
                paths.append(word)
            else:
                paths.append(folder + word)
    assert len(paths) > 15
    assert not [path for path in paths if not (ROOT / path).exists()]


def test_every_page_has_a_place_on_the_site():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = set("\n".join(re.findall(r"```\{toctree\}\n(.*?)```", index, flags=re.DOTALL)).split())
    assert {page.stem for page in DOCS.glob("*.md")} - {"index", "paper"} <= listed
    assert {f"notebooks/{book.stem}" for book in DOCS.glob("notebooks/*.ipynb")} <= listed


def test_every_public_name_is_in_the_reference():
    page = "".join((DOCS / name).read_text(encoding="utf-8") for name in ("api.md", "loads.md"))
    listed = {line.strip() for line in page.splitlines() if line.startswith("   ")}
    materials = {name: getattr(msdwarp, name) for name in re.findall(r"\| `([A-Z_]+)` \|", page)}
    for name, said in materials.items():
        _, _, density, modulus, ratio, *_ = next(
            line for line in page.splitlines() if f"| `{name}` |" in line
        ).split("|")
        assert (float(density), float(modulus), float(ratio)) == (
            said.density,
            said.youngs_modulus,
            said.damping_ratio,
        )
    listed |= set(materials)
    assert {name for name in msdwarp.__all__ if name not in listed} == set()


def test_every_scene_is_in_the_gallery():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert [name for name in scene_names() if f"`msdwarp run {name}" not in page] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_on_a_page_have_the_flags_that_it_names(page):
    text = page.read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL))
    commands = re.findall(r"\bmsdwarp ([a-z]+)\b([^\n'&]*)", blocks)
    commands += re.findall(r"`(?:\.venv/bin/)?msdwarp ([a-z]+)\b([^`]*)`", text)
    for command, words in commands:
        known = _flags(command, words.split())
        for flag in re.findall(r"(?<!\S)--[a-z-]+", words):
            assert flag in known | {"--help"}, f"msdwarp {command}{words}"


def _flags(command: str, words: list[str]) -> set[str]:
    """Return the flags of a command, with those of its scene where it has one."""
    if command in OF_EVERY_SCENE:
        names = _names(OF_EVERY_SCENE[command])
        if words and words[0] in scene_names():
            names |= set(inspect.signature(find_scene(words[0]).build).parameters)
        elif words and words[0] == "drop.py":
            names |= {"radius", "stiffness"}
        return {"--" + name.replace("_", "-") for name in names}
    return set(re.findall(r"--[a-z-]+", app[command].generate_docs(heading_level=2)))


def _names(options: type) -> set[str]:
    """Return the names of options, those within others among them."""
    names = set()
    for one in fields(options):
        inner = one.default_factory
        names |= _names(inner) if isinstance(inner, type) and is_dataclass(inner) else {one.name}
    return names
