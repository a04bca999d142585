"""The README: its example runs, its commands and paths exist."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_example_runs_and_is_short(tmp_path, monkeypatch, capsys):
    example, _ = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    lines = [line for line in example.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 20
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})
    assert "substeps a frame" in capsys.readouterr().out
    assert np.asarray(Image.open(tmp_path / "block.png")).std() > 5  # not blank


def test_the_second_example_leaves_a_dent(capsys):
    _, example = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)
    assert "height" in capsys.readouterr().out
    dented = names["dented"]
    assert 0.25 < dented.position[:, 2].max() < 0.38  # the press came down to 0.3 m
    assert (dented.rest_length != dented.original_length).mean() > 0.05


def test_the_example_of_the_live_view_runs(capsys):
    pytest.importorskip("viser")
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/live.md").read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(example, "live.md", "exec"), {})
    assert "http://127.0.0.1:" in capsys.readouterr().out


def test_the_example_of_loads_runs(capsys):
    (example,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs/loads.md").read_text(encoding="utf-8"), re.DOTALL
    )
    names: dict = {}
    exec(compile(example, "loads.md", "exec"), names)
    assert "work of the loads" in capsys.readouterr().out
    assert names["positions"].shape == (120, 3)


def test_the_example_of_contact_rests(capsys):
    (example,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs/contact.md").read_text(encoding="utf-8"), re.DOTALL
    )
    exec(compile(example, "contact.md", "exec"), {})
    height = float(capsys.readouterr().out.rsplit(maxsplit=1)[-1])
    assert abs(height - 0.2) < 0.005  # m: within 5 % of the spacing of where both are drawn to touch


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_every_link_of_the_docs_leads_somewhere(page):
    links = re.findall(r"\]\(([^)h#][^)#]*)", page.read_text(encoding="utf-8"))
    assert not [link for link in links if not (page.parent / link).exists()]


def test_every_path_it_names_exists():
    links = re.findall(r"\]\(([^)h][^)]*)\)", README)
    (layout,) = re.findall(r"## Layout\n\n```\n(.*?)```", README, flags=re.DOTALL)
    assert len(links) > 5
    paths = [*links]
    folder = ""
    for line in layout.splitlines():
        for word in re.findall(r"[\w/]+(?:\.py|/)(?=\s|$)", line):
            if not line.startswith(" ") and word.endswith("/"):
                folder = word
                paths.append(word)
            else:
                paths.append(folder + word)
    missing = [path for path in paths if not (ROOT / path).exists()]
    assert not missing
