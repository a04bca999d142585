"""What surrounds the code: versions that agree, and files that other services read."""

import re
import tomllib

import pytest
from rooms import ROOT

import msdwarp

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


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
    lowest = PROJECT["requires-python"].removeprefix(">=")
    assert lowest in jobs["all"]["strategy"]["matrix"]["python"]
